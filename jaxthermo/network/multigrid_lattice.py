"""Coarser levels of a dense lattice: blocks of 2 x 2 x 2 cells, recursively."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import override

from .multigrid_cycle import AbstractTransfer
from .network import AbstractNetwork
from .stencil import HeterogeneousStencil, OrthotropicStencil, UniformStencil


_Faces = tuple[Array, Array, Array]


class LatticeTransfer(AbstractTransfer):
    """Transfer between a lattice and its blocks, with one empty cell on each side."""

    shape: tuple[int, ...] = eqx.field(static=True)
    """Shape of the fine lattice [cells]."""

    @override
    def restrict(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        values = fine[1:-1, 1:-1, 1:-1]
        for axis in range(3):
            values = _pair_sum(values, axis)
        return jnp.pad(values, 1)

    @override
    def prolong(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        # The loop makes it an array: otherwise XLA repeats the smoothing for each cell.
        along_z = lambda plane: jnp.repeat(plane, 2, axis=1)
        values = jax.lax.map(along_z, coarse[1:-1, 1:-1, 1:-1])
        for axis in range(2):
            values = jnp.repeat(values, 2, axis=axis)
        x, y, z = self.shape
        return jnp.pad(values[:x, :y, :z], 1)


def lattice_levels(
    network: AbstractNetwork, max_size: int
) -> tuple[tuple[AbstractNetwork, ...], tuple[LatticeTransfer, ...]]:
    """Stencil and coarser ones down to `max_size` values in a state, with transfers."""
    networks, transfers = [network], []
    shape = tuple(n - 2 for n in jax.eval_shape(network.diagonal).shape)
    while math.prod(n + 2 for n in shape) > max_size:
        transfers.append(LatticeTransfer(shape))
        faces = _block_faces(networks[-1])
        shape = tuple(-(-n // 2) for n in shape)
        # Only conduction is evaluated: the capacities of blocks are in m.
        networks.append(HeterogeneousStencil(faces, jnp.zeros(shape, faces[0].dtype)))
    return tuple(networks), tuple(transfers)


def _block_faces(network: AbstractNetwork) -> _Faces:
    """Conductance of the faces between blocks of a stencil [W/K]."""
    faces = []
    for axis in range(3):
        values = _even_faces(network, axis)
        for other in {0, 1, 2} - {axis}:
            values = _pair_sum(values, other)
        faces.append(values)
    x, y, z = faces
    if isinstance(network, UniformStencil | OrthotropicStencil):
        # Up to here the values are counts of open faces.
        g = jnp.broadcast_to(network.conductance, (3,))
        x, y, z = (n.astype(g.dtype) * g[axis] for axis, n in enumerate(faces))
    # The centres of blocks are twice as far apart, so the conductance is half of that
    # of the faces together. The plain sum, which the transfers imply, would make coarse
    # levels twice as stiff and correct half of the error.
    return x / 2, y / 2, z / 2


def _even_faces(network: AbstractNetwork, axis: int) -> Array:
    """Every other face across an axis: faces between blocks, not inside them."""
    if isinstance(network, HeterogeneousStencil):
        face = network.face_conductance[axis]
        face = _padded(face, axis, 0, (face.shape[axis] + 1) % 2)
        return face[_every_other(axis, 0)]
    if isinstance(network, UniformStencil):
        linked = network.degree > 0
    elif isinstance(network, OrthotropicStencil):
        linked = network.degrees > 0
    else:
        raise TypeError(f"no lattice levels of a {type(network).__name__}")
    # Two adjacent cells that have any links are linked to each other.
    linked = _padded(linked, axis, 1, 1 + linked.shape[axis] % 2)
    both = linked[_every_other(axis, 0)] & linked[_every_other(axis, 1)]
    return both.astype(jnp.uint8)


def _pair_sum(values: Array, axis: int) -> Array:
    """Sums of consecutive pairs of entries along an axis."""
    values = _padded(values, axis, 0, values.shape[axis] % 2)
    return values[_every_other(axis, 0)] + values[_every_other(axis, 1)]


def _padded(values: Array, axis: int, before: int, after: int) -> Array:
    widths = [(0, 0)] * 3
    widths[axis] = (before, after)
    return jnp.pad(values, widths)


def _every_other(axis: int, start: int) -> tuple[slice, ...]:
    index = [slice(None)] * 3
    index[axis] = slice(start, None, 2)
    return tuple(index)
