"""The bodies of the exhibits: the thesis' meshes, or the figurine in place of one."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.voxels.voxelize import SurfaceCells

from ..harness.meshes import thesis_meshes, voxels_high


CONFIGS = Path(__file__).parents[2] / "configs"
"""Configurations of the checkout."""
AXES = {"x": 0, "y": 2, "z": 1}
"""Axes of our lattices, of which z is up, by the thesis' names, of which y is up."""
WAYS = ("+x", "-x", "-z", "+z", "+y", "-y")
"""The thesis' names of +x, -x, +y, -y, +z, -z of our lattices."""


class Statue(NamedTuple):
    """A mesh and its name."""

    name: str
    mesh: jt.Mesh
    is_thesis: bool
    """True for a mesh of the thesis; False for the figurine in place of one."""

    def grid(
        self, height: int, surface_cells: SurfaceCells = "crossings"
    ) -> jt.VoxelGrid:
        """Its voxels, `height` along up."""
        return _grid(self.name, height, surface_cells)


@cache
def _statues() -> dict[str, Statue]:
    meshes = thesis_meshes()
    return {
        name: Statue(name, mesh, name in _OF_THESIS) for name, mesh in meshes.items()
    }


_BUDDHA = "Happy Buddha"
_OF_THESIS = (_BUDDHA, "Max Planck")


def buddha() -> Statue:
    """The Happy Buddha, or another mesh in its place."""
    statues = _statues()
    return statues.get(_BUDDHA) or next(iter(statues.values()))


def required_statue(name: str) -> Statue:
    """A body by its name.

    Raises:
        InputError: without its mesh.
    """
    body = _statues().get(name)
    if body is None:
        file = f"{name.lower().replace(' ', '-')}.obj"
        raise InputError(
            f"JAXTHERMO_MESHES has no {file}, the mesh of {name}: add its folder"
        )
    return body


def planck() -> Statue:
    """The Max Planck head; an InputError without its mesh."""
    return required_statue("Max Planck")


@cache
def _grid(name: str, height: int, surface_cells: SurfaceCells) -> jt.VoxelGrid:
    return voxels_high(_statues()[name].mesh, height, surface_cells)


SPHERE_RADIUS = 0.25
"""Radius of the sphere of several exhibits [m]."""


def sphere_grid(across: int, subdivisions: int = 5) -> jt.VoxelGrid:
    """The sphere in `across` voxels."""
    mesh = jt.shapes.sphere(SPHERE_RADIUS, subdivisions)
    return jt.voxelize(mesh, 2 * SPHERE_RADIUS / across, "dominant_axis")


HEIGHT = 250
"""Voxels along up: the thesis' 100x250x100."""


def levels_at(height: int, levels: int) -> int:
    """Levels of another resolution that reach as deep as `levels` at 250 voxels."""
    return max(1, round(levels * height / HEIGHT))
