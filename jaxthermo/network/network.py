"""The conduction operator of one body: one interface, whatever it runs as.

A state is an array of temperature differences from the body's reference [K]: one
float32 step at 300 K is 3e-5 K, which would swallow slow changes; differences do not.
Where the specific heat varies with temperature it is instead the heat that each node
holds above the reference, over its capacity there: still in kelvin, and the heat stored
is sum C state for every network.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


Address = tuple[Int[Array, " m"], ...]
"""Where some nodes lie in a state: `state[address]`."""


class AbstractNetwork(eqx.Module):
    """Capacities and conductances of one body.

    Conduction into node i is sum_j G_ij (T_j - T_i) [W]; what one node gains another
    loses. G is symmetric, unless the network says that it is not.
    """

    @property
    def linear(self) -> "AbstractNetwork":
        """What conducts what drives conduction: itself, or as at the reference."""
        return self

    @property
    def symmetric(self) -> bool:
        """Whether G is: solves need it."""
        return True

    @abc.abstractmethod
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""

    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """The same of differences over faces: 0 where all neighbours are equally warm.

        A long step multiplies what rounding leaves of a stencil, and a body that hardly
        sheds heat turns it into kelvins. Other networks take differences anyway.
        """
        return self.heat_rate(state)

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

    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        """Of some nodes [J/K]; one number if all have the same."""
        capacity = self.capacity()
        return capacity[address] if capacity.ndim else capacity

    def temperature(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Above the reference [K], of a state or of any part of one."""
        return state

    def state_of(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """The state of nodes at temperatures above the reference [K]."""
        return theta

    def relative_conductivity(self, theta: Float[Array, "*m"]) -> Float[Array, "*#m"]:
        """k(T) / k(reference) at temperatures above the reference [-]."""
        return jnp.ones((), theta.dtype)

    def largest_relative_conductivity(self) -> Float[Array, ""]:
        """At any temperature [-]."""
        return jnp.ones((), self.total_capacity().dtype)

    def least_relative_capacity(self) -> Float[Array, ""]:
        """The smallest c(T) / c(reference) at any temperature [-].

        Its inverse is the most that a temperature moves for a change of the state.
        """
        return jnp.ones((), self.total_capacity().dtype)

    def largest_relative_diffusivity(self) -> Float[Array, ""]:
        """The largest k / c over that at the reference, at any temperature [-]."""
        return jnp.ones((), self.total_capacity().dtype)


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


def slot_sums(
    values: Float[Array, " p"], slots: tuple[Int[Array, " m"], ...]
) -> Float[Array, " m"]:
    """For each of m the sum of its values: the k-th, if there is one, at `slots[k]`.

    Several times faster than adding to it in turn.
    """
    gather = lambda slot: values.at[slot].get(mode="fill", fill_value=0)
    return sum((gather(slot) for slot in slots[1:]), gather(slots[0]))


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
