"""The conduction operator of one body: one interface, whatever it runs as.

A state is an array of temperature differences from the body's reference [K]: one
float32 step at 300 K is 3e-5 K, which would swallow slow changes; differences do not.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


Address = tuple[Int[Array, " m"], ...]
"""Where some nodes lie in a state: `state[address]`."""


class AbstractNetwork(eqx.Module):
    """Capacities and conductances of one body.

    Conduction into node i is sum_j G_ij (T_j - T_i) [W]; G is symmetric, so what one
    node gains another loses.
    """

    @abc.abstractmethod
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""

    @abc.abstractmethod
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """The state after `dt` [s] of conduction: T + dt / C * sum_j G (T_j - T)."""

    @abc.abstractmethod
    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the conductances of each node [W/K], as a state."""

    @abc.abstractmethod
    def capacity(self) -> Float[Array, "..."]:
        """Heat capacity of each node [J/K]; one number if all have the same."""

    @abc.abstractmethod
    def largest_rate(self) -> Float[Array, ""]:
        """Largest sum of conductances over capacity of any node [1/s]."""

    @abc.abstractmethod
    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""

    @abc.abstractmethod
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature, sum of C T [J]."""


def precise_sum(values: Float[Array, "..."]) -> Float[Array, ""]:
    """Sum to about rounding error whatever the length.

    XLA adds in sequence on the CPU, which loses digits in float32 over millions of
    terms; short blocks, summed in turn, keep the error near one rounding.
    """
    flat = values.reshape(-1)
    block = 64
    while flat.shape[0] > 1:
        padded = jnp.pad(flat, (0, -flat.shape[0] % block))
        flat = padded.reshape(-1, block).sum(axis=1)
    return flat.sum()


def inverse(values: Float[Array, "..."]) -> Float[Array, "..."]:
    """1 / values, and 0 where a value is 0.

    Both branches of a where are differentiated: the divisor must never be zero.
    """
    positive = values > 0
    return jnp.where(positive, 1 / jnp.where(positive, values, 1), 0)


class AbstractNodeNetwork(AbstractNetwork):
    """An operator whose state is one value a node."""

    node_capacity: eqx.AbstractVar[Float[Array, " n"]]
    """[J/K]"""

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """T + dt / C * sum_j G (T_j - T)."""
        return state + dt * inverse(self.node_capacity) * self.heat_rate(state)

    def capacity(self) -> Float[Array, "..."]:
        """Of each node [J/K]."""
        return self.node_capacity

    def largest_rate(self) -> Float[Array, ""]:
        """Over all nodes [1/s]."""
        return (self.diagonal() * inverse(self.node_capacity)).max()

    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""
        return precise_sum(self.node_capacity)

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature [J]."""
        return precise_sum(self.node_capacity * state)
