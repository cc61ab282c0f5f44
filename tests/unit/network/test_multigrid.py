"""Conjugate gradients with it: few iterations, however fine, and the right answer."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pyamg
import pytest
import scipy.sparse as sparse

from jaxthermo.network.multigrid import Hierarchy, hierarchy, jacobi
from jaxthermo.network.nonlinear import NonlinearNetwork
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.kinds.groups import Octree, ShellOverCore
from tests.bodies import blocks


H = 0.1
"""Surface conductance over conductivity times a voxel's edge (a cube of 1) [-]."""


@partial(jax.jit, static_argnames=("tolerance", "max_steps"))
def _solve(network, method, m, b, tolerance=1e-8, max_steps=400):
    """Preconditioned conjugate gradients, their number and relative residual."""
    preconditioner = method.cycle(m) if isinstance(method, Hierarchy) else method

    def more(carry):
        _, r, _, _, count = carry
        return (jnp.vdot(r, r) > tolerance**2 * jnp.vdot(b, b)) & (count < max_steps)

    def iterate(carry):
        x, r, p, rz, count = carry
        ap = m * p - network.heat_rate(p)
        step = rz / jnp.vdot(p, ap)
        x = x + step * p
        r = r - step * ap
        z = preconditioner(r)
        new = jnp.vdot(r, z)
        return x, r, z + new / rz * p, new, count + 1

    z = preconditioner(b)
    start = (jnp.zeros_like(b), b, z, jnp.vdot(b, z), 0)
    x, _, _, _, count = jax.lax.while_loop(more, iterate, start)
    residual = jnp.linalg.norm(b - (m * x - network.heat_rate(x)))
    return x, count, residual / jnp.linalg.norm(b)


def _heated(structure, dt=None, dtype: Any = np.float64):
    """Heat onto half of the surface, carried off from all of it: network, m and b."""
    network = assemble_uniform(structure, 1.0, 1.0, dtype)
    node = structure.fragment_node()
    grid = structure.grid
    n = structure.node_count
    surface = np.bincount(node, grid.fragment_area, n)
    lit = np.bincount(node, grid.fragment_area * (grid.fragment_normal[:, 0] > 0), n)
    m = H * surface + (structure.nodes().volume / dt if dt else 0)

    def put(values):
        state = np.zeros(structure.state_shape, dtype)
        state[structure.node_address()] = values
        return jax.device_put(state)

    return network, put(m), put(lit)


def _box(height):
    return blocks(np.ones((height // 2, height // 2, height), bool), 1 / height)


def _sparse(structure, network, m):
    """The same system from plain links."""
    links = structure.links()
    n = structure.node_count
    g = links.area / (links.distance_src + links.distance_dst)
    half = sparse.coo_array((g, (links.src, links.dst)), (n, n))
    k = half + half.T
    diagonal = k.sum(axis=1) + np.asarray(m)[structure.node_address()]
    return sparse.csr_array(sparse.diags_array(diagonal) - k)


@pytest.mark.slow
@pytest.mark.parametrize("dt", [None, pytest.param(0.01, marks=pytest.mark.slice)])
def test_iterations_hardly_grow_with_the_resolution(dt):
    counts = []
    for height in (12, 24):
        structure = FullVolume(_box(height))
        network, m, b = _heated(structure, dt=dt)
        levels = hierarchy(structure, network)
        counts.append(int(_solve(network, levels, m, b)[1]))
    assert counts[1] <= 1.5 * counts[0]
    assert counts[1] <= 13


@pytest.mark.parametrize(
    "structure_class", [FullVolume, pytest.param(ShellOverCore, marks=pytest.mark.slow)]
)
def test_it_agrees_with_a_direct_solve_and_beats_the_diagonal(structure_class):
    structure = structure_class(_box(24))
    network, m, b = _heated(structure)
    address = structure.node_address()
    matrix = _sparse(structure, network, m)
    exact = sparse.linalg.spsolve(matrix.tocsc(), np.asarray(b)[address])
    levels = hierarchy(structure, network)
    actual, count, _ = _solve(network, levels, m, b)
    actual = np.asarray(actual)
    np.testing.assert_allclose(actual[address], exact, rtol=1e-6)
    assert abs(actual.sum() - actual[address].sum()) < 1e-9 * abs(actual.sum())
    plain = _solve(network, jacobi(network, m), m, b)[1]
    assert int(count) * 4 < int(plain)


def test_it_takes_no_more_iterations_than_algebraic_multigrid():
    """As pyamg sets it up for the same system, by half as many again."""
    structure = FullVolume(_box(24))
    network, m, b = _heated(structure)
    levels = hierarchy(structure, network)
    count = int(_solve(network, levels, m, b)[1])
    peer = pyamg.smoothed_aggregation_solver(_sparse(structure, network, m))
    residuals = []
    peer.solve(
        np.asarray(b)[structure.node_address()],
        tol=1e-8,
        accel="cg",
        residuals=residuals,
    )
    assert count <= 1.5 * (len(residuals) - 1)


def _odd_body(name):
    solid = np.zeros((12, 12, 12), bool)
    if name == "isolated voxels":
        solid[::2, ::2, ::2] = True
    elif name == "sheet":
        solid[:, :, 5] = True
    elif name == "parts":
        solid[:5] = True
        solid[7:, :, 3:] = True
        solid[0, 0, 0] = True
    else:
        solid[3, 4, 5] = True
    return solid


@pytest.mark.parametrize(
    ("name", "stencil"),
    [
        ("isolated voxels", True),
        ("sheet", True),
        ("parts", True),
        ("one voxel", True),
        ("isolated voxels", False),
        ("parts", False),
    ],
)
def test_odd_bodies_are_solved(name, stencil):
    structure = FullVolume(blocks(_odd_body(name), 1 / 12), stencil=stencil)
    network, m, b = _heated(structure)
    levels = hierarchy(structure, network)
    _, count, residual = _solve(network, levels, m, b)
    assert float(residual) < 2e-8
    assert int(count) <= 20


def test_two_materials_and_a_stiffness_over_eight_decades():
    structure = FullVolume(_box(12))
    random = np.random.default_rng(0)
    number = (structure.nodes().centre[:, 2] > 0.4).astype(np.int32)
    network = _assemble_mixed(structure, number, jnp.array([1e-5, 1.0]), jnp.ones(2))
    _, m, b = _heated(structure)
    m = np.asarray(m) * 10.0 ** random.uniform(-4, 4, m.shape)
    levels = hierarchy(structure, network)
    _, count, residual = _solve(network, levels, m, b)
    assert float(residual) < 2e-8
    assert int(count) <= 25


def test_in_single_precision_and_with_nothing_that_holds_the_body():
    """Without m the heat must sum to nothing; the answer is one up to a constant."""
    structure = Octree(_box(16))
    network, m, b = _heated(structure, dtype=np.float32)
    address = structure.node_address()
    b = np.array(b)
    b[address] -= b[address].mean()
    levels = hierarchy(structure, network)
    actual, count, residual = _solve(network, levels, 0 * m, b, tolerance=1e-4)
    assert actual.dtype == np.float32
    assert int(count) <= 12
    assert float(residual) < 5e-4


@pytest.mark.slow
@pytest.mark.slice
def test_conductances_may_be_traced_and_steps_mapped():
    """As calibration does: the levels inside jit, under vmap over k and over m."""
    structure = Octree(_box(12))
    _, m, b = _heated(structure)

    def solution(k, factor):
        network = assemble_uniform(structure, k, 1.0, np.float64)
        return hierarchy(structure, network).cycle(factor * m)(b)

    k = jnp.array([1.0, 2.0])
    factor = jnp.array([1.0, 3.0])
    mapped = jax.jit(jax.vmap(solution))(k, factor)
    alone = jax.jit(solution)
    for cycle in range(2):
        expected = alone(k[cycle], factor[cycle])
        np.testing.assert_allclose(mapped[cycle], expected, rtol=1e-9)


def test_a_varying_body_is_preconditioned_as_it_is_at_the_reference():
    structure = Octree(_box(12))
    network, _, _ = _heated(structure)
    varying = NonlinearNetwork(network, None, None)
    for a, b in zip(
        jax.tree.leaves(hierarchy(structure, varying)),
        jax.tree.leaves(hierarchy(structure, network)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
