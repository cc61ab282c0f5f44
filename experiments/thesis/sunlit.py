"""A body in the sun, as any structure of its voxels.

Errors are those of `surface_error` against the full volume of the same voxels.
"""

from dataclasses import dataclass
from functools import cached_property

import jaxthermo as jt
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.structures.structure import AbstractStructure

from ..harness.meshes import SAVE_AT, START, STEEL


SUNSET = 90.0
"""Time at which the sun goes [s]."""
SUN = jt.Sun((-1.0, 0.0, 0.0), jt.Until(5000.0, SUNSET))


@dataclass(frozen=True, eq=False)
class Sunlit:
    """A body by its voxels, from its start in the sun to the last of its times."""

    grid: jt.VoxelGrid
    material: jt.Material = STEEL
    terms: tuple[AbstractTerm, ...] = (SUN, jt.Convection(10.0, START))
    """Its surroundings: by default until a sunset, and in air."""
    save_at: tuple[float, ...] = SAVE_AT
    """Saved times [s]."""

    @cached_property
    def full(self) -> jt.Solution:
        """The full volume."""
        return self.solve(jt.FullVolume(self.grid))

    def solve(self, structure: AbstractStructure) -> jt.Solution:
        """Run in stable explicit steps."""
        # All surfaces are read where the full volume's nodes are.
        is_full = isinstance(structure, jt.FullVolume)
        surface_map = jt.ConstantMap() if is_full else jt.FluxCorrectedMap(at="voxel")
        body = jt.Body(
            structure, self.material, temperature=START, surface_map=surface_map
        )
        scene = jt.Scene((body,), self.terms)
        solver = jt.ForwardEuler()
        return jt.simulate(scene, self.save_at[-1], self.save_at, solver=solver)

    def error(self, structure: AbstractStructure) -> float:
        """Error against the full volume [%]."""
        error = jt.surface_error(self.solve(structure), self.full)
        return float(error.worst_rms_percent)
