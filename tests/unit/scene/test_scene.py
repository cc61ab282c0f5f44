"""Scenes that cannot be meant are refused when they are put together."""

from dataclasses import replace

import numpy as np
import pytest

import jaxthermo as jt
from tests.bodies import blocks


@pytest.fixture(scope="module")
def structure():
    return jt.FullVolume(blocks(np.ones((2, 2, 2), bool), 0.01))


@pytest.mark.parametrize("temperature", ["20 degC", -1.0, float("nan"), [1.0, 2.0]])
def test_a_start_that_is_no_temperature_is_refused(structure, temperature):
    with pytest.raises(jt.InputError, match="give kelvin"):
        jt.Body(structure, jt.materials["copper"], temperature=temperature)


def test_a_body_of_air_alone_is_refused_in_one_line(structure):
    full = structure.grid
    fields = ("position", "normal", "area", "voxel", "axis", "layer")
    none = {f"fragment_{f}": getattr(full, f"fragment_{f}")[:0] for f in fields}
    grid = replace(full, solid=np.zeros_like(full.solid), **none)
    with pytest.raises(jt.InputError, match="2 x 2 x 2 .* no solid voxel") as raised:
        jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=300.0)
    assert "\n" not in str(raised.value)


def test_two_surroundings_are_refused(structure):
    body = jt.Body(structure, jt.materials["copper"], temperature=300.0)
    with pytest.raises(jt.InputError, match="two Surroundings"):
        jt.Scene((body,), (jt.Surroundings(290.0), jt.Surroundings(280.0)))


def test_local_air_is_not_what_the_surface_mirrors(structure):
    body = jt.Body(structure, jt.materials["copper"], temperature=300.0)
    hot = jt.Convection(10.0, 353.0, on=jt.Side((0.0, 0.0, -1.0)))
    camera = jt.OrthographicCamera(
        (1.0, 0.0, 0.01), (0.0, 0.0, 0.01), 0.1, width=20, height=20
    )
    solution = jt.simulate(jt.Scene((body,), (hot,), dtype="float64"), 0.0)
    background = np.asarray(jt.render(solution, camera).temperature)[0, 0]
    assert background == pytest.approx(293.15)
