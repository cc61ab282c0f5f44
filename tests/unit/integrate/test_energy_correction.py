"""Stored heat and heat of the ledger become equal; states stay within bounds."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import jaxthermo as jt
from jaxthermo.integrate.implicit.runge_kutta import _correct_energy, _solve_dominant
from jaxthermo.integrate.run.ledger import into_bodies
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
_closed = eqx.filter_jit(_correct_energy)
_stored = eqx.filter_jit(lambda network, old, new: network.stored(new - old))


@functools.cache
def _scene(conductance):
    grid = blocks(np.ones((3, 3, 3), bool), 0.01)
    structure = jt.FullVolume(grid)
    beside = jt.Pose(translation=(0.03, 0.0, 0.0))
    bodies = (
        jt.Body(structure, METAL, temperature=400.0),
        jt.Body(structure, METAL, temperature=300.0, pose=beside),
    )
    terms = (
        jt.Contact(conductance),
        jt.Convection(50.0, 350.0),
        jt.Surroundings(300.0),
    )
    return compile_scene(jt.Scene(bodies, terms, dtype="float64"))


def _step(conductance, g, off, seed):
    """Random states and heat that do not fit, closed."""
    compiled = _scene(conductance)
    program, before = compiled.program, compiled.state
    rng = np.random.default_rng(seed)
    inside = np.zeros(before[0].shape, bool)
    inside[1:-1, 1:-1, 1:-1] = True
    after = tuple(
        jnp.asarray(np.where(inside, old + rng.uniform(-1, 1, old.shape), 0))
        for old in before
    )
    heat = jnp.asarray(off * rng.uniform(-1, 1, len(program.entries)))
    time = jnp.asarray(0.0)
    found, entered = _closed(program, before, after, heat, jnp.asarray(g), time)
    return program, before, after, found, heat, entered


@pytest.mark.parametrize("conductance", [1.0, 1e6, np.inf])
@pytest.mark.parametrize("g", [1e-3, 1.0, 1e6, 1e12])
def test_every_body_holds_what_it_was_brought(g, conductance):
    program, before, after, found, _, entered = _step(conductance, g, 100.0, 0)
    brought = into_bodies(entered, program.entries, 2)
    for body, old, new, heat in zip(
        program.bodies, before, found, brought, strict=True
    ):
        stored = _stored(body.network, old, new)
        assert abs(float(stored - heat)) < 1e-9
    # In steps far longer than the body's own time the states are not touched.
    if g == 1e12:
        for new, old in zip(found, after, strict=True):
            np.testing.assert_allclose(new, old, atol=1e-8)


def test_nodes_that_have_not_moved_stay():
    compiled = _scene(100.0)
    before = compiled.state
    after = (before[0].at[1, 1, 1].add(1.0), before[1])
    heat = jnp.full(len(compiled.program.entries), 0.1)
    found, _ = _closed(
        compiled.program, before, after, heat, jnp.asarray(1.0), jnp.asarray(0.0)
    )
    changed = np.argwhere(np.asarray(found[0] != before[0]))
    assert changed.tolist() == [[1, 1, 1]]
    np.testing.assert_array_equal(found[1], before[1])


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.floats(-12, 12), min_size=4, max_size=4),
    st.lists(st.floats(-12, 12), min_size=6, max_size=6),
    st.integers(0, 2**31),
)
def test_elimination_loses_no_digit_however_strong_the_links(excess, links, seed):
    """The right-hand side of a known positive solution is found back."""
    stored = 10.0 ** np.array(excess)
    between = np.zeros((4, 4))
    between[np.triu_indices(4, 1)] = 10.0 ** np.array(links)
    between = between + between.T
    wanted = stored * np.random.default_rng(seed).uniform(1, 2, 4)
    found = np.asarray(_solve(*(jnp.asarray(v) for v in (stored, between, wanted))))
    # Summed over all, the links cancel.
    np.testing.assert_allclose(stored @ found, wanted.sum(), rtol=1e-13)
    # Between what each alone would have, by the maximum principle.
    alone = wanted / stored
    assert found.min() >= alone.min() * (1 - 1e-13)
    assert found.max() <= alone.max() * (1 + 1e-13)


_solve = eqx.filter_jit(_solve_dominant)


def test_elimination_solves():
    rng = np.random.default_rng(0)
    between = rng.uniform(0, 1, (5, 5))
    between = np.triu(between, 1) + np.triu(between, 1).T
    stored, right = rng.uniform(0.1, 1, 5), rng.normal(size=5)
    matrix = np.diag(stored + between.sum(1)) - between
    found = _solve(*(jnp.asarray(v) for v in (stored, between, right)))
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-10)
