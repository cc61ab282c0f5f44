"""Stencil of a body in sections, with links between voxels on both sides of each cut.

    C_i dT_i/dt = q_i + sum_j G_ij (T_j - T_i),    i and j a pair across a cut,

q_i the rate of the stencil, in which the sections lie apart (`PackedLattice`).
"""

from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import added, taken
from .network import AbstractDerivedNetwork, AbstractNetwork, Address, inverse


class SectionedStencil(AbstractDerivedNetwork):
    """A stencil, and pairs of its voxels that are neighbours across cuts."""

    base: AbstractNetwork
    """Stencil of the sections, each by itself."""
    before: Address
    """Position of the voxel before the cut, of every pair."""
    behind: Address
    """Position of the voxel behind it."""
    conductance: Float[Array, "*p"]
    """Conductance of every pair [W/K]; one number if all are the same."""

    def _flow(self, state: Float[Array, "..."]) -> Float[Array, " p"]:
        """Heat rate through each pair, into the voxel before the cut [W]."""
        return self.conductance * (
            taken(state, self.behind) - taken(state, self.before)
        )

    def _with(
        self,
        values: Float[Array, "..."],
        before: Float[Array, "*#p"],
        behind: Float[Array, "*#p"],
    ) -> Float[Array, "..."]:
        """Values with those of all pairs added."""
        return _plus(_plus(values, self.before, before), self.behind, behind)

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        flow = self._flow(state)
        return self._with(self.base.heat_rate(state), flow, -flow)

    @override
    def face_heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        flow = self._flow(state)
        return self._with(self.base.face_heat_rate(state), flow, -flow)

    @override
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        flow = self._flow(state)
        before, behind = (
            dt * inverse(self.base.capacity_at(at)) * flow
            for at in (self.before, self.behind)
        )
        return self._with(self.base.euler_step(state, dt), before, -behind)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        conductance = self.conductance
        return self._with(self.base.diagonal(), conductance, conductance)

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        return self.base.capacity_at(address)


def _plus(
    values: Float[Array, "..."], address: Address, more: Float[Array, "*#p"]
) -> Float[Array, "..."]:
    # A section is two voxels thick or more: none is in two pairs of a kind.
    return added(values, address, more, is_unique=True)
