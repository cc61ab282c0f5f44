"""Groups of bodies in a compiled scene: conduction, heat sources, surfaces."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int, Shaped

from ...arrays import Time, is_traced, stacked, taken
from ...network.network import AbstractNetwork, Address
from ...network.segment_sums import SegmentSums
from ...parallel.lattice import with_added
from ...physics.time_varying import value_at
from ...structures.surface_map import BoundMap


class VolumeLoad(Module):
    """Heat released inside the bodies of a group."""

    entries: tuple[int, ...] = eqx.field(static=True)
    """Ledger entry of each heated body."""
    address: Address
    """Position of the heated nodes, in the order of the state."""
    rise: Float[Array, " m"]
    """Heated volume over capacity of each heated node [m^3 K/J]."""
    volume: Float[Any, " b"]
    """Heated volume of each of these bodies [m^3]; of a heat rate the fraction that it
    is of the heated volume of all bodies, in `rise` too."""
    heat_rate_density: Any
    """[W/m^3], or a heat rate [W]."""
    mesh: Mesh | None = eqx.field(static=True)
    """Devices of the body, each with the nodes of one section; None for one device."""

    def apply_heat(
        self, new: Float[Array, "..."], time: Time, dt: Time
    ) -> tuple[Float[Array, "..."], Float[Array, " b"]]:
        """A state with the heat of one step, and its rate in each body [W]."""
        density = value_at(self.heat_rate_density, time)
        warmed = with_added(
            self.mesh,
            values=new,
            address=self.address,
            increments=dt * density * self.rise,
        )
        return warmed, density * self.volume


class Members(Module):
    """Nodes and fragments of several bodies that conduct as one network."""

    of_node: Int[Array, " n"]
    """Index of the body of each node in the group."""
    of_fragment: Int[Array, " s"]
    """Index of the body of each fragment in the group."""
    sums: SegmentSums
    """Sums over the nodes of each body."""
    fragment_sums: SegmentSums
    """Sums over the fragments of each body."""


class BodyProgram(Module):
    """A body, or several: their network, heat sources, and how surfaces are read."""

    numbers: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the bodies in the scene."""
    fragment_counts: tuple[int, ...] = eqx.field(static=True)
    """Number of fragments of each body."""
    network: AbstractNetwork
    reference: Float[Any, "*b"]
    """Temperature from which the state of each body counts [K]; one number where all
    are equal."""
    members: Members | None
    """None for one body."""
    sources: tuple[VolumeLoad, ...]
    address: Address
    """Position of the surface nodes, each once, in the order of the state."""
    node: Int[Array, " s"]
    """Index of each fragment's node among the surface nodes."""
    exposed_fraction: Float[Any, "*s"]
    """Fraction of each fragment that nothing touches."""
    surface_map: BoundMap
    conductivity_parts: Float[Array, "q s"] | None
    """Fractions of each fragment's conductivity by material and axis, where one of
    several varies with temperature."""

    def reference_at(self, address: Address) -> Float[Array, "*m"]:
        """References of some of the nodes [K]; one number where all are equal."""
        reference = jnp.asarray(self.reference)
        if self.members is None or not reference.ndim:
            return reference
        return taken(reference, taken(self.members.of_node, address))

    @property
    def node_reference(self) -> Float[Array, "*n"]:
        """Reference of each node [K]; one number where all are equal."""
        reference = jnp.asarray(self.reference)
        if self.members is None or not reference.ndim:
            return reference
        return taken(reference, self.members.of_node)

    @property
    def fragment_reference(self) -> Float[Array, "*s"]:
        """Reference of each fragment [K]; one number where all are equal."""
        reference = jnp.asarray(self.reference)
        if self.members is None or not reference.ndim:
            return reference
        return taken(reference, self.members.of_fragment)

    def at_nodes(self, values: Shaped[Array, " c"]) -> Shaped[Array, "*n"]:
        """Values of all bodies of the scene at each node; one number for one body."""
        of_members = values[np.array(self.numbers)]
        if self.members is None:
            return of_members[0]
        return taken(of_members, self.members.of_node)

    def at_fragments(self, values: Shaped[Array, " c"]) -> Shaped[Array, " s"]:
        """Values of all bodies of the scene at each fragment."""
        of_members = values[np.array(self.numbers)]
        if self.members is None:
            return jnp.broadcast_to(of_members, self.node.shape)
        return taken(of_members, self.members.of_fragment)

    def stored(self, state: Float[Array, "..."]) -> Float[Array, " b"]:
        """Heat of each body above its reference [J]."""
        if self.members is None:
            return self.network.stored(state)[None]
        return self.members.sums(self.network.capacity() * state)

    def total_capacity(self) -> Float[Array, " b"]:
        """Heat capacity of each body [J/K]."""
        if self.members is None:
            return self.network.total_capacity()[None]
        return self.members.sums(self.network.capacity())

    def largest_of_nodes(
        self, values: Float[Array, "..."], address: Address | None = None
    ) -> Float[Array, " b"]:
        """Largest value among the nodes of each body, or among those at an address.

        At least 0, for bodies without such nodes.
        """
        if self.members is None:
            return values.max(initial=0)[None]
        if address is None:
            return jnp.maximum(self.members.sums.largest(values), 0)
        member = taken(self.members.of_node, address)
        largest = jax.ops.segment_max(values, member, len(self.numbers))
        return jnp.maximum(largest, 0)

    def largest_of_surface_nodes(
        self, values: Float[Array, " m"]
    ) -> Float[Array, " b"]:
        """Largest value among the nodes of each body that have surface, at least 0."""
        # By their fragments, which have the order of the bodies.
        return jnp.maximum(self.largest_of_fragments(taken(values, self.node)), 0)

    def largest_of_fragments(self, values: Float[Array, " s"]) -> Float[Array, " b"]:
        """Largest value at the fragments of each body; -inf for one without any."""
        if self.members is None:
            return values.max(initial=-jnp.inf)[None]
        return self.members.fragment_sums.largest(values)

    def below(
        self, theta: Float[Array, "..."]
    ) -> tuple[Float[Array, " m"], Float[Array, " s"]]:
        """Temperatures of the nodes that have surface, and below each fragment [K]."""
        nodes = taken(theta, self.address)
        return nodes, taken(nodes, self.node)


class SurfaceCoefficients(Module):
    """Emissivities or absorptivities of the surfaces of all bodies [-]."""

    uniform: Float[Any, " u"]
    """One number for each body that has the same everywhere."""
    varying: tuple[Float[Any, " _"], ...]
    """One for each fragment of each of the others."""
    is_uniform: tuple[bool, ...] = eqx.field(static=True)

    @classmethod
    def of_bodies(cls, values: Sequence[Any]) -> "SurfaceCoefficients":
        """Coefficients of bodies, each one number or one for each fragment."""
        uniform = [value for value in values if not np.ndim(value)]
        dtype = values[0].dtype
        return cls(
            uniform=stacked(uniform, dtype) if uniform else np.zeros(0, dtype),
            varying=tuple(value for value in values if np.ndim(value)),
            is_uniform=tuple(not np.ndim(value) for value in values),
        )

    def by_body(self) -> list[Any]:
        """Coefficient of each body, one number or one for each fragment."""
        # On the host, where single numbers are cut fast.
        uniform = self.uniform if is_traced(self.uniform) else np.asarray(self.uniform)
        numbers = iter(uniform)
        arrays = iter(self.varying)
        return [next(numbers if is_one else arrays) for is_one in self.is_uniform]
