"""Temperatures that a user hardly means are refused, in Python as in configs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import bar


METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0)
STRUCTURE = jt.FullVolume(bar(2, 0.1))


def scene(*terms, start=300.0, allow=False) -> jt.Scene:
    body = jt.Body(STRUCTURE, METAL, temperature=start)
    return jt.Scene((body,), terms, allow_extreme_temperatures=allow)


@pytest.mark.parametrize(
    ("start", "terms", "message"),
    [
        (20.0, (), r"bodies\[0\]: Body\(temperature=\): 20 K is below 150 K: give "
         r"kelvin \(20 degC are 293.15 K\); if it is meant, Scene\(..., allow_ext"),
        (1e7, (), r"Body\(temperature=\): 1e\+07 K is above 6000 K: give kelvin; if"),
        (300.0, (jt.Sun((0.0, 0.0, -1.0), 9.0), jt.Convection(1.0, 25.0)),
         r"terms\[1\]: Convection\(temperature=\): 25 K"),
        (300.0, (jt.Surroundings(280.0, ground=15.0),), r"Surroundings\(ground=\): 15"),
        (300.0, (jt.FixedTemperature(jt.Table([0.0, 1.0], [300.0, 7e3])),), "7000 K"),
        (300.0, (jt.RadiativeExchange(jnp.asarray(0.0)),), "0 K is below"),
        (300.0, (jt.Wind((1.0, 0.0, 0.0), 20.0),), r"Wind\(temperature=\)"),
        (300.0, (jt.FreeConvection(20.0),), r"FreeConvection\(temperature=\)"),
        (300.0, (jt.AreaSource((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0),
                               temperature=jt.Until(90.0, 5.0)),), "90 K is below"),
    ],
)  # fmt: skip
def test_they_are_refused_unless_they_are_allowed(start, terms, message):
    with pytest.raises(jt.InputError, match=message) as caught:
        scene(*terms, start=start)
    assert "\n" not in str(caught.value)
    scene(*terms, start=start, allow=True)


def test_tables_of_properties_are_in_kelvin():
    """A table of 20 to 500 degC would end at 500 K in silence."""
    table = jt.Property([20.0, 500.0], [50.0, 40.0])
    metal = jt.Material(table, density=2000.0, specific_heat=500.0)
    body = jt.Body(STRUCTURE, metal, temperature=300.0)
    with pytest.raises(jt.InputError, match=r"bodies\[0\]: Property.*: 20 K is below"):
        jt.Scene((body,))
    jt.Scene((body,), allow_extreme_temperatures=True)


@pytest.mark.parametrize(
    ("start", "terms", "message"),
    [
        (lambda p: 300.0 + 1e4 * p[:, 0], (), r"bodies\[0\]: Body\(temperature=\) giv"),
        (300.0, (jt.Convection(1.0, lambda t: 20.0 + t),),
         r"terms\[0\]: Convection\(temperature=\) gives: 20 K is below"),
    ],
)  # fmt: skip
def test_functions_are_checked_where_they_are_evaluated(start, terms, message):
    with pytest.raises(jt.InputError, match=message):
        compile_scene(scene(*terms, start=start), end=9.0)


def test_the_bounds_themselves_and_traced_values_are_accepted():
    scene(jt.Surroundings(6000.0), start=150.0)
    build = lambda kelvin: scene(jt.Surroundings(kelvin), start=kelvin).bodies[0]
    actual = jax.jit(lambda kelvin: build(kelvin).temperature)(20.0)
    np.testing.assert_allclose(actual, 20.0)
