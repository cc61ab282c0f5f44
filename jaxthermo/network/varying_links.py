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

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import stop_gradient, taken
from .columns import Columns
from .increasing_root import Balance, increasing_root
from .network import (
    AbstractDerivedNetwork,
    AbstractNetwork,
    Address,
    StepStart,
    inverse,
)
from .nonlinear import (
    KirchhoffTransform,
    WeightedMean,
    conduction_weight,
    rise_of_potential,
)


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
        return self._by_axis(material, lambda integral, k: k * integral(theta))

    def conductivity(
        self, material: Int[Array, " m"], theta: Float[Array, " m"]
    ) -> list[Float[Array, " m"]]:
        """Conductivity at temperatures above the reference [W/(m K)], by axis."""
        return self._by_axis(material, lambda integral, k: k * integral.slope(theta))

    def mean_conductivity(
        self,
        material: Int[Array, " m"],
        first: Float[Array, " m"],
        second: Float[Array, " m"],
    ) -> list[Float[Array, " m"]]:
        """Mean conductivity between two temperatures [W/(m K)], by axis."""
        return self._by_axis(
            material, lambda integral, k: k * integral.mean(first, second)
        )

    def extremes(self, material: Int[Array, " m"]) -> tuple[list[Array], list[Array]]:
        """Lowest and highest k at any temperature [W/(m K)], by axis."""
        ones = jnp.ones(material.shape, self.reference.dtype)
        low = self._by_axis(material, lambda integral, k: k * integral.min() * ones)
        high = self._by_axis(material, lambda integral, k: k * integral.max() * ones)
        return low, high

    def relative(
        self, fractions: Float[Array, "q m"], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Mean of k / k(reference) over materials and axes, weighted by `fractions`."""
        transforms = itertools.chain(*self.transform)
        total = 0 * theta
        for fraction, transform in zip(fractions, transforms, strict=True):
            total = total + fraction * transform.slope(theta)
        return total

    def mean_relative(
        self,
        fractions: Float[Array, "q m"],
        first: Float[Array, " m"],
        second: Float[Array, " m"],
    ) -> Float[Array, " m"]:
        """Mean of `relative` between two temperatures above the reference [-]."""
        transforms = itertools.chain(*self.transform)
        total = 0 * first
        for fraction, transform in zip(fractions, transforms, strict=True):
            total = total + fraction * transform.mean(first, second)
        return total

    def _by_axis(self, material, value) -> list[Array]:
        by_axis = []
        for axis in range(self.axes):
            # Materials are few: all are evaluated at every node, and one is selected.
            axis_value = value(self.transform[0][axis], self.reference[0, axis])
            for c in range(1, len(self.transform)):
                material_value = value(self.transform[c][axis], self.reference[c, axis])
                axis_value = jnp.where(material == c, material_value, axis_value)
            by_axis.append(axis_value)
        return by_axis


class _MeanOfAxes(NamedTuple):
    """k / k(reference) of every node, of all axes together [-]."""

    integrals: Integrals
    material: Int[Array, " m"]

    def slope(self, theta: Float[Array, " m"]) -> Float[Array, " m"]:
        """Values at temperatures above the reference [-]."""
        k = self.integrals.conductivity(self.material, theta)
        return sum(k[1:], k[0]) / self._at_reference(theta)

    def mean(
        self, first: Float[Array, " m"], second: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Means between two temperatures above the reference [-]."""
        k = self.integrals.mean_conductivity(self.material, first, second)
        return sum(k[1:], k[0]) / self._at_reference(first)

    def _at_reference(self, theta: Float[Array, " m"]) -> Float[Array, " m"]:
        k = self.integrals.conductivity(self.material, jnp.zeros_like(theta))
        return sum(k[1:], k[0])


class LinkHalves(Module):
    """Links between nodes, with the geometry of both halves."""

    src: Int[Array, " e"]
    """First node of each link."""
    dst: Int[Array, " e"]
    """Second node of each link."""
    area: Float[Array, " e"]
    """Shared face, times the weight of the link [m^2]."""
    to_src: Float[Array, " e"]
    """Distance from the first node to the face [m]."""
    to_dst: Float[Array, " e"]
    """Distance from the face to the second node [m]."""
    along: tuple[Float[Array, " e"], ...]
    """Squared direction cosine of the link along each axis of k; ones for one axis."""
    outside: Float[Array, " e"] | None = None
    """1 for links outside columns, 0 within [-]; None without columns."""

    def project(self, by_axis: list[Float[Array, " e"]]) -> Float[Array, " e"]:
        """Values along each link, from those along the axes."""
        pairs = zip(self.along, by_axis, strict=True)
        return sum(
            (cosine_squared * values for cosine_squared, values in pairs), 0 * self.area
        )

    def project_at(
        self, nodes: Int[Array, " e"], by_axis: list[Float[Array, " n"]]
    ) -> Float[Array, " e"]:
        """Values of a node of each link along it, from those along the axes."""
        return self.project([values[nodes] for values in by_axis])


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
    def columns(self) -> Columns | None:
        ratio = self.max_relative_conductivity() / self.min_relative_capacity()
        columns = self.base.columns
        return columns and columns.scaled(ratio)

    @property
    @override
    def linear(self) -> AbstractNetwork:
        return self.base

    @override
    def linearized(
        self, state: Float[Array, "..."]
    ) -> tuple[AbstractNetwork, Float[Array, "..."]]:
        theta, per_state = jax.jvp(self.temperature, (state,), (jnp.ones_like(state),))
        theta = self._at_nodes(theta)
        number = self._at_nodes(self.number)
        by_axis = self.integrals.of(number, theta)
        k = self.integrals.conductivity(number, theta)
        # Any positive d would do: with this one the links are near those at the
        # reference.
        relative = _MeanOfAxes(self.integrals, number).slope(theta)
        slope = [axis_conductivity / relative for axis_conductivity in k]
        by_src = []
        by_dst = []
        for links in (self.within, self.across):
            # Derivatives of the flux by the integrals F at both ends [1/m].
            first = 1 / (links.to_src + links.to_dst)
            second = first
            if links is self.across and links.src.shape[0]:
                face = self._face(links, number, theta, by_axis)
                k_src, k_dst = self._conductivities(links, number, face)
                series = 1 / (links.to_src * k_dst + links.to_dst * k_src)
                first = k_dst * series
                second = k_src * series
            by_src.append(links.area * first * links.project_at(links.src, slope))
            by_dst.append(links.area * second * links.project_at(links.dst, slope))
        jacobian = _LinkJacobian(
            base=self.base,
            address=self.address,
            src=jnp.concatenate([self.within.src, self.across.src]),
            dst=jnp.concatenate([self.within.dst, self.across.dst]),
            by_src=jnp.concatenate(by_src),
            by_dst=jnp.concatenate(by_dst),
        )
        spread = jnp.ones_like(state).at[self.address].set(relative)
        return jacobian, spread * per_state

    @override
    def moved(
        self,
        state: Float[Array, "..."],
        potential: Float[Array, "..."],
        rate: Float[Array, ""],
    ) -> Float[Array, "..."]:
        number = self._at_nodes(self.number)
        heat_weight = rate * self.capacity_at(self.address)
        weight = conduction_weight(self.base, rate * self.capacity())
        weighted = WeightedMean(
            heat=lambda first, second: self._mean_capacity(number, first, second),
            conduction=_MeanOfAxes(self.integrals, number).mean,
            heat_weight=heat_weight,
            conduction_weight=self._at_nodes(weight),
        )
        theta = self._at_nodes(self.temperature(state))
        rise = rise_of_potential(weighted, theta, self._at_nodes(potential))
        moved = self.state_of(jnp.zeros_like(state).at[self.address].set(theta + rise))
        is_node = jnp.zeros(state.shape, bool).at[self.address].set(True)
        return jnp.where(is_node, moved, state)

    def _mean_capacity(self, number, first, second) -> Float[Array, " n"]:
        # Mean of c / c(reference) between two temperatures.
        mean = jnp.ones_like(second)
        for c, transform in enumerate(self.heat):
            if transform is not None:
                mean = jnp.where(number == c, transform.mean(first, second), mean)
        return mean

    @override
    def temperature(
        self, state: Float[Array, "..."], address: Address | None = None
    ) -> Float[Array, "..."]:
        # A state that is one number for all nodes has a temperature for each material.
        return self._by_material(state, address, lambda heat: heat.inverse(state))

    @override
    def state_of(self, theta: Float[Array, "..."]) -> Float[Array, "..."]:
        return self._by_material(theta, None, lambda heat: heat(theta))

    def _by_material(self, values, address, convert):
        number = self.number
        converted = values
        if address is not None:
            number = taken(number, address)
        for c, transform in enumerate(self.heat):
            if transform is not None:
                converted = jnp.where(number == c, convert(transform), converted)
        return converted

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

    @override
    def stepped_change(
        self, change: Float[Array, "..."], start: StepStart, dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        # Both ends of a link round alike, so that no heat is lost.
        return change + (self.euler_rise(start.state + change, dt) - start.rise)

    def _inside(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        rise = links.project(
            [integral[links.dst] - integral[links.src] for integral in by_axis]
        )
        return links.area * rise / (links.to_src + links.to_dst)

    def _between(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        face = self._face(links, number, theta, by_axis)
        # Dividing by the sum of both lengths, since either may be 0.
        src_rise, dst_rise = self._rises(links, number, by_axis, face)
        return links.area * (src_rise + dst_rise) / (links.to_src + links.to_dst)

    def _rises(self, links: LinkHalves, number, by_axis, face):
        # F at the face above that of the first node, and below that of the second.
        at_src = links.project_at(links.src, by_axis)
        at_dst = links.project_at(links.dst, by_axis)
        src_face = links.project(self.integrals.of(number[links.src], face))
        dst_face = links.project(self.integrals.of(number[links.dst], face))
        return src_face - at_src, at_dst - dst_face

    def _conductivities(self, links: LinkHalves, number, face):
        # Those of both materials at the face.
        k_src = self.integrals.conductivity(number[links.src], face)
        k_dst = self.integrals.conductivity(number[links.dst], face)
        return links.project(k_src), links.project(k_dst)

    def _face(self, links: LinkHalves, number, theta, by_axis) -> Float[Array, " e"]:
        def imbalance(network, by_axis, face) -> Balance:
            # Both fluxes are equal at the face; its slope is positive.
            src_rise, dst_rise = network._rises(links, number, by_axis, face)
            k_src, k_dst = network._conductivities(links, number, face)
            slope = links.to_dst * k_src + links.to_src * k_dst
            return Balance(links.to_dst * src_rise - links.to_src * dst_rise, slope)

        fixed, fixed_by_axis, fixed_theta = stop_gradient((self, by_axis, theta))
        first = fixed_theta[links.src]
        second = fixed_theta[links.dst]
        low = jnp.minimum(first, second)
        high = jnp.maximum(first, second)
        face = increasing_root(
            lambda face: imbalance(fixed, fixed_by_axis, face),
            start=(low + high) / 2,
            low=low,
            high=high,
        )
        # A last step carries the derivative of the solution.
        balance = imbalance(self, by_axis, face)
        return face - balance.value * inverse(jax.lax.stop_gradient(balance.slope))

    def _at_nodes(self, values: Array) -> Array:
        return taken(values, self.address)

    @override
    def relative_conductivity(
        self, theta: Float[Array, "*m"], fractions: Float[Array, "q m"] | None = None
    ) -> Float[Array, "*#m"]:
        assert fractions is not None
        return self.integrals.relative(fractions, theta)

    @property
    @override
    def conductivity_varies(self) -> bool:
        return True

    @override
    def mean_relative_conductivity(
        self,
        first: Float[Array, "*m"],
        second: Float[Array, "*m"],
        fractions: Float[Array, "q m"] | None = None,
    ) -> Float[Array, "*#m"]:
        assert fractions is not None
        return self.integrals.mean_relative(fractions, first, second)

    @override
    def max_relative_conductivity(self) -> Float[Array, ""]:
        transforms = itertools.chain(*self.integrals.transform)
        highest = jnp.stack([transform.max() for transform in transforms]).max()
        # The links' bound is relative to the conductances at the reference.
        links = (self._bound() * inverse(self.base.diagonal())).max()
        return jnp.maximum(highest, links)

    @override
    def min_relative_conductivity(self) -> Float[Array, ""]:
        transforms = itertools.chain(*self.integrals.transform)
        return jnp.stack([transform.min() for transform in transforms]).min()

    @override
    def min_relative_capacity(self) -> Float[Array, ""]:
        unit_ratio = super().min_relative_capacity()
        varying = [transform.min() for transform in self.heat if transform is not None]
        # Not above 1, which is that of the other materials.
        return jnp.stack([unit_ratio, *varying]).min()

    def _bound(self, explicit: bool = False) -> Float[Array, "..."]:
        # Largest -d(heat rate)/dT of every node at any temperatures [W/K]. For a link
        # between two materials dq/dT_1 = A k_1(T_1) k_2 / (d_2 k_1(T_f) + d_1 k_2).
        number = self.number[self.address]
        low, high = self.integrals.extremes(number)
        total = jnp.zeros(number.shape, self.integrals.reference.dtype)
        for links, same in ((self.within, True), (self.across, False)):
            length = links.to_src + links.to_dst
            for end, far_end, d_end, d_other in (
                (links.src, links.dst, links.to_src, links.to_dst),
                (links.dst, links.src, links.to_dst, links.to_src),
            ):
                highest_conductivity = links.project_at(end, high)
                conductance = links.area * highest_conductivity / length
                if not same:
                    lowest_conductivity = links.project_at(end, low)
                    beyond = links.project_at(far_end, high)
                    series = beyond / (d_other * lowest_conductivity + d_end * beyond)
                    conductance = links.area * highest_conductivity * series
                if explicit and links.outside is not None:
                    conductance = conductance * links.outside
                total = total.at[end].add(conductance)
        return jnp.zeros_like(self.base.diagonal()).at[self.address].set(total)

    @override
    def max_rate(self) -> Float[Array, ""]:
        capacity = self.base.capacity() * self.min_relative_capacity()
        return (self._bound(explicit=True) * inverse(capacity)).max()


class _LinkJacobian(AbstractDerivedNetwork):
    """Links that answer differently to the temperatures of their two ends."""

    is_symmetric = False

    base: AbstractNetwork
    address: Address
    src: Int[Array, " e"]
    dst: Int[Array, " e"]
    by_src: Float[Array, " e"]
    """Decrease of the heat rate into the first node with its potential [W/K]."""
    by_dst: Float[Array, " e"]
    """Increase of the heat rate into the first node with the second's potential."""

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
