"""`jaxthermo voxelize`: what a mesh becomes at a pitch, without a simulation."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from ..atomic import replacing
from ..config import units
from ..errors import InputError
from ..geometry.load import load_mesh
from ..geometry.mesh import Mesh
from ..geometry.verdict import describe_mesh, verdict_line
from ..voxels.grid import VoxelGrid
from ..voxels.voxelize import voxelize as make_voxels
from .files import prepare_folder


def voxelize(
    mesh: Path, pitch: str, unit: str | None, height: str | None, up: str, out: Path
) -> None:
    """Writes `voxels.json` and prints a line about the mesh and one about the voxels.

    Args:
        mesh: the file.
        pitch: edge of a voxel, such as "2 mm".
        unit: length of one file unit.
        height: extent along up, such as "0.5 m", instead of the unit.
        up: the file's axis that points up.
        out: the folder for the results.
    """
    edge = _length("--pitch", pitch)
    target = None if height is None else _length("--height", height)
    loaded = load_mesh(mesh, unit=unit, height=target, up=up)
    folder = prepare_folder(out)
    grid = make_voxels(loaded, pitch=edge)
    with replacing(folder / "voxels.json") as path:
        text = json.dumps(voxel_facts(loaded, grid), indent=2)
        path.write_text(text + "\n", encoding="utf-8")
    console = Console(highlight=False, soft_wrap=True)
    console.print(verdict_line(loaded), markup=False)
    console.print(
        f"{grid.solid_count} solid voxels of {edge:g} m, "
        f"{len(grid.fragment_area)} surface fragments; {folder / 'voxels.json'}",
        markup=False,
    )


def voxel_facts(mesh: Mesh, grid: VoxelGrid) -> dict[str, Any]:
    """What `voxels.json` holds, as plain types; SI units."""
    return {
        "mesh": describe_mesh(mesh),
        "pitch": grid.pitch,
        "shape": list(grid.lattice.shape),
        "origin": [float(c) for c in grid.origin],
        "solid_voxels": grid.solid_count,
        "fragments": len(grid.fragment_area),
        "area_ratio": grid.area_ratio,
        "volume_ratio": grid.volume_ratio,
        "layers": asdict(grid.layers),
        "thin": asdict(grid.thin),
    }


def _length(option: str, text: str) -> float:
    try:
        value = units.to_si(text, units.LENGTH)
    except InputError as error:
        raise InputError(f"{option}: {error}") from error
    if value <= 0.0:
        raise InputError(f"{option}: must be more than 0, got '{text}'")
    return value
