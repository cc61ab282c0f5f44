"""Conduction where k depends on temperature and on the material, or on the axis.

The two halves of a link, of lengths d_1 and d_2, meet at a face of temperature T_f:

    q = A / d_1 (F_1(T_f) - F_1(T_1)) = A / d_2 (F_2(T_2) - F_2(T_f)),    F = int k dT,

q into the first node [W]. In one material the face drops out: Kirchhoff's transform,
q = A / (d_1 + d_2) (F(T_2) - F(T_1)). Between two, T_f is solved for in every
evaluation: steady conduction along a link is exact, however steep k is. What one node
loses the other gains. Along an axis of its own conductivity each link has the F of that
axis.

The heat rates of two neighbours answer differently to each other's temperature, so that
no change of variables makes the Jacobian symmetric. With u = k / k(reference) T at each
node it is near the linear network, with which it is preconditioned.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import taken
from ..module import Module
from .network import AbstractDerivedNetwork, AbstractNetwork, Address, inverse
from .nonlinear import KirchhoffTransform


_FACE_ITERATIONS = 12
"""Newton steps, or halvings of the bracket where these would leave it: from any two
temperatures to rounding for conductivities that change up to tenfold between them."""


class Integrals(Module):
    """F of every material [W/m], and along every axis if they differ by it."""

    transform: tuple[tuple[KirchhoffTransform, ...], ...]
    """By material, and by axis: one of them, or three."""
    reference: Float[Array, "c a"]
    """Conductivities at the reference temperature [W/(m K)]."""

    @property
    def axes(self) -> int:
        """Number of conductivities of a material: 1 or 3."""
        return len(self.transform[0])

    def of(
        self, material: Int[Array, " m"], theta: Float[Array, " m"]
    ) -> list[Float[Array, " m"]]:
        """F at temperatures above the reference [W/m], by axis."""
        return self._by_axis(material, lambda own, k: k * own(theta))

    def conductivity(
        self, material: Int[Array, " m"], theta: Float[Array, " m"]
    ) -> list[Float[Array, " m"]]:
        """Conductivity at temperatures above the reference [W/(m K)], by axis."""
        return self._by_axis(material, lambda own, k: k * own.slope(theta))

    def extremes(self, material: Int[Array, " m"]) -> tuple[list[Array], list[Array]]:
        """Lowest and highest k at any temperature [W/(m K)], by axis."""
        like = jnp.ones(material.shape, self.reference.dtype)
        low = self._by_axis(material, lambda own, k: k * own.min() * like)
        high = self._by_axis(material, lambda own, k: k * own.max() * like)
        return low, high

    def relative(
        self, parts: Float[Array, "q m"], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Mean of k / k(reference) of all materials and axes, weighted by `parts`."""
        every = [own for material in self.transform for own in material]
        pairs = zip(parts, every, strict=True)
        return sum((part * own.slope(theta) for part, own in pairs), 0 * theta)

    def _by_axis(self, material, value) -> list[Array]:
        found = []
        for axis in range(self.axes):
            # Few materials: all are evaluated at every node, and one is taken.
            own = value(self.transform[0][axis], self.reference[0, axis])
            for c in range(1, len(self.transform)):
                other = value(self.transform[c][axis], self.reference[c, axis])
                own = jnp.where(material == c, other, own)
            found.append(own)
        return found


class LinkHalves(Module):
    """Links between nodes, with the geometry of both halves."""

    src: Int[Array, " e"]
    dst: Int[Array, " e"]
    area: Float[Array, " e"]
    """Shared face, times the weight of the link [m^2]."""
    to_src: Float[Array, " e"]
    """Distance from the first node to the face [m]."""
    to_dst: Float[Array, " e"]
    along: tuple[Float[Array, " e"], ...]
    """Squared direction cosine of the link along each axis of k; ones for one axis."""

    def project(self, by_axis: list[Float[Array, " e"]]) -> Float[Array, " e"]:
        """Values along each link, from those along the axes."""
        pairs = zip(self.along, by_axis, strict=True)
        return sum((part * own for part, own in pairs), 0 * self.area)


class VaryingLinks(AbstractDerivedNetwork):
    """Links of several materials, or of an orthotropic one, with k(T)."""

    is_symmetric = False
    is_linear = False

    base: AbstractNetwork
    """Linear network at the reference temperature."""
    integrals: Integrals
    heat: tuple[KirchhoffTransform | None, ...]
    """Transform of c_p of each material; None where it is constant."""
    number: Int[Array, "..."]
    """Material of every entry of the state."""
    address: Address
    """Position of every node in the state."""
    within: LinkHalves
    """Links inside one material."""
    across: LinkHalves
    """Links between two materials."""

    @property
    @override
    def linear(self) -> AbstractNetwork:
        return self.base

    @override
    def linearized(
        self, state: Float[Array, "..."]
    ) -> tuple[AbstractNetwork, Float[Array, "..."]]:
        theta, per_state = jax.jvp(self.temperature, (state,), (jnp.ones_like(state),))
        theta, number = self._at_nodes(theta), self._at_nodes(self.number)
        by_axis = self.integrals.of(number, theta)
        k = self.integrals.conductivity(number, theta)
        at_zero = self.integrals.conductivity(number, jnp.zeros_like(theta))
        # Any positive d would do: with this one the links are near those at the
        # reference.
        relative = sum(k[1:], k[0]) / sum(at_zero[1:], at_zero[0])
        slope = [each / relative for each in k]
        found = []
        for links in (self.within, self.across):
            # Of the flux, by the integrals F at both ends [1/m].
            first = second = 1 / (links.to_src + links.to_dst)
            if links is self.across and links.src.shape[0]:
                face = self._face(links, number, theta, by_axis)
                k_one, k_other = self._conductivities(links, number, face)
                series = 1 / (links.to_src * k_other + links.to_dst * k_one)
                first, second = k_other * series, k_one * series
            found.append(
                (
                    links.src,
                    links.dst,
                    links.area * first * links.project([v[links.src] for v in slope]),
                    links.area * second * links.project([v[links.dst] for v in slope]),
                )
            )
        ends = (jnp.concatenate(column) for column in zip(*found, strict=True))
        spread = jnp.ones_like(state).at[self.address].set(relative)
        return _LinkJacobian(self.base, self.address, *ends), spread * per_state

    @override
    def temperature(
        self, state: Float[Array, "..."], address: Address | None = None
    ) -> Float[Array, "..."]:
        # One number for all nodes has a temperature for each material.
        return self._by_material(state, address, lambda own: own.inverse(state))

    @override
    def state_of(self, theta: Float[Array, "..."]) -> Float[Array, "..."]:
        return self._by_material(theta, None, lambda own: own(theta))

    def _by_material(self, values, address, convert):
        number, found = self.number, values
        if address is not None:
            number = taken(number, address)
        for c, own in enumerate(self.heat):
            if own is not None:
                found = jnp.where(number == c, convert(own), found)
        return found

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        theta = self._at_nodes(self.temperature(state))
        number = self._at_nodes(self.number)
        total = jnp.zeros_like(theta)
        by_axis = self.integrals.of(number, theta)
        for links, flow in (
            (self.within, self._inside),
            (self.across, self._between),
        ):
            if not links.src.shape[0]:
                continue
            rate = flow(links, number, theta, by_axis)
            # What enters the first node leaves the second.
            total = total.at[links.src].add(rate).at[links.dst].add(-rate)
        return jnp.zeros_like(state).at[self.address].set(total)

    def _inside(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        rise = links.project([own[links.dst] - own[links.src] for own in by_axis])
        return links.area * rise / (links.to_src + links.to_dst)

    def _between(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        face = self._face(links, number, theta, by_axis)
        # The sum of both halves: neither length is divided by, which may be 0.
        one, other = self._rises(links, number, by_axis, face)
        return links.area * (one + other) / (links.to_src + links.to_dst)

    def _rises(self, links: LinkHalves, number, by_axis, face):
        # F at the face above that of the first node, and below that of the second.
        here = links.project([own[links.src] for own in by_axis])
        there = links.project([own[links.dst] for own in by_axis])
        one = links.project(self.integrals.of(number[links.src], face)) - here
        return one, there - links.project(self.integrals.of(number[links.dst], face))

    def _conductivities(self, links: LinkHalves, number, face):
        # Of both materials at the face.
        k_one = self.integrals.conductivity(number[links.src], face)
        k_other = self.integrals.conductivity(number[links.dst], face)
        return links.project(k_one), links.project(k_other)

    def _face(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        def imbalance(face):
            # Both fluxes are equal at the face; its slope is positive.
            one, other = self._rises(links, number, by_axis, face)
            k_one, k_other = self._conductivities(links, number, face)
            slope = links.to_dst * k_one + links.to_src * k_other
            return links.to_dst * one - links.to_src * other, slope

        return _face_temperature(imbalance, theta[links.src], theta[links.dst])

    def _at_nodes(self, values: Array) -> Array:
        return taken(values, self.address)

    @override
    def relative_conductivity(
        self, theta: Float[Array, "*m"], parts: Float[Array, "q m"] | None = None
    ) -> Float[Array, "*#m"]:
        assert parts is not None
        return self.integrals.relative(parts, theta)

    @override
    def max_relative_conductivity(self) -> Float[Array, ""]:
        every = [own.max() for material in self.integrals.transform for own in material]
        # The links' bound is relative to the conductances at the reference.
        links = (self._bound() * inverse(self.base.diagonal())).max()
        return jnp.maximum(jnp.stack(every).max(), links)

    @override
    def min_relative_capacity(self) -> Float[Array, ""]:
        one = super().min_relative_capacity()
        varying = [own.min() for own in self.heat if own is not None]
        # Not above 1, which is that of the other materials.
        return jnp.stack([one, *varying]).min()

    def _bound(self) -> Float[Array, "..."]:
        # Largest -d(heat rate)/dT of every node at any temperatures [W/K]. Of a link
        # between two materials dq/dT_1 = A k_1(T_1) k_2 / (d_2 k_1(T_f) + d_1 k_2).
        number = self.number[self.address]
        low, high = self.integrals.extremes(number)
        total = jnp.zeros(number.shape, self.integrals.reference.dtype)
        for links, same in ((self.within, True), (self.across, False)):
            length = links.to_src + links.to_dst
            for end, other, d_end, d_other in (
                (links.src, links.dst, links.to_src, links.to_dst),
                (links.dst, links.src, links.to_dst, links.to_src),
            ):
                most = links.project([own[end] for own in high])
                conductance = links.area * most / length
                if not same:
                    least = links.project([own[end] for own in low])
                    beyond = links.project([own[other] for own in high])
                    series = beyond / (d_other * least + d_end * beyond)
                    conductance = links.area * most * series
                total = total.at[end].add(conductance)
        return jnp.zeros_like(self.base.diagonal()).at[self.address].set(total)

    @override
    def max_rate(self) -> Float[Array, ""]:
        capacity = self.base.capacity() * self.min_relative_capacity()
        return (self._bound() * inverse(capacity)).max()


class _LinkJacobian(AbstractDerivedNetwork):
    """Links that answer differently to the temperatures of their two ends."""

    is_symmetric = False

    base: AbstractNetwork
    address: Address
    src: Int[Array, " e"]
    dst: Int[Array, " e"]
    by_src: Float[Array, " e"]
    """Decrease of the heat rate into the first node by its own potential [W/K]."""
    by_dst: Float[Array, " e"]
    """Its increase by that of the second [W/K]."""

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        u = taken(state, self.address)
        rate = self.by_dst * u[self.dst] - self.by_src * u[self.src]
        total = jnp.zeros_like(u).at[self.src].add(rate).at[self.dst].add(-rate)
        # Added, not set: the transposed solves of derivatives need its transpose.
        return jnp.zeros_like(state).at[self.address].add(total)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        like = self.base.diagonal()
        nodes = jnp.zeros(self.address[0].shape, like.dtype)
        nodes = nodes.at[self.src].add(self.by_src).at[self.dst].add(self.by_dst)
        return jnp.zeros_like(like).at[self.address].set(nodes)


def _face_temperature(imbalance: Any, one: Array, other: Array) -> Array:
    """Temperature between two at which an increasing function is 0 [K]."""
    start = jax.lax.stop_gradient(one), jax.lax.stop_gradient(other)
    fixed = lambda face: jax.lax.stop_gradient(imbalance(face))

    def narrow(_, bracket):
        low, high, face = bracket
        value, slope = fixed(face)
        low, high = jnp.where(value < 0, face, low), jnp.where(value > 0, face, high)
        newton = face - value * inverse(slope)
        inside = (newton >= low) & (newton <= high)
        return low, high, jnp.where(inside, newton, (low + high) / 2)

    low, high = jnp.minimum(*start), jnp.maximum(*start)
    bracket = low, high, (low + high) / 2
    _, _, face = jax.lax.fori_loop(0, _FACE_ITERATIONS, narrow, bracket)
    # One step more, which carries the derivative of the solution.
    face = jax.lax.stop_gradient(face)
    value, slope = imbalance(face)
    return face - value * inverse(jax.lax.stop_gradient(slope))
