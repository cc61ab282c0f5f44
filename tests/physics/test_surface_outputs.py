"""Heat flux and heat transfer coefficient of fragments; a wall is in test_probes."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.errors import InputError
from tests.bodies import bar, body_at
from tests.shallow import SHALLOW


CLAY = jt.Material(1.0, 2000.0, 1000.0, emissivity=0.8)
BOTH = ("heat_flux", "heat_transfer_coefficient")
GRID = bar(4, 0.01)


def scene_of(*terms, bodies=None, outputs=BOTH):
    body = jt.Body(jt.FullVolume(GRID, stencil=False), CLAY, temperature=350.0)
    scene_bodies = (body,) if bodies is None else bodies
    return jt.Scene(scene_bodies, terms, dtype="float64", surface_outputs=outputs)


@SHALLOW
@pytest.mark.slow
@pytest.mark.slice
def test_the_flux_of_all_fragments_is_what_a_body_stores():
    """Wind, sun, emission and contact: the sum of q A is the change of heat."""
    bodies = tuple(
        body_at(GRID, CLAY, kelvin, at=(x, 0.0, 0.0))
        for kelvin, x in ((350.0, 0.0), (320.0, 0.04))
    )
    scene = scene_of(
        jt.Wind((3.0, 0.0, 0.0), 290.0),
        jt.Sun((-1.0, 0.0, -1.0), 500.0),
        jt.Surroundings(280.0),
        jt.Contact(200.0),
        bodies=bodies,
    )
    step = 1e-4
    solution = jt.simulate(scene, step, [0.0, step])
    assert solution.heat_flux is not None
    area = np.concatenate([GRID.fragment_area] * 2)
    rate = (np.asarray(solution.heat_flux)[1] * area).reshape(2, -1).sum(axis=1)
    stored = [np.asarray(b.stored_J)[1] for b in solution.energy.bodies]
    assert_allclose(rate, np.array(stored) / step, rtol=1e-5)
    assert not np.asarray(solution.heat_flux)[0].any()


@pytest.mark.slow
def test_free_convection_and_wind_give_the_coefficient_of_their_flux():
    """h (T_inf - T_s) is the flux where nothing else acts; emission has no h."""
    for term in (jt.FreeConvection(290.0), jt.Wind((2.0, 0.0, 0.0), 290.0)):
        solution = jt.simulate(scene_of(term), 1.0)
        h = solution.heat_transfer_coefficient
        flux = solution.heat_flux
        assert h is not None and flux is not None
        assert (np.asarray(h) > 1.0).all()
        gap = 290.0 - np.asarray(solution.surface_temperature)
        assert_allclose(np.asarray(h) * gap, flux, rtol=1e-9)
    solution = jt.simulate(scene_of(jt.Surroundings(280.0, linear_within=0.5)), 1.0)
    assert not np.asarray(solution.heat_transfer_coefficient).any()
    assert (np.asarray(solution.heat_flux) < -100.0).all()


def test_only_what_is_asked_for_is_saved():
    none = jt.simulate(scene_of(outputs=()), 0.0, [0.0])
    assert none.heat_flux is None and none.heat_transfer_coefficient is None
    fluxes_only = jt.simulate(scene_of(outputs=("heat_flux",)), 0.0, [0.0])
    assert fluxes_only.heat_transfer_coefficient is None
    assert (
        fluxes_only.heat_flux is not None and jnp.shape(fluxes_only.heat_flux)[0] == 1
    )
    with pytest.raises(InputError, match="'flux' is none; name some of heat_flux, "):
        scene_of(outputs=("flux",))
