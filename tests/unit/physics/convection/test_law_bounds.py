"""Bounds of flux and curvature hold, and say what the balance at a surface needs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from wind_bodies import law_of, surface, upright_cylinder

from jaxthermo.physics.convection.free_convection import FreeConvection
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.flux_law import Forcing, bound
from jaxthermo.physics.surface_energy_balance import (
    MAX_ITERATIONS,
    TOLERANCE,
    SurfaceTerms,
)
from jaxthermo.physics.time_varying import Table


REACH, END = Forcing(highest=450.0, lowest=230.0), 10.0
GUST = Table([0.0, 5.0, 10.0], [2.0, 9.0, 0.0])
TERMS = {
    "wind": Wind((3.0, 0.0, 0.0), 290.0),
    "gust": Wind((1.0, 0.0, 0.0), Table([0.0, 10.0], [280.0, 310.0]), speed=GUST),
    "still": FreeConvection(290.0),
}


@pytest.fixture(scope="module")
def side():
    return surface(upright_cylinder())


@eqx.filter_jit
def _flux_and_curvature(law, time, kelvin):
    """Flux and curvature in every cell at every temperature."""
    flux = lambda theta: law.flux(time, theta)
    slope = lambda theta: jax.jvp(flux, (theta,), (jnp.ones_like(theta),))[1]
    bend = lambda theta: jax.jvp(slope, (theta,), (jnp.ones_like(theta),))[1]
    each = lambda t: (flux(t), bend(t))
    places = law_places(law)
    return jax.lax.map(lambda t: each(jnp.full(places, t)), kelvin - law.reference)


def law_places(law):
    return max(np.shape(leaf)[-1] for leaf in jax.tree.leaves(law) if np.ndim(leaf))


@pytest.mark.parametrize("name", list(TERMS))
def test_no_flux_and_no_curvature_is_above_its_bound(side, name):
    law = law_of(TERMS[name], side)
    close = 290 + np.geomspace(1e-4, 1, 50)
    kelvin = np.append(np.linspace(REACH.lowest, REACH.highest, 150), close)
    times = map(jnp.asarray, (0.0, 3.0, 8.0))
    found = [_flux_and_curvature(law, time, kelvin) for time in times]
    flux, bend = (np.abs(np.stack(each)) for each in zip(*found, strict=True))
    most, bent = float(law.max_flux(REACH, END)), float(law.curvature(REACH, END))
    print(name, "flux", flux.max() / most, "curvature", bend.max() / bent)
    assert 0.2 * most < flux.max() < most
    assert 0.02 * bent < bend.max() < bent


def test_a_kink_of_the_film_has_no_bound(side):
    far = Forcing(highest=2000.0, lowest=230.0)
    for name in ("wind", "still"):
        assert law_of(TERMS[name], side).curvature(far, END) == np.inf


@eqx.filter_jit
def _excess(terms, theta):
    return terms.surface_excess(jnp.zeros(()), theta)


@pytest.mark.parametrize("name", list(TERMS))
@pytest.mark.parametrize("conductivity", [400.0, 0.2])
def test_few_steps_are_as_good_as_all(side, name, conductivity):
    law = law_of(TERMS[name], side)
    area = np.full(law_places(law), 1e-6)
    half_cell = area * conductivity / 5e-4
    free = ((0, bound(area, law)),)
    every = SurfaceTerms((name,), half_cell, free, ())
    steps = every.newton_iterations(REACH, END)
    theta = jnp.linspace(REACH.lowest, REACH.highest, len(area)) - law.reference
    few = SurfaceTerms((name,), half_cell, free, (), iterations=steps)
    off = np.abs(_excess(few, theta) - _excess(every, theta)).max()
    print(name, conductivity, "steps", steps, "off", off)
    assert steps < MAX_ITERATIONS
    assert off < TOLERANCE["float64"] + 1e-11
