"""The stencil of a body with cut voxels is the network of its links."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.network.cut_stencil import CutStencil
from jaxthermo.network.stencil import Stencil
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.voxelize import voxelize
from tests.networks import one_material, outputs_at_nodes, state_of, two_materials


HEAT = 4e6
GRID = voxelize(shapes.sphere(0.1, subdivisions=3), 0.0277, "crossings")


def network(conductivity, stencil, mixed=False):
    """Network of one material, or of two, one with three times the conductivity."""
    structure = FullVolume(GRID, stencil=stencil)
    if not mixed:
        return structure, one_material(structure, conductivity, HEAT)
    k = np.array(conductivity)
    return structure, two_materials(structure, [k, 3 * k], HEAT)


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("conductivity", [16.0, (16.0, 2.0, 0.5)])
def test_every_operator_is_that_of_the_links(conductivity, mixed):
    theta = np.random.default_rng(1).normal(size=GRID.solid_count)
    fast = network(conductivity, True, mixed)
    assert type(fast[1]) is CutStencil
    actual = outputs_at_nodes(*fast, theta)
    expected = outputs_at_nodes(*network(conductivity, False, mixed), theta)
    for name, exact in expected.items():
        np.testing.assert_allclose(
            actual[name], exact, rtol=1e-11, atol=1e-9, err_msg=name
        )
    heat = HEAT * GRID.body_volume
    assert float(actual["total_capacity"]) == pytest.approx(heat, rel=1e-13)
    # What flows is neither made nor lost.
    rate = np.asarray(actual["heat_rate"])
    assert abs(rate.sum()) < 1e-13 * np.abs(rate).sum()


def test_cells_without_a_node_stay_at_zero():
    structure, operator = network(16.0, True)
    state = state_of(structure, 1.0 + np.arange(structure.node_count))
    networks = eqx.filter_jit(
        lambda network, *at: (network.euler_step(*at), network.capacity())
    )
    stepped, empty = map(np.array, networks(operator, state, np.array(0.1)))
    stepped[structure.node_address()] = 0.0
    assert not stepped.any()
    empty[structure.node_address()] = 0.0
    assert not empty.any()


def test_the_derivative_by_conductivity_and_capacity_is_the_difference_quotient():
    structure, _ = network(16.0, True)
    rng = np.random.default_rng(2)
    initial = state_of(structure, rng.normal(size=structure.node_count))

    def after(k, heat):
        operator = one_material(structure, k, heat)
        stepped = operator.euler_step(initial, jnp.array(2.0))
        return (operator.euler_step(stepped, jnp.array(2.0)) ** 2).sum()

    k = 16.0
    heat = HEAT
    step = 1e-5
    structures = jax.jit(jax.value_and_grad(after, argnums=(0, 1)))
    actual = structures(k, heat)[1]

    def value(conductivity, heat_capacity):
        return structures(conductivity, heat_capacity)[0]

    quotient = (
        (value(k * (1 + step), heat) - value(k * (1 - step), heat)) / (2 * step * k),
        (value(k, heat * (1 + step)) - value(k, heat * (1 - step))) / (2 * step * heat),
    )
    np.testing.assert_allclose(actual, quotient, rtol=1e-7)


def test_a_body_of_whole_voxels_has_the_plain_stencil():
    """A box whose faces lie between voxels: nothing of cut ones is compiled."""
    for end, operator in ((0.0, Stencil), (0.004, CutStencil)):
        grid = voxelize(shapes.box((0.04, 0.03, 0.05 + end)), 0.01)
        structure = FullVolume(grid, stencil=True)
        actual = one_material(structure, jnp.asarray(16.0), HEAT)
        assert type(actual) is operator
        assert grid.cut is not None and grid.cut.is_empty == (end == 0.0)
