"""Bodies that see each other exchange heat, and lose none between them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.reference.view_factor import parallel_rectangles
from tests.bodies import body_at, single_body_scene


METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
GRID = jt.voxelize(jt.shapes.box((0.02, 0.06, 0.06)), 0.01)
PLATE = jt.FullVolume(GRID)
GAP = 0.03


def _facing(gap, hot=500.0, cold=300.0, surroundings=300.0, dtype: Dtype = "float64"):
    bodies = tuple(
        body_at(PLATE, METAL, start, at=(height, 0.0, 0.0))
        for start, height in ((hot, 0.0), (cold, 0.02 + gap))
    )
    return jt.Scene(
        bodies,
        (jt.RadiativeExchange(surroundings, max_patches=48, directions=48),),
        dtype=dtype,
        allow_extreme_temperatures=True,
    )


@pytest.mark.slow
def test_what_a_hot_plate_sends_a_cold_one_gets():
    near = jt.simulate(_facing(0.01), 20.0)
    far = jt.simulate(_facing(1.0), 20.0)

    def rise(run):
        return float(run.mean_temperature[0, 1]) - 300.0

    assert rise(near) > 20 * rise(far) > 0
    for run in (near, far):
        assert np.abs(run.energy.residual_relative).max() < 1e-12
        for body in run.energy.bodies:
            assert np.abs(body.residual_relative).max() < 1e-12


@pytest.mark.slow
def test_a_convex_body_sees_only_its_surroundings():
    def run(term):
        return jt.simulate(single_body_scene(PLATE, METAL, 400.0, term), 20.0)

    alone = run(jt.RadiativeExchange(290.0))
    plain = run(jt.Surroundings(290.0))
    assert_allclose(alone.surface_temperature, plain.surface_temperature, rtol=1e-7)
    assert float(plain.mean_temperature[0, 0]) < 399.9


# By default at rest by its heat rates: test_exchange_accuracy.
@pytest.mark.slow
def test_where_all_is_at_one_temperature_nothing_flows():
    run = jt.simulate(
        _facing(GAP, hot=350.0, cold=350.0, surroundings=350.0),
        20.0,
        solver=jt.ForwardEuler(),
    )
    assert_allclose(run.surface_temperature, 350.0, atol=1e-9)


@pytest.mark.parametrize(
    "dtype",
    ["float64", pytest.param("float32", marks=pytest.mark.slow)],
)
def test_the_first_heat_between_two_squares_is_that_of_their_view_factor(dtype):
    """Black, 6 cm wide and 3 cm apart; the cold one and all around at 0 K."""
    black = jt.Material(400.0, density=8000.0, specific_heat=400.0, emissivity=1.0)
    width = 0.06
    hot = 400.0
    scene = _facing(GAP, hot=hot, cold=0.0, surroundings=0.0, dtype=dtype)
    bodies = tuple(
        jt.Body(b.structure, black, temperature=b.temperature, pose=b.pose)
        for b in scene.bodies
    )
    scene = replace(scene, bodies=bodies)
    end = 0.5
    energy = jt.simulate(scene, end, solver=jt.ForwardEuler()).energy
    factor = parallel_rectangles(width, width, GAP)
    exact = 5.670374419e-8 * hot**4 * width * width * factor * end
    got = float(energy.bodies[1].mechanisms["emission"][0])
    # The edges of the plates see each other's too, by a little.
    assert got == pytest.approx(exact, rel=0.05)
