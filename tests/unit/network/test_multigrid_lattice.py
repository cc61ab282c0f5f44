"""Coarser lattices conduct as if the body had been cut into larger voxels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.network.multigrid import _lattice_levels, _LatticeTransfer
from jaxthermo.network.stencil import HeterogeneousStencil
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from tests.bodies import blocks


_heat_rate = jax.jit(lambda network, state: network.heat_rate(state))


def _body(shape, k, stencil=True):
    structure = FullVolume(blocks(np.ones(shape, bool)), stencil=stencil)
    return assemble_uniform(structure, k, 1.0, np.float64)


@pytest.mark.parametrize("shape", [(4, 6, 8), (3, 5, 1)])
def test_total_and_spread_are_transposes(shape):
    random = np.random.default_rng(0)
    transfer = _LatticeTransfer(shape)
    fine = np.pad(random.normal(size=shape), 1)
    coarse = np.asarray(jax.jit(transfer.restrict)(fine))
    assert coarse.shape == tuple((n + 1) // 2 + 2 for n in shape)
    np.testing.assert_allclose(coarse.sum(), fine.sum(), atol=1e-12)
    across = np.pad(random.normal(size=coarse.shape)[1:-1, 1:-1, 1:-1], 1)
    spread = np.asarray(jax.jit(transfer.prolong)(across))
    assert spread.shape == fine.shape
    np.testing.assert_allclose((spread * fine).sum(), (across * coarse).sum())
    i = 2
    j = 3
    k = 0
    assert spread[i + 1, j + 1, k + 1] == across[i // 2 + 1, j // 2 + 1, k // 2 + 1]


@pytest.mark.parametrize("k", [2.0, (3.0, 1.0, 0.5)])
def test_a_coarse_box_is_a_box_of_larger_voxels(k):
    """K A / L between voxels twice as large: twice that of the small ones."""
    fine, coarse = _lattice_levels(_body((8, 4, 6), jnp.asarray(k)), 200)[0]
    again = _body((4, 2, 3), 2 * jnp.asarray(k))
    state = np.pad(np.random.default_rng(0).normal(size=(4, 2, 3)), 1)
    rates = (np.asarray(_heat_rate(faces, state)) for faces in (coarse, again))
    actual, expected = (rate[1:-1, 1:-1, 1:-1] for rate in rates)
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_faces_of_a_mixed_body_are_those_between_its_blocks():
    """Counted by hand from links between voxels."""
    random = np.random.default_rng(3)
    solid = random.random((5, 4, 3)) < 0.7
    structure = FullVolume(blocks(solid))
    number = random.integers(0, 2, structure.node_count).astype(np.int32)
    network = _assemble_mixed(structure, number, jnp.array([1.0, 1e5]), jnp.ones(2))
    assert isinstance(network, HeterogeneousStencil)
    coarse = _lattice_levels(network, 100)[0][1]
    assert isinstance(coarse, HeterogeneousStencil)
    uniform = assemble_uniform(structure, 1.0, 1.0, np.float64)
    plain = _lattice_levels(uniform, 100)[0][1]
    assert isinstance(plain, HeterogeneousStencil)
    for axis, face in enumerate(network.face_conductance):
        expected = np.zeros(coarse.face_conductance[axis].shape)
        counted = np.zeros_like(expected)
        for cell in np.argwhere(np.asarray(face) > 0):
            if cell[axis] % 2 == 0:
                expected[tuple(cell // 2)] += face[tuple(cell)] / 2
                counted[tuple(cell // 2)] += 0.5
        np.testing.assert_allclose(coarse.face_conductance[axis], expected, rtol=1e-12)
        np.testing.assert_allclose(plain.face_conductance[axis], counted)
