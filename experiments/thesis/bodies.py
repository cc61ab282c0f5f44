"""The bodies of the exhibits: the thesis' meshes, or the figurine in place of one."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import jaxthermo as jt
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

    @property
    def stands_in(self) -> tuple[tuple[str, str], ...]:
        """A line for an exhibit's choices, if the mesh is not the thesis'."""
        text = "the built-in figurine, since JAXTHERMO_MESHES has no happy-buddha.obj"
        return () if self.is_thesis else (("mesh", text),)

    def grid(self, height: int, surface_cells: SurfaceCells = "crossings"):
        """Its voxels, `height` along up."""
        return _grid(self.name, height, surface_cells)


@cache
def _statues() -> dict[str, Statue]:
    meshes = thesis_meshes()
    return {
        name: Statue(name, mesh, name in _OF_THESIS) for name, mesh in meshes.items()
    }


_BUDDHA, _PLANCK = "Happy Buddha", "Max Planck"
_OF_THESIS = (_BUDDHA, _PLANCK)


def buddha() -> Statue:
    """The Happy Buddha, or another mesh in its place."""
    statues = _statues()
    return statues.get(_BUDDHA) or next(iter(statues.values()))


def statue(name: str) -> Statue | None:
    """A body by its name; None without its mesh."""
    return _statues().get(name)


def planck() -> Statue | None:
    """The Max Planck head; None without its mesh."""
    return statue(_PLANCK)


NO_PLANCK = "JAXTHERMO_MESHES has no max-planck.obj, the head of this exhibit."


@cache
def _grid(name: str, height: int, surface_cells: SurfaceCells) -> jt.VoxelGrid:
    return voxels_high(_statues()[name].mesh, height, surface_cells)
