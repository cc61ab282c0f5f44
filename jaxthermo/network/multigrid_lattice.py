"""Coarser levels of a dense lattice: blocks of 2 x 2 x 2 cells, again and again.

A block conducts to the next through the faces they share. Their centres are twice as
far apart, so it does so half as well as those faces together: summed alone, as the
transfers have it, coarse levels would be twice too stiff and correct half of the error.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .multigrid_cycle import AbstractTransfer
from .network import AbstractNetwork
from .stencil import AxisStencil, LatticeStencil, UniformStencil


Faces = tuple[Array, Array, Array]


class LatticeTransfer(AbstractTransfer):
    """Between a lattice and that of its blocks, each with one empty cell all round."""

    shape: tuple[int, ...] = eqx.field(static=True)
    """Of the fine lattice, in cells."""

    def total(self, fine: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each block the sum over its cells."""
        values = fine[1:-1, 1:-1, 1:-1]
        for axis in range(3):
            values = _pair_sum(values, axis)
        return jnp.pad(values, 1)

    def spread(self, coarse: Float[Array, "..."]) -> Float[Array, "..."]:
        """For each cell the value of its block, empty cells included."""
        # A loop makes it an array: XLA would smooth anew for each of the eight cells.
        along_z = lambda plane: jnp.repeat(plane, 2, axis=1)
        values = jax.lax.map(along_z, coarse[1:-1, 1:-1, 1:-1])
        for axis in range(2):
            values = jnp.repeat(values, 2, axis=axis)
        x, y, z = self.shape
        return jnp.pad(values[:x, :y, :z], 1)


def lattice_levels(
    network: AbstractNetwork, most: int
) -> tuple[tuple[AbstractNetwork, ...], tuple[LatticeTransfer, ...]]:
    """The network and ever coarser ones, with the transfers between them.

    Args:
        network: a stencil.
        most: values in a state of the coarsest one.
    """
    networks, transfers = [network], []
    shape = tuple(n - 2 for n in jax.eval_shape(network.diagonal).shape)
    while math.prod(n + 2 for n in shape) > most:
        transfers.append(LatticeTransfer(shape))
        faces = _block_faces(networks[-1])
        shape = tuple(-(-n // 2) for n in shape)
        # Conduction alone is asked of it: what blocks hold is in m.
        networks.append(LatticeStencil(faces, jnp.zeros(shape, faces[0].dtype)))
    return tuple(networks), tuple(transfers)


def _block_faces(network: AbstractNetwork) -> Faces:
    """Conductance of the faces of the blocks of a stencil [W/K]."""
    faces = []
    for axis in range(3):
        values = _even_faces(network, axis)
        for other in {0, 1, 2} - {axis}:
            values = _pair_sum(values, other)
        faces.append(values)
    x, y, z = faces
    if isinstance(network, UniformStencil | AxisStencil):
        # Open faces were counted so far.
        g = jnp.broadcast_to(network.conductance, (3,))
        x, y, z = (n.astype(g.dtype) * g[axis] for axis, n in enumerate(faces))
    return x / 2, y / 2, z / 2


def _even_faces(network: AbstractNetwork, axis: int) -> Array:
    """Every other face across an axis: those between blocks, not those inside them."""
    if isinstance(network, LatticeStencil):
        face = network.face_conductance[axis]
        face = _padded(face, axis, 0, (face.shape[axis] + 1) % 2)
        return face[_every_other(axis, 0)]
    if isinstance(network, UniformStencil):
        linked = network.degree > 0
    elif isinstance(network, AxisStencil):
        linked = network.degrees > 0
    else:
        raise TypeError(f"no lattice levels of a {type(network).__name__}")
    # Two neighbours that have any links are linked to each other.
    linked = _padded(linked, axis, 1, 1 + linked.shape[axis] % 2)
    both = linked[_every_other(axis, 0)] & linked[_every_other(axis, 1)]
    return both.astype(jnp.uint8)


def _pair_sum(values: Array, axis: int) -> Array:
    """Of the first and second entry along an axis, of the third and fourth, ..."""
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
