"""The meshes of the thesis and the standard scene, which several experiments use."""

import os
from pathlib import Path

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import figurine
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.voxels.voxelize import SurfaceCells


# Of every body [m].
HEIGHT = 0.5


def _steel(factor: float | int = 1.0) -> jt.Material:
    return jt.Material(
        16.0 * factor, density=8000.0, specific_heat=500.0, absorptivity=1.0
    )


STEEL = _steel()

# Of body and air [K]; times of the standard scene [s].
START = 293.15
SAVE_AT = (30.0, 60.0, 90.0, 135.0, 180.0)
END = 180.0

_FILES = {"Happy Buddha": "happy-buddha.obj", "Max Planck": "max-planck.obj"}


def mesh_files() -> dict[str, Path]:
    """Files of the thesis' meshes in JAXTHERMO_MESHES or ../shared/meshes, by name."""
    named = os.environ.get("JAXTHERMO_MESHES", "../shared/meshes")
    folders = [Path(folder) for folder in named.split(os.pathsep) if folder]
    # The first folder that has a file wins, as in a search path.
    files: dict[str, Path] = {}
    for name, file in _FILES.items():
        for folder in folders:
            if name not in files and (folder / file).is_file():
                files[name] = folder / file
    return files


def thesis_meshes() -> dict[str, Mesh]:
    """The thesis' meshes that are found, by name; the figurine if none is."""
    meshes = {
        name: load_mesh(path, height=HEIGHT, up="y")
        for name, path in mesh_files().items()
    }
    return meshes or {"figurine": figurine(HEIGHT)}


def voxels_high(
    mesh: Mesh, height: int, surface_cells: SurfaceCells = "crossings"
) -> jt.VoxelGrid:
    """The voxels of a mesh, `height` of them along up."""
    extent = float(np.ptp(mesh.bounds[:, 2]))
    return jt.voxelize(mesh, extent / height, surface_cells)


def statue(height: int) -> tuple[str, jt.VoxelGrid]:
    """Name and voxels of the first of the meshes, `height` voxels high."""
    name, mesh = next(iter(thesis_meshes().items()))
    return name, jt.voxelize(mesh, HEIGHT / height)


def standard_scene(
    structure: AbstractStructure,
    factor: float | int = 1.0,
    sunset: float | None = END / 2,
) -> jt.Scene:
    """A body of steel in air, in the sun from +x.

    Args:
        structure: of the body.
        factor: by which conductivity, irradiance and heat transfer coefficient are
            multiplied, so that scenes differ only in their numbers.
        sunset: time at which the sun goes [s]; None if it stays.
    """
    irradiance = 5000.0 * factor
    sun = irradiance if sunset is None else jt.Until(irradiance, sunset)
    terms = (
        jt.Sun((-1.0, 0.0, 0.0), sun),
        jt.Convection(10.0 * factor, START),
    )
    body = jt.Body(structure, _steel(factor), temperature=START)
    return jt.Scene((body,), terms)
