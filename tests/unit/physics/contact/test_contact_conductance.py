"""Resistances in series from 0 to infinity, with finite derivatives everywhere."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.physics.contact.links import (
    Contact,
    _contact_conductance,
    _gap_factor,
    _series,
)
from jaxthermo.physics.contact.search import ContactPairs, Joint
from jaxthermo.scene.compile.bodies import prepare
from jaxthermo.scene.compile.groups import BodyGroup
from tests.bodies import blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
AREA = jnp.array([1e-4, 3e-6, 0.0])
HALF_A = jnp.array([4.0, 1e-3, 0.0])
HALF_B = jnp.array([0.5, 2e-2, 0.0])
BONDED = np.array([4.0 * 0.5 / 4.5, 1e-3 * 2e-2 / 2.1e-2, 0.0])

conductance = jax.jit(_contact_conductance)


@jax.jit
def series(first, second, third):
    return _series(_series(first, second), third)


@pytest.mark.parametrize("h_c", [1.0, 1e2, 1e4, 1e6])
def test_resistances_add(h_c):
    actual = np.asarray(conductance(AREA, HALF_A, HALF_B, h_c))[:2]
    resistance = 1 / HALF_A[:2] + 1 / (h_c * AREA[:2]) + 1 / HALF_B[:2]
    assert actual == pytest.approx(1 / np.asarray(resistance), rel=1e-13)


def test_limits():
    assert np.asarray(conductance(AREA, HALF_A, HALF_B, 0.0)).tolist() == [0, 0, 0]
    infinite = np.asarray(conductance(AREA, HALF_A, HALF_B, math.inf))
    assert infinite == pytest.approx(BONDED, rel=1e-15)
    huge = np.asarray(conductance(AREA, HALF_A, HALF_B, 1e18))
    assert huge == pytest.approx(BONDED, rel=1e-10)


def test_float32_holds_over_its_whole_range():
    area = AREA.astype(jnp.float32)
    half_a = HALF_A.astype(jnp.float32)
    half_b = HALF_B.astype(jnp.float32)

    def total(h_c):
        return _contact_conductance(
            area, half_a=half_a, half_b=half_b, coefficient=h_c
        ).sum()

    h_c = jnp.asarray([0.0, 1e-30, 1.0, 1e30, 3e38, math.inf], jnp.float32)
    conductances, slope = jax.jit(jax.vmap(jax.value_and_grad(total)))(h_c)
    assert np.isfinite(conductances).all() and np.isfinite(slope).all()
    assert (np.diff(conductances) >= 0).all() and (slope >= 0).all()
    assert np.asarray(conductances[3:]) == pytest.approx(BONDED.sum(), rel=1e-6)


def test_all_derivatives_are_finite_and_right():
    def total(area, h_c):
        return _contact_conductance(
            area, half_a=HALF_A, half_b=HALF_B, coefficient=h_c
        ).sum()

    h_c = jnp.array([0.0, 1.0, 5e3, 1e9, math.inf])
    slopes = jax.jit(jax.vmap(jax.grad(total, (0, 1)), (None, 0)))
    by_area, by_h_c = slopes(AREA, h_c)
    assert np.isfinite(by_area).all() and np.isfinite(by_h_c).all()
    assert float(by_h_c[0]) == pytest.approx(float(AREA.sum()))
    assert float(by_h_c[-1]) == 0.0
    step = 1e-5 * h_c[1:4]
    value = jax.jit(jax.vmap(total, (None, 0)))
    rise = value(AREA, h_c[1:4] + step) - value(AREA, h_c[1:4] - step)
    expected = np.asarray(rise / (2 * step))
    assert np.asarray(by_h_c[1:4]) == pytest.approx(expected, rel=1e-5, abs=1e-16)
    nudge = jnp.array([1e-9, 0.0, 0.0])
    rise = value(AREA + nudge, h_c[1:3]) - value(AREA - nudge, h_c[1:3])
    assert np.asarray(by_area[1:3, 0]) == pytest.approx(
        np.asarray(rise) / 2e-9, rel=1e-5
    )


@settings(deadline=None, max_examples=50)
@given(p=st.floats(0, 1e30), q=st.floats(0, 1e30), r=st.floats(0, 1e30))
def test_the_order_in_a_series_does_not_matter(p, q, r):
    forward, cyclic = (
        float(series(*(jnp.array(v) for v in values)))
        for values in ((p, q, r), (r, p, q))
    )
    assert forward == pytest.approx(cyclic, rel=1e-14, abs=1e-300)
    assert forward <= min(p, q, r)


def test_a_fragments_half_cell_is_shared_by_its_pairs():
    grid = blocks(np.ones((1, 1, 1), bool), 2.0)
    body = jt.Body(jt.FullVolume(grid), METAL, temperature=300.0)
    group = BodyGroup((0,), (body,), body.structure)
    side = prepare(0, group, np.float64)._replace(half_cell=np.full(6, 6.0))
    covered = np.zeros(6)
    pairs = ContactPairs(
        fragment_a=np.array([0, 1]),
        fragment_b=np.array([0, 1]),
        area=np.array([1.0, 2.0]),
        gap=np.zeros(2),
        coverage_a=covered,
        coverage_b=covered,
    )
    joint = Joint(pairs, entry=0, size=3, bodies=(0, 1))
    links = Contact(1.0).bind([joint], ends=(side, side))
    for half in (end.half_cell for end in links.ends):
        assert np.asarray(half).tolist() == [1.5, 3.0, 0.0]


def test_the_gap_law_falls_smoothly_from_one_to_zero():
    gap = jnp.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 2.0]) * 1e-3
    left = np.asarray(_gap_factor(gap, 1e-3))
    assert left == pytest.approx([1, 1, 27 / 32, 0.5, 5 / 32, 0, 0], abs=1e-15)
    slope = jax.jit(jax.vmap(jax.grad(lambda g: _gap_factor(g, 1e-3))))
    slopes = np.asarray(slope(jnp.array([-1e-9, 1e-9, 1e-3 - 1e-9, 1e-3 + 1e-9, 5e-4])))
    assert np.abs(slopes[:4]).max() < 1e-5 * 1.5 / 1e-3
    assert slopes[4] == pytest.approx(-1.5 / 1e-3)


@pytest.mark.parametrize("h_c", [0.0, 2e3, math.inf])
def test_the_coefficient_across_a_gap(h_c):
    gap = jnp.array([0.0, 4e-4, 2e-3])
    areas = jnp.full(3, 1e-4)
    half = jnp.full(3, 0.1)

    def across(length, h):
        return _contact_conductance(
            areas * _gap_factor(gap, length), half_a=half, half_b=half, coefficient=h
        )

    actual = np.asarray(across(1e-3, h_c))
    left = np.asarray(_gap_factor(gap, 1e-3))
    expected = np.full(3, 0.05)
    if math.isfinite(h_c):
        expected = 1 / (2 / 0.1 + 1 / np.maximum(h_c * left * 1e-4, 1e-300))
    assert actual.tolist() == pytest.approx(expected.tolist())
    through = jax.jit(lambda length, h: across(length, h).sum())
    slopes = jax.jit(jax.grad(through, argnums=(0, 1)))(1e-3, h_c)
    assert np.isfinite(slopes).all()
    if h_c == 2e3:
        rise = through(1e-3 + 1e-9, h_c) - through(1e-3 - 1e-9, h_c)
        assert float(slopes[0]) == pytest.approx(float(rise) / 2e-9, rel=1e-6)


@pytest.mark.parametrize("length", [0.0, -1e-3, math.inf, math.nan])
def test_a_gap_length_must_be_one(length):
    with pytest.raises(InputError, match="gap_length"):
        Contact(1.0, gap_length=length)
