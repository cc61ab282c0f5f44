"""Stacks of the ground: their layers, and how far the wave of a day goes down."""

from collections.abc import Mapping

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.material.layer import Layer
from jaxthermo.material.stacks import stack_rows, stacks


DAY = 86400.0
"""Period of the daily wave of temperature [s]."""
OF_GROUND = ("soil", "asphalt", "concrete_on_soil", "grass")


def exact_amplitude(layers, period):
    """Amplitude below layers on a half space of the lowest material, over the top's.

    Temperature and heat flux of exp(i omega t) go through a layer by its transfer
    matrix (Carslaw and Jaeger 1959, 3.7).
    """
    omega = 2.0 * np.pi / period
    below = layers[-1].material
    state = np.array([1.0, np.sqrt(1j * omega) * below.effusivity])
    for layer in reversed(layers):
        material = layer.material
        root = np.sqrt(1j * omega / material.diffusivity)
        angle = root * layer.thickness
        admittance = material.conductivity * root
        transfer = np.array([
            [np.cosh(angle), np.sinh(angle) / admittance],
            [np.sinh(angle) * admittance, np.cosh(angle)],
        ])  # fmt: skip
        state = transfer @ state
    return 1.0 / abs(state[0])


@pytest.mark.parametrize("name", OF_GROUND)
def test_the_day_does_not_reach_below_a_stack(name):
    layers = stacks[name]
    decays = [
        layer.thickness * np.sqrt(np.pi / (layer.material.diffusivity * DAY))
        for layer in layers
    ]
    assert sum(decays) > 4.0
    assert exact_amplitude(layers, DAY) < 0.002


def test_waves_in_one_material_have_the_closed_form():
    soil = Layer(jt.Material(0.9, 1800.0, specific_heat=1250.0), 0.05)
    expected = np.exp(-0.2 * np.sqrt(np.pi / (4e-7 * 7200.0)))
    assert exact_amplitude((soil,) * 4, 7200.0) == pytest.approx(expected)


def test_layers_come_from_the_top_down():
    asphalt, gravel, soil = stacks["asphalt"]
    assert (asphalt.material, asphalt.thickness) == (jt.materials["asphalt"], 0.1)
    assert (gravel.material, gravel.thickness) == (jt.materials["gravel"], 0.3)
    assert soil == Layer("moist_soil", 0.5)
    slab, _ = stacks["concrete_on_soil"]
    assert slab.material.absorptivity == 0.65
    (grass,) = stacks["grass"]
    (bare,) = stacks["soil"]
    assert grass.material.conductivity == bare.material.conductivity
    assert (grass.material.emissivity, grass.material.absorptivity) == (0.95, 0.8)


def test_clothes_have_the_resistance_of_their_garments():
    """Trousers and a shirt with long sleeves: 0.61 clo of 0.155 m^2 K/W (ASHRAE 55)."""
    resistance = sum(layer.resistance for layer in stacks["light_clothing"])
    assert resistance == pytest.approx(0.61 * 0.155, rel=5e-3)


def test_every_layer_has_a_source_and_a_material():
    for name, rows in stack_rows().items():
        for row in rows:
            assert row.stack == name
            assert row.source
            assert row.material in jt.materials


def test_the_table_is_a_mapping():
    assert jt.stacks is stacks
    assert isinstance(stacks, Mapping)
    assert list(stacks) == [*OF_GROUND, "light_clothing"]
    assert len(stacks) == 5
    assert "soil" in stacks and "mud" not in stacks
    assert stacks.get("mud") is None
    assert stacks.get("soil") == stacks["soil"]


def test_unknown_names_get_help():
    with pytest.raises(InputError, match="'asfalt' is not known: did you mean asphalt"):
        stacks["asfalt"]
    with pytest.raises(InputError, match="'concrete' .* mean concrete_on_soil"):
        stacks["concrete"]
    with pytest.raises(InputError, match="soil, asphalt, concrete_on_soil, grass"):
        stacks["zzz"]
