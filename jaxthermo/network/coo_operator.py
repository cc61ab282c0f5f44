"""The general operator, as it is read: a list of pairs with a conductance each.

The tested reference of `rows`, which does the same several times faster. A state is one
value a node.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .network import AbstractNodeNetwork


class LinkNetwork(AbstractNodeNetwork):
    """Pairs of nodes with a conductance each."""

    src: Int[Array, " e"]
    """Sorted."""
    dst: Int[Array, " e"]
    conductance: Float[Array, " e"]
    """[W/K]"""
    node_capacity: Float[Array, " n"]
    """[J/K]"""

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]: what leaves one end enters the other."""
        flow = self.conductance * (state[self.dst] - state[self.src])
        inward = jnp.zeros_like(state).at[self.src].add(flow, indices_are_sorted=True)
        return inward.at[self.dst].add(-flow)

    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the conductances of each node's links [W/K]."""
        total = jnp.zeros_like(self.node_capacity)
        total = total.at[self.src].add(self.conductance, indices_are_sorted=True)
        return total.at[self.dst].add(self.conductance)
