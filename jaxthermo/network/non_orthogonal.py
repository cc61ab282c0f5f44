"""Conduction with what passes along faces taken off (`structures.build.links`).

Into node i flows sum_j G_ij (T_j - T_i - x g_ij . s_ij), g the mean of the gradients at
the two ends and x the weight `non_orthogonal`. What one node gains another still loses,
and a uniform temperature still rests; but the operator is no longer symmetric, which
solves need, and a node may get a little hotter than its neighbours. Its modes still
decay.

Source: Jasak, Error Analysis and Estimation for the Finite Volume Method, thesis,
Imperial College (1996), 3.3.1.3.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..structures.build.links import NonOrthogonalLinks
from ..structures.structure import AbstractStructure
from ..structures.surface.surface_map import Gradient, gradient_at
from .network import AbstractNodeNetwork, inverse


POWER_STEPS, LAST, MARGIN = 40, 8, 1.05
"""Of the power method, those at its end whose largest growth counts, and what is added:
it comes from below."""


class NonOrthogonalNetwork(AbstractNodeNetwork):
    """A two-point network with a correction of some of its links."""

    straight: AbstractNodeNetwork
    """The two-point flux, with conductances over the distances across."""
    node_capacity: Float[Array, " n"]
    """[J/K]"""
    gradient: Gradient
    chosen: Int[Array, " m"]
    """Nodes that have the gradient."""
    first: Int[Array, " k"]
    """Of each corrected link, the place of its `src` among them."""
    second: Int[Array, " k"]
    apart: tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]
    """Half of s, x, y and z [m]."""
    conductance: Float[Array, " k"]
    """x G [W/K]"""
    rate_ratio: Float[Array, ""]
    """Of the bound of the fastest rate, over that of the two-point flux."""

    @property
    def symmetric(self) -> bool:
        """No: the gradient at a node takes from nodes that its link does not join."""
        return False

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        read = lambda values, index: values.at[index].get(mode="promise_in_bounds")
        slopes = self.gradient(state, read(state, self.chosen))
        along = jnp.zeros_like(self.conductance)
        for slope, half in zip(slopes, self.apart, strict=True):
            along = along + half * (read(slope, self.first) + read(slope, self.second))
        flow = self.conductance * along
        inward = jnp.zeros_like(slopes[0]).at[self.second].add(flow)
        inward = inward.at[self.first].add(-flow)
        return (
            self.straight.heat_rate(state)
            .at[self.chosen]
            .add(
                inward,
                mode="promise_in_bounds",
                indices_are_sorted=True,
                unique_indices=True,
            )
        )

    def diagonal(self) -> Float[Array, "..."]:
        """Sums of the two-point conductances, as large as an explicit step needs."""
        return self.straight.diagonal() * self.rate_ratio


def non_orthogonal(
    straight: AbstractNodeNetwork,
    structure: AbstractStructure,
    skewed: NonOrthogonalLinks,
    conductance: Float[Array, " k"],
) -> NonOrthogonalNetwork:
    """The network of a structure with some of its links corrected.

    Args:
        straight: the two-point flux.
        structure: nodes and links.
        skewed: which are corrected.
        conductance: of those, times the weight [W/K].
    """
    links, dtype = structure.links(), conductance.dtype
    ends = links.src[skewed.link], links.dst[skewed.link]
    chosen, place = np.unique(np.concatenate(ends), return_inverse=True)
    first, second = (jnp.asarray(each) for each in np.split(place.astype(np.int32), 2))
    x, y, z = (jnp.asarray(half, dtype) for half in skewed.offset.T / 2)
    network = NonOrthogonalNetwork(
        straight=straight,
        node_capacity=straight.node_capacity,
        gradient=gradient_at(structure, chosen, dtype),
        chosen=jnp.asarray(chosen.astype(np.int32)),
        first=first,
        second=second,
        apart=(x, y, z),
        conductance=conductance,
        rate_ratio=jnp.ones((), dtype),
    )
    return eqx.tree_at(lambda n: n.rate_ratio, network, _rate_ratio(network))


@eqx.filter_jit
def _rate_ratio(network: NonOrthogonalNetwork) -> Float[Array, ""]:
    """How much faster its fastest mode is than any of the two-point flux can be.

    No mode of those is faster than twice the largest sum of conductances over capacity.
    """
    network = jax.lax.stop_gradient(network)
    ease = inverse(network.node_capacity)

    def step(i, carry):
        state, largest = carry
        rates = ease * network.heat_rate(state)
        growth = jnp.linalg.norm(rates)
        largest = jnp.where(i < POWER_STEPS - LAST, 0, jnp.maximum(largest, growth))
        return rates * inverse(growth), largest

    number = jnp.arange(len(ease))
    # Signs that no pattern of the nodes shares.
    start = jnp.sin(number.astype(ease.dtype) ** 1.5)
    start = start / jnp.linalg.norm(start)
    zero = jnp.zeros((), ease.dtype)
    fastest = jax.lax.fori_loop(0, POWER_STEPS, step, (start, zero))[1]
    bound = 2 * network.straight.largest_rate()
    return jnp.maximum(1, MARGIN * fastest * inverse(bound))
