"""Conduction with a correction for non-orthogonal links (`structures.partition.links`).

    heat rate into node i = sum_j G_ij (T_j - T_i - x g_ij . s_ij),

with the mean gradient g of both ends, the part s of the link along the face and the
weight x, `non_orthogonal`. One node still gains what another loses, and a uniform
temperature is still steady; but the operator is not symmetric, which linear solvers
need, and a node may get slightly hotter than its neighbours. Its modes still decay.

Source: Jasak, Error Analysis and Estimation for the Finite Volume Method, thesis,
Imperial College (1996), 3.3.1.3.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import added, device_array, product, taken
from ..structures.partition.links import NonOrthogonalLinks
from ..structures.structure import AbstractStructure
from ..structures.surface_map import Gradient, gradient_at
from .network import AbstractNodeNetwork, inverse


_KRYLOV_SIZE = 12
"""Size of the Krylov space in which the fastest rate is found."""
_MARGIN = 1.05
"""Safety factor, since Arnoldi's method converges from below."""


class _NonOrthogonalNetwork(AbstractNodeNetwork):
    """Two-point network with a correction for some of its links."""

    # The gradient at a node depends on nodes that its link does not connect.
    is_symmetric = False

    straight: AbstractNodeNetwork
    """Two-point flux, with conductances for the distances normal to the faces."""
    node_capacity: Float[Array, " n"]
    """Heat capacity of each node [J/K]."""
    gradient: Gradient
    gradient_nodes: Int[Array, " m"]
    """Nodes at which the gradient is computed."""
    first: Int[Array, " k"]
    """Index in `gradient_nodes` of the first node of each corrected link."""
    second: Int[Array, " k"]
    """Index in `gradient_nodes` of the second node of each corrected link."""
    half_offset: tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]
    """Components of s / 2 along x, y and z [m]."""
    conductance: Float[Array, " k"]
    """x G of each corrected link [W/K]."""
    rate_ratio: Float[Array, ""]
    """Bound of the fastest rate over that of the two-point flux [-]."""

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        slopes = self.gradient(state, taken(state, self.gradient_nodes))
        rise = jnp.zeros_like(self.conductance)
        for slope, half_offset in zip(slopes, self.half_offset, strict=True):
            ends = taken(slope, self.first) + taken(slope, self.second)
            rise = rise + half_offset * ends
        flow = self.conductance * rise
        inward = jnp.zeros_like(slopes[0]).at[self.second].add(flow)
        inward = inward.at[self.first].add(-flow)
        rate = self.straight.heat_rate(state)
        return added(rate, self.gradient_nodes, inward, is_sorted=True, is_unique=True)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        # Enlarged to what the stability of an explicit step needs.
        return self.straight.diagonal() * self.rate_ratio


def non_orthogonal(
    straight: AbstractNodeNetwork,
    structure: AbstractStructure,
    skewed: NonOrthogonalLinks,
    conductance: Float[Array, " k"],
) -> _NonOrthogonalNetwork:
    """Two-point network with a correction for skewed links.

    `conductance` is that of the skewed links times the weight x [W/K].
    """
    links = structure.links()
    dtype = conductance.dtype
    ends = np.concatenate([links.src[skewed.link], links.dst[skewed.link]])
    gradient_nodes, index = np.unique(ends, return_inverse=True)
    first, second = np.split(index.astype(np.int32), 2)
    x, y, z = skewed.offset.T / 2
    network = _NonOrthogonalNetwork(
        straight=straight,
        node_capacity=straight.node_capacity,
        gradient=gradient_at(structure, gradient_nodes, dtype),
        gradient_nodes=device_array(gradient_nodes.astype(np.int32)),
        first=device_array(first),
        second=device_array(second),
        half_offset=(
            device_array(x, dtype),
            device_array(y, dtype),
            device_array(z, dtype),
        ),
        conductance=conductance,
        rate_ratio=jnp.ones((), dtype),
    )
    return eqx.tree_at(lambda n: n.rate_ratio, network, _rate_ratio(network))


@eqx.filter_jit
def _rate_ratio(network: _NonOrthogonalNetwork) -> Float[Array, ""]:
    """Fastest rate over the bound of that of the two-point flux [-], at least 1."""
    # No mode of the two-point flux is faster than twice the largest ratio of summed
    # conductances to capacity.
    network = jax.lax.stop_gradient(network)
    per_capacity = inverse(network.node_capacity)
    dtype = per_capacity.dtype

    def step(j, carry):
        basis, projection = carry
        rates = per_capacity * network.heat_rate(basis[j])
        along = product(basis, rates)
        rates = rates - product(along, basis)
        growth = jnp.linalg.norm(rates)
        projection = projection.at[:, j].set(along).at[j + 1, j].set(growth)
        return basis.at[j + 1].set(rates * inverse(growth)), projection

    number = jnp.arange(len(per_capacity))
    # An aperiodic start vector excites every mode.
    start = jnp.sin(number.astype(dtype) ** 1.5)
    basis = jnp.zeros((_KRYLOV_SIZE + 1, len(number)), dtype)
    basis = basis.at[0].set(start / jnp.linalg.norm(start))
    projection = jnp.zeros((_KRYLOV_SIZE + 1, _KRYLOV_SIZE), dtype)
    _, projection = jax.lax.fori_loop(0, _KRYLOV_SIZE, step, (basis, projection))
    fastest = jnp.linalg.norm(projection[:_KRYLOV_SIZE], 2)
    bound = 2 * network.straight.max_rate()
    return jnp.maximum(1, _MARGIN * fastest * inverse(bound))
