"""A body in the sun until a sunset, and in air, as any structure of its voxels.

Errors are those of `surface_error` against the full volume of the same voxels.
"""

from dataclasses import dataclass
from functools import cached_property

import jaxthermo as jt
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.structures.surface_map import AbstractSurfaceMap

from ..harness.meshes import END, SAVE_AT, START, STEEL, voxels_high


SUNSET = 90.0
"""Time at which the sun goes [s]."""
SUN = jt.Sun((-1.0, 0.0, 0.0), jt.Until(5000.0, SUNSET))
# Read where the full volume's nodes are.
_AT_VOXELS = jt.FluxCorrectedMap(at="voxel")


@dataclass(frozen=True)
class Sunlit:
    """A body in steel, by its mesh and voxels along up."""

    mesh: jt.Mesh
    voxels_high: int

    @cached_property
    def grid(self) -> jt.VoxelGrid:
        """Its voxels."""
        return voxels_high(self.mesh, self.voxels_high)

    @cached_property
    def full(self) -> jt.Solution:
        """The full volume in its own stable steps."""
        return self.solve(jt.FullVolume(self.grid), surface_map=jt.ConstantMap())

    def solve(
        self,
        structure: AbstractStructure,
        surface_map: AbstractSurfaceMap = _AT_VOXELS,
    ) -> jt.Solution:
        """Run in stable explicit steps."""
        body = jt.Body(structure, STEEL, temperature=START, surface_map=surface_map)
        scene = jt.Scene((body,), (SUN, jt.Convection(10.0, START)))
        return jt.simulate(scene, END, SAVE_AT, solver=jt.ForwardEuler())

    def error(self, structure: AbstractStructure) -> float:
        """Error against the full volume [%]."""
        error = jt.surface_error(self.solve(structure), self.full)
        return float(error.worst_rms_percent)
