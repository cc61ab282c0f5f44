"""Heat conduction between touching bodies, from node to node.

Every touching pair of fragments is a path of three resistances in series, half a cell
of body A, the contact, half a cell of body B:

    q = G (T_a - T_b),    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,    G_a = k_a A / d_a

h_c is 1 to 1e6 W/(m^2 K) in practice; infinity bonds the bodies and 0 insulates them,
both exactly and with finite derivatives. One body loses exactly what the other gains.

Where k depends on temperature the half cells conduct by its integral F, see
`half_cells`. With the temperatures T_1 and T_2 of both faces

    q = G_a (F_a(T_a) - F_a(T_1)) = h_c A (T_1 - T_2) = G_b (F_b(T_2) - F_b(T_b)),

G_a and G_b at the reference. Of these T_1 is found as the zero of an increasing
function, and the rest follows.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ...arrays import (
    Scalar,
    Time,
    TimeVarying,
    added,
    device_array,
    smooth_step,
    stop_gradient,
)
from ...network.increasing_root import Balance, increasing_root
from ...network.network import Address, inverse, precise_sum
from ...network.segment_sums import SegmentSums, sums_of_sizes
from ..half_cells import Extremes, VaryingHalfCells
from ..time_varying import for_jit, largest, value_at
from .joint import AbstractJoint, BodyNumbers
from .rays import PlacedGrid
from .search import ContactPairs, Joint, contacts_between


_Rows = Float[Array | np.ndarray, "*p"]
_Pair = tuple[Float[Array, "..."], Float[Array, "..."]]
# Values of the first and of the second body.
_Ratio = Float[Array, "*#p"]


class PairNodes(NamedTuple):
    """The nodes of every pair, and their half cells."""

    theta: _Pair
    """Temperatures of the nodes of both bodies above their references [K]."""
    references: tuple[Float[Array, "*#p"], Float[Array, "*#p"]]
    """Reference temperatures of both bodies [K], one number or one for each pair."""
    varying: tuple[VaryingHalfCells, VaryingHalfCells] | None = None
    """k(T) / k(reference) of both half cells; None where both are constant."""

    @property
    def difference(self) -> Float[Array, " p"]:
        """Temperature of the first body above that of the second [K]."""
        # Grouped so that small differences keep their digits in float32.
        first, second = self.references
        return (self.theta[0] - self.theta[1]) + (first - second)

    def at(self, excess: _Pair) -> _Pair:
        """K / k(reference) at temperatures above those of the nodes [-]."""
        assert self.varying is not None
        first, second = (
            cells.at(node + side_excess)
            for cells, node, side_excess in zip(
                self.varying, self.theta, excess, strict=True
            )
        )
        return first, second


class _PairHeat(NamedTuple):
    """Heat conduction through every pair."""

    rate: Float[Array, " p"]
    """From the first body to the second [W]."""
    excess: _Pair
    """Temperatures of the faces of both bodies above their nodes [K]."""


def _contact_conductance(
    area: _Rows, half_a: _Rows, half_b: _Rows, coefficient: Scalar | _Rows
) -> _Rows:
    """Conductance G from node to node through each pair [W/K].

    The contact area [m^2] is 0 in rows that only pad an array, the half cells k A / d
    [W/K] connect the contact to the nodes, and h_c is 0 to infinity [W/(m^2 K)].
    """
    return _series(_series(half_a, half_b), _gap_conductance(area, coefficient))


def _gap_conductance(area: _Rows, coefficient: Scalar | _Rows) -> _Rows:
    """Conductance h_c A of the contact itself [W/K], 0 to infinity."""
    h_c = jnp.asarray(coefficient, area.dtype)
    finite = jnp.isfinite(h_c)
    # The inner `where` keeps inf * area, whose derivative is infinite, out of the
    # graph.
    return jnp.where(finite, jnp.where(finite, h_c, 1) * area, jnp.inf)


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


class ContactEnd(NamedTuple):
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
    conductivity_parts: Float[Array, "q p"] | None
    """Fractions of each pair's conductivity by material and axis, where one of several
    varies with temperature."""

    def spread(self, values: Float[Array, " p"], fragments: int) -> Float[Array, " s"]:
        """Sums of the values of all pairs over each fragment."""
        zero = jnp.zeros(fragments, values.dtype)
        return zero.at[self.fragment].add(values)


class _Tangent(NamedTuple):
    """Links of constant k near the solution for a k that varies.

    q = G (T_a - T_b + o_a - o_b),    dq = G (r_a dT_a - r_b dT_b).
    """

    links: "ContactLinks"
    """With the conductivities at both faces; G are their conductances [W/K]."""
    offset: _Pair
    """o = (T_face - T) (1 - mean k / k(face)), with the mean from node to face [K]."""
    ratio: _Pair
    """r = k(T) / k(face) [-]."""


class ContactLinks(Module):
    """Touching pairs of fragments of two bodies; rows of area 0 pad the arrays.

    Or of two groups of bodies, which may be the same one.
    """

    entries: tuple[int, ...] = eqx.field(static=True)
    """Index in the energy ledger, of each pair of bodies."""
    pair_sums: SegmentSums | None
    """Sums over the pairs of fragments of each pair of bodies; None for one pair."""
    bodies: tuple[int, int] = eqx.field(static=True)
    """Numbers of both bodies, or groups, in the program."""
    ends: tuple[ContactEnd, ContactEnd]
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

    def scaled(self, relative: tuple[_Ratio, _Ratio]) -> "ContactLinks":
        """Links with the half cells of both bodies multiplied by ratios [-]."""
        ends = [
            end._replace(half_cell=end.half_cell * ratio)
            for end, ratio in zip(self.ends, relative, strict=True)
        ]
        return replace(self, ends=tuple(ends))

    def heat(self, time: Time, nodes: PairNodes) -> _PairHeat:
        """Heat conduction through each pair, with the conductance at a time [s]."""
        if nodes.varying is None:
            return self._through(time, nodes.difference)
        # Newton's step from the faces carries the derivative of the solution.
        linear, (first, second), _ = self.tangent(time, nodes)
        heat = linear._through(time, nodes.difference + (first - second))
        return _PairHeat(heat.rate, (first + heat.excess[0], second + heat.excess[1]))

    def _through(self, time: Time, difference: Float[Array, " p"]) -> _PairHeat:
        rate = self._links(value_at(self.conductance, time)) * difference
        half_a, half_b = (jnp.asarray(end.half_cell) for end in self.ends)
        first = -rate / jnp.where(half_a > 0, half_a, 1)
        second = rate / jnp.where(half_b > 0, half_b, 1)
        return _PairHeat(rate, (first, second))

    def tangent(self, time: Time, nodes: PairNodes) -> _Tangent:
        """Linear links near the solution, where a conductivity varies."""
        assert nodes.varying is not None
        excess = self._face_excess(time, nodes)
        faces = nodes.at(excess)
        offsets = []
        ratios = []
        for cells, node, side_excess, face in zip(
            nodes.varying, nodes.theta, excess, faces, strict=True
        ):
            mean = cells.mean(node, node + side_excess)
            offsets.append(side_excess * (1 - mean / face))
            ratios.append(cells.at(node) / face)
        return _Tangent(
            self.scaled(faces), (offsets[0], offsets[1]), (ratios[0], ratios[1])
        )

    def _face_excess(self, time: Time, nodes: PairNodes) -> _Pair:
        """Temperatures of both faces above their nodes [K], without a derivative."""
        links, fixed, at = stop_gradient((self, nodes, time))
        between = _gap_conductance(links.area, value_at(links.conductance, at))
        # An insulating contact has no drop in either half cell.
        drop = jnp.where(between > 0, fixed.difference, 0)
        half_a, half_b = (end.half_cell for end in links.ends)
        theta_a, theta_b = fixed.theta
        cells_a, cells_b = fixed.varying

        def rate_and_second(first: Float[Array, " p"]) -> _Pair:
            rate = -half_a * cells_a.mean(theta_a, theta_a + first) * first
            return rate, drop + first - rate * inverse(between)

        def balance(first: Float[Array, " p"]) -> Balance:
            rate, second = rate_and_second(first)
            received = half_b * cells_b.mean(theta_b, theta_b + second) * second
            at_a, at_b = fixed.at((first, second))
            steeper = 1 + half_a * at_a * inverse(between)
            slope = half_a * at_a + half_b * at_b * steeper
            return Balance(received - rate, slope)

        # No face is beyond either node.
        linear = links.scaled(fixed.at((0 * drop, 0 * drop)))
        first = increasing_root(
            balance,
            start=linear._through(at, drop).excess[0],
            low=jnp.minimum(-drop, 0),
            high=jnp.maximum(-drop, 0),
        )
        return first, rate_and_second(first)[1]

    def apply_heat(
        self, side: int, new: Float[Array, "..."], rate: Float[Array, " p"], dt: Time
    ) -> Float[Array, "..."]:
        """State of body `side` (0, 1) after the heat of one step."""
        # The same rate for both bodies: one gains exactly what the other loses.
        end = self.ends[side]
        gained = -rate if side == 0 else rate
        return added(new, end.address, dt * gained * end.per_capacity)

    def sums(self, rate: Float[Array, " p"]) -> Float[Array, " c"]:
        """Total heat rate of each entry [W]."""
        return (
            precise_sum(rate)[None] if self.pair_sums is None else self.pair_sums(rate)
        )

    def stiffness(
        self, side: int, end: float, relative: tuple[Extremes, Extremes]
    ) -> Float[Array, " p"]:
        """Largest -d(heat rate)/dT of the nodes of body `side` up to `end` [s] [W/K].

        `relative` are the extremes of k(T) / k(reference) of both bodies [-].
        """
        # G r of `_Tangent` is largest for the highest k at the node, the lowest at its
        # face, and the highest beyond it.
        lowest, highest = relative[side]
        first = relative[0].highest if side else lowest
        second = lowest if side else relative[1].highest
        h_c = largest(self.conductance, end).astype(self.area.dtype)
        return highest / lowest * self.scaled((first, second))._links(h_c)

    def fragment_excess(
        self, excess: _Pair, side: int, fragments: int
    ) -> Float[Array, " s"]:
        """Surface minus node temperature of the fragments of body `side` (0, 1) [K].

        `excess` is that of `_PairHeat`.
        """
        end = self.ends[side]
        return end.spread(excess[side] * end.area_fraction, fragments)

    def fragment_heat(
        self, rate: Float[Array, " p"], side: int, fragments: int
    ) -> Float[Array, " s"]:
        """Heat rate into the fragments of body `side`, from `_PairHeat.rate` [W].

        Heat through the border of a sheet goes through no fragment.
        """
        end = self.ends[side]
        through = jnp.where(end.area_fraction > 0, rate, 0)
        return end.spread(-through if side == 0 else through, fragments)


class Contact(AbstractJoint):
    """Heat conduction through touching surfaces of two bodies, or of all.

    q = G (T_a - T_b) [W],    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,

    with the half cells G_a = k_a A / d_a and G_b [W/K] of both bodies, from the contact
    to their nodes; a k that depends on temperature is integrated over them. No other
    mechanism acts on surfaces in contact. Contacts follow from the shapes
    (`jaxthermo.physics.contact.search`). Of several contacts of two bodies the first in
    the scene counts.

    Raises:
        InputError: for a negative conductance, or a length that is not positive.
    """

    name = "contact"

    conductance: TimeVarying
    """h_c [W/(m^2 K)], a number or a function of time; infinity bonds the bodies."""
    bodies: tuple[BodyNumbers, BodyNumbers] | None = eqx.field(
        static=True, default=None
    )
    """Numbers or names of the two bodies, or of the bodies of two groups; None for any
    two that touch."""
    threshold: float | None = eqx.field(static=True, default=None)
    """Largest gap that counts as contact [m]; None for a voxel of the finer body, and
    between two sheets for a tenth of a cell."""
    gap_length: float | None = eqx.field(static=True, default=None)
    """Gap over which the conductance falls smoothly to 0 [m]; None for a constant
    conductance up to the threshold."""
    max_pairs: int | None = eqx.field(static=True, default=None)
    """Largest number of pairs of fragments; None for that of the scene."""

    def __check_init__(self):
        lengths = {"threshold": self.threshold, "gap_length": self.gap_length}
        self.check_joint(lengths)

    @override
    def touching(
        self, bodies: tuple[PlacedGrid, ...]
    ) -> dict[tuple[int, int], ContactPairs]:
        return contacts_between(bodies, self.max_gap)

    @override
    def bind(self, joints: Sequence[Joint], ends: tuple[Any, Any]) -> ContactLinks:
        dtype = np.dtype(ends[0].half_cell.dtype)
        # Arrays have one size in all snapshots, so that one program runs them all.
        parts = [
            (joint.pairs or ContactPairs.none(0, 0)).padded(
                self.max_pairs or joint.size, joint.name
            )
            for joint in joints
        ]
        padded = ContactPairs.joined(parts)
        sizes = [len(part.area) for part in parts]
        a = _end(ends[0], padded.fragment_a, area=padded.area, dtype=dtype)
        b = _end(ends[1], padded.fragment_b, area=padded.area, dtype=dtype)
        area = padded.area
        if self.gap_length is not None:
            area = area * np.asarray(_gap_factor(padded.gap, self.gap_length))
        return ContactLinks(
            entries=tuple(joint.entry for joint in joints),
            pair_sums=sums_of_sizes(sizes) if sizes[1:] else None,
            bodies=(ends[0].number, ends[1].number),
            ends=(a, b),
            area=device_array(area, dtype),
            conductance=for_jit(self.conductance, dtype),
        )


def _end(body: Any, fragment: np.ndarray, area: np.ndarray, dtype: Any) -> ContactEnd:
    node = body.fragment_node[fragment]
    address = body.address_of(node)
    fragment_area = body.structure.grid.fragment_area
    # A pair has the fraction of the half cell that is behind it.
    fraction = (area / fragment_area[fragment]).astype(dtype)
    parts = body.conductivity_parts
    capacity = body.network.capacity_at(address)
    if not capacity.ndim:
        capacity = jnp.broadcast_to(capacity, fraction.shape)
    return ContactEnd(
        address=address,
        fragment=device_array(fragment),
        half_cell=device_array(body.half_cell[fragment] * fraction),
        per_capacity=1 / capacity,
        area_fraction=device_array(fraction),
        conductivity_parts=None if parts is None else parts[:, fragment],
    )


bonded = Contact(math.inf)
"""Contact of infinite conductance: bodies that touch conduct as one."""
