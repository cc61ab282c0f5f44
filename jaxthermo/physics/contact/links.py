"""Two bodies in contact, node to node: what one loses the other gains.

Every touching pair of fragments is a path of three resistances in series, half a cell
of the one body, the contact, half a cell of the other:

    q = G (T_a - T_b),    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b.
"""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...network.network import Address, inverse, precise_sum
from ..term import AbstractTerm, Forcing
from ..time_varying import check_value, largest, value_at


# Conductance of a contact: half a cell of either body, and what is between them.
#
#     1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,    G_a = k_a A / d_a
#
# h_c is 1 to 1e6 W/(m^2 K) in practice; infinity bonds the bodies and 0 parts them,
# both exactly. Pure functions, with finite derivatives at either end.


Rows = Float[Array | np.ndarray, "*p"]


def contact_conductance_of(
    area: Rows, half_a: Rows, half_b: Rows, coefficient: Scalar | Rows
) -> Rows:
    """Conductance from node to node through each pair [W/K].

    Args:
        area: of contact [m^2]; 0 in rows that only fill an array.
        half_a: from the contact to A's node, k A / distance [W/K].
        half_b: from the contact to B's node [W/K].
        coefficient: h_c [W/(m^2 K)], 0 to infinity: a number, or one a pair.
    """
    h_c = jnp.asarray(coefficient, area.dtype)
    finite = jnp.isfinite(h_c)
    # The derivative of inf * area would be infinite.
    between = jnp.where(finite, jnp.where(finite, h_c, 1) * area, jnp.inf)
    return series_conductance(half_a, half_b, between)


def series_conductance(first: Rows, *others: Rows) -> Rows:
    """Conductances one after the other [W/K], 0 to infinity but not all infinite.

    G = low / (1 + low / high) of two: no product to overflow, and no 0 / 0.
    """
    total = jnp.asarray(first)
    for other in others:
        low, high = jnp.minimum(total, other), jnp.maximum(total, other)
        total = low / (1 + low * inverse(high))
    return total


def half_conductance(half_cell: Rows, area: Rows, fragment_area: Rows) -> Rows:
    """The part of a fragment's half cell that lies behind a contact [W/K].

    G_half = k A / d = (k A_fragment / d) * A / A_fragment

    Args:
        half_cell: of each pair's fragment, k A_fragment / d [W/K].
        area: of contact [m^2].
        fragment_area: of each pair's fragment [m^2].
    """
    return half_cell * area * inverse(jnp.asarray(fragment_area))


def closeness(gap: Rows, gap_length: Scalar) -> Rows:
    """How much of h_c is left across a gap: 1 where surfaces touch, 0 from a length on.

    w = 1 - s^2 (3 - 2 s), s = gap / gap_length held to [0, 1]: smooth to the first
    derivative. A model without pressure; the length is that of asperities and waviness.

    Args:
        gap: between the surfaces [m], negative where they overlap.
        gap_length: where heat no longer passes [m].

    Raises:
        InputError: if the length is not positive.
    """
    if not is_traced(gap_length) and not 0 < float(gap_length) < math.inf:
        raise InputError(
            f"contact gap_length {float(gap_length)!r}: give a positive length [m]"
        )
    s = jnp.clip(gap / jnp.asarray(gap_length, gap.dtype), 0, 1)
    return 1 - s * s * (3 - 2 * s)


def coefficient_across(
    gap: Rows, coefficient: Scalar | Rows, gap_length: Scalar
) -> Rows:
    """The h_c of every pair at its gap [W/(m^2 K)].

    Args:
        gap: between the surfaces [m].
        coefficient: h_c of surfaces that touch, 0 to infinity [W/(m^2 K)].
        gap_length: as for `closeness`.

    Raises:
        InputError: if the length is not positive.
    """
    h_c = jnp.asarray(coefficient, gap.dtype)
    left = closeness(gap, gap_length)
    finite = jnp.isfinite(h_c)
    bonded = jnp.where(left > 0, jnp.asarray(jnp.inf, gap.dtype), 0)
    return jnp.where(finite, jnp.where(finite, h_c, 1) * left, bonded)


class ContactLinks(eqx.Module):
    """The touching pairs of two bodies; rows of area 0 fill the array up."""

    entry: int = eqx.field(static=True)
    """In the ledger."""
    bodies: tuple[int, int] = eqx.field(static=True)
    address: tuple[Address, Address]
    """Of each pair's nodes."""
    fragment: tuple[Int[Array, " p"], Int[Array, " p"]]
    half_cell: tuple[Float[Array, " p"], Float[Array, " p"]]
    """From the contact to the nodes [W/K]."""
    per_capacity: tuple[Float[Array, " p"], Float[Array, " p"]]
    """1 / C of the nodes [K/J]."""
    share: tuple[Float[Array, " p"], Float[Array, " p"]]
    """Of the fragments' areas."""
    area: Float[Array, " p"]
    """Of contact, as far as a gap lets heat through [m^2]."""
    conductance: Any
    """h_c [W/(m^2 K)], a number or a function of time."""

    def _links(self, conductance) -> Float[Array, " p"]:
        first, second = self.half_cell
        return jnp.asarray(
            contact_conductance_of(self.area, first, second, conductance)
        )

    def heat_rate(
        self,
        time: Float[Array, ""],
        theta: tuple[Float[Array, " p"], Float[Array, " p"]],
        references: tuple[Float[Array, ""], Float[Array, ""]],
    ) -> Float[Array, " p"]:
        """From the first body to the second through each pair [W].

        Args:
            time: [s].
            theta: of the pairs' nodes above their body's reference [K].
            references: of the bodies [K].
        """
        gap = (theta[0] - theta[1]) + (references[0] - references[1])
        return self._links(value_at(self.conductance, time)) * gap

    def apply_heat(
        self,
        new: tuple[Float[Array, "..."], Float[Array, "..."]],
        theta: tuple[Float[Array, " p"], Float[Array, " p"]],
        references: tuple[Float[Array, ""], Float[Array, ""]],
        time: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[tuple[Float[Array, "..."], Float[Array, "..."]], Float[Array, ""]]:
        """Both states with the heat of one step, and what passes in all [W]."""
        rate = self.heat_rate(time, theta, references)
        rises = (-dt * rate * self.per_capacity[0], dt * rate * self.per_capacity[1])
        first, second = (
            state.at[address].add(rise, mode="promise_in_bounds")
            for state, address, rise in zip(new, self.address, rises, strict=True)
        )
        return (first, second), precise_sum(rate)

    def stiffness(self, end: float) -> Float[Array, " p"]:
        """The largest conductance of each pair up to `end` [W/K]."""
        most = largest(self.conductance, end)
        return self._links(most.astype(self.area.dtype))

    def excess(
        self,
        rate: Float[Array, " p"],
        side: int,
        fragments: int,
    ) -> Float[Array, " s"]:
        """Of a body's surface over its nodes, where it is in contact [K].

        Args:
            rate: through each pair, from the first body to the second [W].
            side: 0 for the first body, 1 for the second.
            fragments: how many it has.
        """
        half = self.half_cell[side]
        sign = -1 if side == 0 else 1
        gap = sign * rate / jnp.where(half > 0, half, 1)
        zero = jnp.zeros(fragments, rate.dtype)
        return zero.at[self.fragment[side]].add(gap * self.share[side])


class Contact(AbstractTerm):
    """Heat through touching surfaces; of all bodies without `bodies`.

    A contact conductance of infinity bonds them. Where bodies touch no other mechanism
    acts. Contacts are found from the shapes: see `contact_search`.
    """

    conductance: Any
    """h_c [W/(m^2 K)], a number or a function of time."""
    bodies: tuple[int, int] | None = eqx.field(static=True, default=None)
    """The two that are meant; None for any two that touch."""
    threshold: float | None = eqx.field(static=True, default=None)
    """The widest gap that is contact [m]; None for a voxel of the finer body."""
    gap_length: float | None = eqx.field(static=True, default=None)
    """Over which the conductance falls smoothly to 0 as a gap opens [m]; None for the
    same conductance up to the threshold."""
    most_pairs: int | None = eqx.field(static=True, default=None)
    """Room for touching fragments; None for as many as the scene ever has."""

    def __check_init__(self):
        if not is_endless(self.conductance):
            check_value(self.conductance, "Contact(conductance [W/(m^2 K)])", 0.0)
        for name, length in (
            ("threshold", self.threshold), ("gap_length", self.gap_length)
        ):  # fmt: skip
            if length is not None and not 0 < length < np.inf:
                raise InputError(f"Contact({name}={length!r}): give a positive length")
        if self.bodies is not None and self.bodies[0] == self.bodies[1]:
            raise InputError(f"Contact(bodies={self.bodies}): name two bodies")

    @property
    def name(self) -> str:
        """In the ledger."""
        return "contact"

    @property
    def values(self) -> tuple[Any, ...]:
        """Its conductance."""
        return (self.conductance,)

    def forcing(self, end: float | int) -> Forcing:
        """Bodies drive each other to nothing that they do not have."""
        del end
        return Forcing()

    @property
    def named_bodies(self) -> tuple[int, ...]:
        """The two that it joins."""
        return () if self.bodies is None else self.bodies

    def joins(self, one: int, other: int) -> bool:
        """Whether these two bodies are meant."""
        return self.bodies is None or {one, other} == set(self.bodies)

    def through(self, gap: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """What a gap leaves of the conductance, 1 to 0; once differentiable.

        Args:
            gap: between the surfaces [m], negative where they overlap.
        """
        if self.gap_length is None:
            return np.ones_like(gap)
        return np.asarray(closeness(gap, self.gap_length))


def is_endless(conductance: Any) -> bool:
    """Whether this is the infinite conductance of a bond."""
    return isinstance(conductance, float | int) and conductance == float("inf")


bonded = Contact(float("inf"))
"""Bodies that touch conduct as one."""
