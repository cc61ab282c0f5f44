"""Conduction operator of one body: the interface of stencils and links.

A state is an array of temperature differences from the body's reference [K]: at 300 K
the resolution of float32 is 3e-5 K, in which slow changes would be lost; differences
resolve them. Where the specific heat varies with temperature, the state is instead the
heat of each node above the reference, over its capacity there: still in kelvin, and the
stored heat is sum C state for every network.
"""

import abc
from collections.abc import Callable
from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int
from typing_extensions import override

from .columns import Columns


Address = tuple[Int[Array, " m"], ...]
"""Indices of some nodes in a state: `state[address]`."""


class StepStart(NamedTuple):
    """State at the start of a step in stages, and its conduction."""

    state: Float[Array, "..."]
    rise: Float[Array, "..."]
    """Rise of the state by the conduction of an Euler step, `euler_rise`."""


class AbstractNetwork(Module):
    """Capacities and conductances of one body.

    Conduction into node i is sum_j G_ij (T_j - T_i) [W]; one node gains exactly what
    another loses. G is symmetric, except where `is_symmetric` is False.
    """

    is_symmetric: ClassVar[bool] = True
    """True if G is symmetric, which linear solvers need."""
    is_linear: ClassVar[bool] = True
    """True if no property depends on the temperature."""

    @property
    def mesh(self) -> Mesh | None:
        """Devices that a state is spread over; None where it is on one."""
        return None

    @property
    def columns(self) -> Columns | None:
        """Chains of nodes that explicit steps eliminate; None for none."""
        return None

    @property
    def linear(self) -> "AbstractNetwork":
        """Linear network of the conducted potential, at the reference."""
        return self

    def linearized(
        self, state: Float[Array, "..."]
    ) -> "tuple[AbstractNetwork, Float[Array, '...'] | None]":
        """Jacobian of `heat_rate` at a state, for changes u of a potential [W/K].

        With the slope d = du / d(state) [-], None for 1; near G at the reference.
        """
        return self.linear, None

    def moved(
        self,
        state: Float[Array, "..."],
        potential: Float[Array, "..."],
        rate: Float[Array, ""],
    ) -> Float[Array, "..."]:
        """State after a step of Newton's method by a change u of the potential [K].

        A node of capacity C and conductances G in a stage of rate 1 / g [1/s] changes
        by so much that C / g d(state) + G d(potential) is what the step predicts,
        (C / (g d) + G) u, with the slope d of `linearized`.
        """
        return state + potential

    @abc.abstractmethod
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""

    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction from differences over faces [W]: 0 between equal temperatures."""
        # A long step multiplies the rounding error of a stencil, up to kelvins in a
        # body that loses little heat. Other networks use differences anyway.
        return self.heat_rate(state)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """The state after `dt` [s] of conduction: T + dt / C * sum_j G (T_j - T)."""
        return state + dt * inverse(self.capacity()) * self.heat_rate(state)

    def euler_rise(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """Rise of the state in `dt` [s] of conduction: dt / C * sum_j G (T_j - T)."""
        return dt * inverse(self.capacity()) * self.face_heat_rate(state)

    def stepped_change(
        self, change: Float[Array, "..."], start: "StepStart", dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """Change after a step of the conduction that it adds to that of the start.

        change + euler_rise(start + change, dt) - start.rise
        """
        # A change that is far smaller than the state is conducted without its rounding.
        return self.euler_step(change, dt)

    def combined_step(
        self,
        change: Float[Array, "..."],
        start: "StepStart",
        dt: Float[Array, ""],
        combine: Callable[..., Float[Array, "..."]],
        *fields: Float[Array, "..."],
    ) -> Float[Array, "..."]:
        """combine(stepped_change(change, start, dt), start.rise, *fields), pointwise.

        The fields are states and numbers. Step and combination are one pass over the
        nodes, on several devices too, and the result may overwrite the first field.
        """
        stepped = self.stepped_change(change, start, dt)
        return combine(stepped, start.rise, *fields)

    @abc.abstractmethod
    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the conductances of each node [W/K], as a state."""

    def explicit_diagonal(self) -> Float[Array, "..."]:
        """The sum without the links of `columns` [W/K], as a state."""
        return self.diagonal()

    @abc.abstractmethod
    def capacity(self) -> Float[Array, "..."]:
        """Heat capacity of each node [J/K]; one number if all have the same."""

    def max_rate(self) -> Float[Array, ""]:
        """Largest ratio of summed conductances to capacity of any node [1/s].

        Conductances are those outside `columns`, which bound the explicit step.
        """
        return (self.diagonal() * inverse(self.capacity())).max()

    @abc.abstractmethod
    def total_capacity(self) -> Float[Array, ""]:
        """Heat capacity of the body [J/K]."""

    @abc.abstractmethod
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature, sum of C T [J]."""

    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        """Heat capacity of some nodes [J/K]; one number if all have the same."""
        capacity = self.capacity()
        return _gathered(capacity, address) if capacity.ndim else capacity

    def temperature(
        self, state: Float[Array, "*m"], address: Address | None = None
    ) -> Float[Array, "*m"]:
        """Temperature above the reference [K] of a state.

        If the values are those of some nodes only, `address` says which.
        """
        return state

    def state_of(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """State of nodes at temperatures above the reference [K]."""
        return theta

    def relative_conductivity(
        self, theta: Float[Array, "*m"], fractions: Float[Array, "q m"] | None = None
    ) -> Float[Array, "*#m"]:
        """k(T) / k(reference) at temperatures above the reference [-].

        `fractions` are the fractions of the conductivity at the reference that each
        material, or each axis, contributes.
        """
        return jnp.ones((), theta.dtype)

    @property
    def conductivity_varies(self) -> bool:
        """True if the conductivity depends on the temperature."""
        return False

    def mean_relative_conductivity(
        self,
        first: Float[Array, "*m"],
        second: Float[Array, "*m"],
        fractions: Float[Array, "q m"] | None = None,
    ) -> Float[Array, "*#m"]:
        """Mean of k(T) / k(reference) between two temperatures [-].

        Both are above the reference [K]; `fractions` as in `relative_conductivity`.
        """
        return jnp.ones((), first.dtype)

    def max_relative_conductivity(self) -> Float[Array, ""]:
        """Largest k(T) / k(reference) at any temperature [-]."""
        return jnp.ones((), self.total_capacity().dtype)

    def min_relative_conductivity(self) -> Float[Array, ""]:
        """Smallest k(T) / k(reference) of any material at any temperature [-]."""
        return jnp.ones((), self.total_capacity().dtype)

    def min_relative_capacity(self) -> Float[Array, ""]:
        """Smallest c(T) / c(reference) at any temperature [-].

        Its inverse bounds the change of a temperature for a change of the state.
        """
        return jnp.ones((), self.total_capacity().dtype)


@partial(jax.jit, inline=True)
def _gathered(values: Float[Array, "..."], address: Address) -> Float[Array, "*m"]:
    return values[address]


def listed_or_default(
    index: Int[Array, " m"],
    listed: Int[Array, " p"],
    values: Float[Array, " p"],
    default: Float[Array | float, "*#m"],
) -> Float[Array, " m"]:
    """Values of an increasing list of indices at some of them, else a default."""
    # Searched: an array of all indices would be as large as a state.
    slot = jnp.searchsorted(listed, index).clip(max=len(listed) - 1)
    return jnp.where(listed[slot] == index, values[slot], default)


@partial(jax.jit, inline=True)
def precise_sum(values: Float[Array, "..."]) -> Float[Array, ""]:
    """Sum with about one rounding error, whatever the length."""
    # XLA adds in sequence on the CPU, which loses digits in float32 over millions of
    # terms; sums of short blocks, summed again in blocks, do not.
    flat = values.reshape(-1)
    block = 64
    # The remainder is summed separately: padding would add a selection per value,
    # which costs more than its addition.
    block_end = flat.shape[0] // block * block
    remainder = flat[block_end:].sum()
    sums = flat[:block_end].reshape(-1, block).sum(axis=1)
    while sums.shape[0] > 1:
        # Padded also where blocks are whole: XLA makes one sequence of sums of sums.
        padded = jnp.pad(sums, (0, block - sums.shape[0] % block))
        sums = padded.reshape(-1, block).sum(axis=1)
    return sums.sum() + remainder


def slot_sums(
    values: Float[Array, " p"], slots: tuple[Int[Array, " m"], ...]
) -> Float[Array, " m"]:
    """Sums of the values at `slots[0]`, `slots[1]`, ...; indices past the end add 0."""

    # Gathers run faster than a scatter-add.
    def gather(slot):
        return values.at[slot].get(
            mode="fill", fill_value=0, wrap_negative_indices=False
        )

    return sum((gather(slot) for slot in slots[1:]), gather(slots[0]))


# One program instead of one per operation where a network is assembled.
@partial(jax.jit, inline=True)
def inverse(values: Float[Array, "..."]) -> Float[Array, "..."]:
    """1 / values, and 0 where a value is 0."""
    positive = values > 0
    # Both branches of a `where` are differentiated: the divisor must never be zero.
    return jnp.where(positive, 1 / jnp.where(positive, values, 1), 0)


class AbstractNodeNetwork(AbstractNetwork):
    """Network with one value for each node in its state."""

    node_capacity: eqx.AbstractVar[Float[Array, " n"]]
    """Heat capacity of each node [J/K]."""

    @override
    def capacity(self) -> Float[Array, "..."]:
        return self.node_capacity

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return precise_sum(self.node_capacity)

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        return precise_sum(self.node_capacity * state)


class AbstractDerivedNetwork(AbstractNetwork):
    """Network built on a linear one with the same capacities."""

    base: eqx.AbstractVar[AbstractNetwork]
    """The linear network, whose diagonal bounds or preconditions this one."""

    @property
    @override
    def mesh(self) -> Mesh | None:
        return self.base.mesh

    @property
    @override
    def columns(self) -> Columns | None:
        return self.base.columns

    @override
    def diagonal(self) -> Float[Array, "..."]:
        return self.base.diagonal()

    @override
    def explicit_diagonal(self) -> Float[Array, "..."]:
        return self.base.explicit_diagonal()

    @override
    def capacity(self) -> Float[Array, "..."]:
        return self.base.capacity()

    @override
    def total_capacity(self) -> Float[Array, ""]:
        return self.base.total_capacity()

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        return self.base.stored(state)
