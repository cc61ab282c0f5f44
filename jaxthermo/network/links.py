"""The general operator: sorted links between any nodes. A state is one value a node."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .network import AbstractNetwork, Address, precise_sum


class LinkNetwork(AbstractNetwork):
    """Pairs of nodes with a conductance each."""

    src: Int[Array, " e"]
    """Sorted."""
    dst: Int[Array, " e"]
    conductance: Float[Array, "*e"]
    """[W/K]; one number if all links have the same."""
    node_capacity: Float[Array, " n"]
    """[J/K]"""

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]: what leaves one end enters the other."""
        flow = self.conductance * (state[self.dst] - state[self.src])
        inward = jnp.zeros_like(state).at[self.src].add(flow, indices_are_sorted=True)
        return inward.at[self.dst].add(-flow)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """T + dt / C * sum_j G (T_j - T)."""
        return state + dt / self.node_capacity * self.heat_rate(state)

    def _diagonal(self):
        each = jnp.broadcast_to(self.conductance, self.src.shape)
        total = jnp.zeros_like(self.node_capacity)
        total = total.at[self.src].add(each, indices_are_sorted=True)
        return total.at[self.dst].add(each)

    def diagonal(self, address: Address) -> Float[Array, " m"]:
        """Sum of the conductances of a node's links [W/K]."""
        return self._diagonal()[address]

    def capacity(self, address: Address) -> Float[Array, "*m"]:
        """Of each node asked for [J/K]."""
        return self.node_capacity[address]

    def largest_rate(self) -> Float[Array, ""]:
        """Over all nodes [1/s]."""
        return (self._diagonal() / self.node_capacity).max()

    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""
        return precise_sum(self.node_capacity)

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature [J]."""
        return precise_sum(self.node_capacity * state)
