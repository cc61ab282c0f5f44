"""Heat conduction between touching bodies, from node to node.

Every touching pair of fragments is a path of three resistances in series, half a cell
of body A, the contact, half a cell of body B:

    q = G (T_a - T_b),    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,    G_a = k_a A / d_a

h_c is 1 to 1e6 W/(m^2 K) in practice; infinity bonds the bodies and 0 insulates them,
both exactly and with finite derivatives. One body loses exactly what the other gains.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import Scalar, Time, TimeVarying, added, device_array, smooth_step
from ...errors import InputError
from ...network.network import Address, inverse, precise_sum
from ..term import AbstractPairTerm
from ..time_varying import check_value, for_jit, is_zero, largest, value_at
from .search import ContactPairs


_Rows = Float[Array | np.ndarray, "*p"]
_Pair = tuple[Float[Array, "..."], Float[Array, "..."]]
# Values of the first and of the second body.


def _contact_conductance(
    area: _Rows, half_a: _Rows, half_b: _Rows, coefficient: Scalar | _Rows
) -> _Rows:
    """Conductance G from node to node through each pair [W/K].

    The contact area [m^2] is 0 in rows that only pad an array, the half cells k A / d
    [W/K] connect the contact to the nodes, and h_c is 0 to infinity [W/(m^2 K)].
    """
    h_c = jnp.asarray(coefficient, area.dtype)
    finite = jnp.isfinite(h_c)
    # The inner `where` keeps inf * area, whose derivative is infinite, out of the
    # graph.
    between = jnp.where(finite, jnp.where(finite, h_c, 1) * area, jnp.inf)
    return _series(_series(half_a, half_b), between)


def _series(first: _Rows, second: _Rows) -> _Rows:
    # Conductance of two in series [W/K], 0 to infinity but not both infinite.
    # G = low / (1 + low / high): no product that overflows, and no 0 / 0.
    low = jnp.minimum(first, second)
    high = jnp.maximum(first, second)
    return low / (1 + low * inverse(high))


def _gap_factor(gap: _Rows, gap_length: Scalar) -> _Rows:
    """Fraction of h_c that remains across a gap [-]: 1 at contact, 0 from a length on.

    w = 1 - s^2 (3 - 2 s), s = gap / gap_length clipped to [0, 1], with a continuous
    first derivative. A model without pressure; the length represents asperities and
    waviness. Gaps [m] are negative where the bodies overlap.
    """
    s = jnp.clip(gap / jnp.asarray(gap_length, gap.dtype), 0, 1)
    return 1 - smooth_step(s)


class _ContactEnd(NamedTuple):
    """One body's side of all touching pairs."""

    address: Address
    """Position of each pair's node in the state of the body."""
    fragment: Int[Array, " p"]
    """Fragment of each pair."""
    half_cell: Float[Array, " p"]
    """Conductance from the contact to the node, k A / distance [W/K]."""
    per_capacity: Float[Array, " p"]
    """1 / C of the node [K/J]."""
    area_fraction: Float[Array, " p"]
    """Contact area over the area of the fragment [-]."""

    def spread(self, values: Float[Array, " p"], fragments: int) -> Float[Array, " s"]:
        """Sums of the values of all pairs over each fragment."""
        zero = jnp.zeros(fragments, values.dtype)
        return zero.at[self.fragment].add(values)


class ContactLinks(Module):
    """Touching pairs of fragments of two bodies; rows of area 0 pad the arrays."""

    entry: int = eqx.field(static=True)
    """Index in the energy ledger."""
    bodies: tuple[int, int] = eqx.field(static=True)
    ends: tuple[_ContactEnd, _ContactEnd]
    """Sides of the first and of the second body."""
    area: Float[Array, " p"]
    """Contact area, times the gap factor [m^2]."""
    conductance: Any
    """h_c [W/(m^2 K)], a number or a function of time."""

    @property
    def address(self) -> tuple[Address, Address]:
        """Position of each pair's nodes in the states of both bodies."""
        first, second = self.ends
        return first.address, second.address

    def _links(self, conductance) -> Float[Array, " p"]:
        first, second = self.ends
        return jnp.asarray(
            _contact_conductance(
                self.area,
                half_a=first.half_cell,
                half_b=second.half_cell,
                coefficient=conductance,
            )
        )

    def heat_rate(
        self, time: Time, theta: _Pair, references: _Pair
    ) -> Float[Array, " p"]:
        """Heat rate from the first body to the second through each pair [W].

        `theta` are temperatures of the pairs' nodes above `references` [K].
        """
        # Grouped so that small differences keep their digits in float32.
        difference = (theta[0] - theta[1]) + (references[0] - references[1])
        return self._links(value_at(self.conductance, time)) * difference

    def apply_heat(
        self, new: _Pair, theta: _Pair, references: _Pair, time: Time, dt: Time
    ) -> tuple[_Pair, Float[Array, ""]]:
        """Both states after the heat of one step, and the total heat rate [W]."""
        rate = self.heat_rate(time, theta, references)
        # The same rate for both bodies: one gains exactly what the other loses.
        a, b = self.ends
        first = added(new[0], a.address, -dt * rate * a.per_capacity)
        second = added(new[1], b.address, dt * rate * b.per_capacity)
        return (first, second), precise_sum(rate)

    def stiffness(self, end: float) -> Float[Array, " p"]:
        """Largest conductance of each pair up to `end` [s] [W/K]."""
        return self._links(largest(self.conductance, end).astype(self.area.dtype))

    def excess(
        self, rate: Float[Array, " p"], side: int, fragments: int
    ) -> Float[Array, " s"]:
        """Surface minus node temperature of the fragments of body `side` (0, 1) [K].

        `rate` is the heat rate through each pair from the first body to the second [W].
        """
        end = self.ends[side]
        sign = -1 if side == 0 else 1
        half = end.half_cell
        difference = sign * rate / jnp.where(half > 0, half, 1)
        return end.spread(difference * end.area_fraction, fragments)

    def fragment_heat(
        self, rate: Float[Array, " p"], side: int, fragments: int
    ) -> Float[Array, " s"]:
        """Heat rate into the fragments of body `side`, as `rate` in `excess` [W]."""
        return self.ends[side].spread(-rate if side == 0 else rate, fragments)


class Contact(AbstractPairTerm):
    """Heat conduction through touching surfaces of two bodies, or of all.

    q = G (T_a - T_b) [W],    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,

    with the half cells G_a = k_a A / d_a and G_b [W/K] of both bodies, from the contact
    to their nodes. No other mechanism acts on surfaces in contact. Contacts follow from
    the shapes (`jaxthermo.physics.contact.search`).

    Raises:
        InputError: for a negative conductance, or a length that is not positive.
    """

    name = "contact"

    conductance: TimeVarying
    """h_c [W/(m^2 K)], a number or a function of time; infinity bonds the bodies."""
    bodies: tuple[int, int] | None = eqx.field(static=True, default=None)
    """Numbers of the two bodies; None for any two that touch."""
    threshold: float | None = eqx.field(static=True, default=None)
    """Largest gap that counts as contact [m]; None for a voxel of the finer body."""
    gap_length: float | None = eqx.field(static=True, default=None)
    """Gap over which the conductance falls smoothly to 0 [m]; None for a constant
    conductance up to the threshold."""
    max_pairs: int | None = eqx.field(static=True, default=None)
    """Largest number of pairs of fragments; None for that of the scene."""

    def __check_init__(self):
        h_c = self.conductance
        if not isinstance(h_c, float | int) or h_c != math.inf:
            check_value(h_c, "Contact(conductance [W/(m^2 K)])", 0.0)
        lengths = {"threshold": self.threshold, "gap_length": self.gap_length}
        for name, length in lengths.items():
            if length is not None and not 0 < length < np.inf:
                raise InputError(f"Contact({name}={length!r}): give a positive length")
        if self.bodies is not None and self.bodies[0] == self.bodies[1]:
            raise InputError(f"Contact(bodies={self.bodies}): name two bodies")

    @property
    @override
    def max_gap(self) -> float | None:
        return self.threshold

    @property
    @override
    def is_idle(self) -> bool:
        return is_zero(self.conductance)

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        return () if self.bodies is None else self.bodies

    @override
    def connects(self, a: int, b: int) -> bool:
        return self.bodies is None or {a, b} == set(self.bodies)

    @override
    def bind(
        self, pairs: ContactPairs, ends: tuple[Any, Any], entry: int, size: int
    ) -> ContactLinks:
        first, second = (body.number for body in ends)
        dtype = np.dtype(ends[0].half_cell.dtype)
        # Arrays have one size in all snapshots, so that one program runs them all.
        padded = pairs.padded(self.max_pairs or size, f"bodies {first} and {second}")
        a = _end(ends[0], padded.fragment_a, area=padded.area, dtype=dtype)
        b = _end(ends[1], padded.fragment_b, area=padded.area, dtype=dtype)
        area = padded.area
        if self.gap_length is not None:
            area = area * np.asarray(_gap_factor(padded.gap, self.gap_length))
        return ContactLinks(
            entry=entry,
            bodies=(first, second),
            ends=(a, b),
            area=device_array(area, dtype),
            conductance=for_jit(self.conductance, dtype),
        )


def _end(body: Any, fragment: np.ndarray, area: np.ndarray, dtype: Any) -> _ContactEnd:
    node = body.fragment_node[fragment]
    address = body.address_of(node)
    fragment_area = body.body.structure.grid.fragment_area
    # A pair has the fraction of the half cell that is behind it.
    fraction = (area / fragment_area[fragment]).astype(dtype)
    capacity = body.network.capacity_at(address)
    if not capacity.ndim:
        capacity = jnp.broadcast_to(capacity, fraction.shape)
    return _ContactEnd(
        address=address,
        fragment=device_array(fragment),
        half_cell=device_array(body.half_cell[fragment] * fraction),
        per_capacity=1 / capacity,
        area_fraction=device_array(fraction),
    )


bonded = Contact(math.inf)
"""Contact of infinite conductance: bodies that touch conduct as one."""
