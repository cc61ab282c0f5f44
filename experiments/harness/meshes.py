"""The meshes of the thesis and the standard scene, which several experiments use."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.load import load_mesh
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import figurine
from jaxthermo.voxels.voxelize import SurfaceCells


# Of every body [m].
HEIGHT = 0.5

STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, absorptivity=1.0)

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
    """The voxels of a mesh, so many of them along up."""
    extent = float(np.ptp(mesh.bounds[:, 2]))
    return jt.voxelize(mesh, extent / height, surface_cells)


def standard_scene(
    material: jt.Material,
    structure: Callable[..., Any],
    height: int,
    sun_until: float = 90.0,
    surface_cells: SurfaceCells = "crossings",
) -> tuple[jt.Scene, str]:
    """A statue in air, in the sun from +x until a time [s]; the name of its mesh."""
    name, mesh = next(iter(thesis_meshes().items()))
    grid = jt.voxelize(mesh, HEIGHT / height, surface_cells)
    body = jt.Body(structure(grid), material, temperature=START)
    terms = (
        jt.Sun((-1.0, 0.0, 0.0), jt.Until(5000.0, sun_until)),
        jt.Convection(10.0, START),
    )
    return jt.Scene((body,), terms), name
