"""Stored heat and heat of the ledger become equal; states stay within bounds."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jaxtyping import Array

import jaxthermo as jt
from jaxthermo.integrate.implicit.runge_kutta import _correct_energy, _solve_dominant
from jaxthermo.integrate.ledger import EntryEnds
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.program import Program, State
from tests.bodies import blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
_closed = eqx.filter_jit(_correct_energy)
_stored = eqx.filter_jit(lambda network, old, new: network.stored(new - old))


@functools.cache
def _scene(conductance):
    grid = blocks(np.ones((3, 3, 3), bool), 0.01)
    structure = jt.FullVolume(grid)
    touching = jt.Pose(translation=(0.03, 0.0, 0.0))
    bodies = (
        jt.Body(structure, METAL, temperature=400.0),
        jt.Body(structure, METAL, temperature=300.0, pose=touching),
    )
    terms = (
        jt.Contact(conductance),
        jt.Convection(50.0, 350.0),
        jt.Surroundings(300.0),
    )
    return compile_scene(jt.Scene(bodies, terms, dtype="float64"))


class _Correction(NamedTuple):
    program: Program
    start: State
    end: State
    """States before the correction."""
    corrected: State
    entered: Array
    """Heat of each ledger entry after the correction [J]."""


def _step(conductance, g, off, seed):
    """Random states and heat that do not fit, before and after their correction."""
    compiled = _scene(conductance)
    program = compiled.program
    start = compiled.state
    rng = np.random.default_rng(seed)
    inside = np.zeros(start[0].shape, bool)
    inside[1:-1, 1:-1, 1:-1] = True
    end = tuple(
        jnp.asarray(np.where(inside, old + rng.uniform(-1, 1, old.shape), 0))
        for old in start
    )
    heat = jnp.asarray(off * rng.uniform(-1, 1, len(program.entries)))
    time = jnp.asarray(0.0)
    corrected, entered = _closed(program, start, end, heat, jnp.asarray(g), time)
    return _Correction(
        program=program, start=start, end=end, corrected=corrected, entered=entered
    )


@pytest.mark.parametrize("conductance", [1.0, 1e6, np.inf])
@pytest.mark.parametrize("g", [1e-3, 1.0, 1e6, 1e12])
def test_every_body_holds_what_it_was_brought(g, conductance):
    step = _step(conductance, g=g, off=100.0, seed=0)
    program = step.program
    heat_by_body = EntryEnds.of(program.entries).into_bodies(step.entered, 2)
    for body, old, new, heat in zip(
        program.bodies, step.start, step.corrected, heat_by_body, strict=True
    ):
        stored = _stored(body.network, old, new)
        assert abs(float(stored - heat)) < 1e-9
    # In steps far longer than the body's own time the states are not touched.
    if g == 1e12:
        for new, old in zip(step.corrected, step.end, strict=True):
            np.testing.assert_allclose(new, old, atol=1e-8)


def test_nodes_that_have_not_moved_stay():
    compiled = _scene(100.0)
    start = compiled.state
    end = (start[0].at[1, 1, 1].add(1.0), start[1])
    heat = jnp.full(len(compiled.program.entries), 0.1)
    corrected, _ = _closed(
        compiled.program, start, end, heat, jnp.asarray(1.0), jnp.asarray(0.0)
    )
    changed = np.argwhere(np.asarray(corrected[0] != start[0]))
    assert changed.tolist() == [[1, 1, 1]]
    np.testing.assert_array_equal(corrected[1], start[1])


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
    right_side = stored * np.random.default_rng(seed).uniform(1, 2, 4)
    solution = np.asarray(
        _solve(*(jnp.asarray(v) for v in (stored, between, right_side)))
    )
    # Summed over all, the links cancel.
    np.testing.assert_allclose(stored @ solution, right_side.sum(), rtol=1e-13)
    # Between what each alone would have, by the maximum principle.
    alone = right_side / stored
    assert solution.min() >= alone.min() * (1 - 1e-13)
    assert solution.max() <= alone.max() * (1 + 1e-13)


_solve = eqx.filter_jit(_solve_dominant)


def test_elimination_solves():
    rng = np.random.default_rng(0)
    between = rng.uniform(0, 1, (5, 5))
    between = np.triu(between, 1) + np.triu(between, 1).T
    stored = rng.uniform(0.1, 1, 5)
    right = rng.normal(size=5)
    matrix = np.diag(stored + between.sum(1)) - between
    solution = _solve(*(jnp.asarray(v) for v in (stored, between, right)))
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, right), rtol=1e-10)
