"""`jaxthermo voxelize`: what a mesh becomes at a pitch, without a simulation."""

import json
from pathlib import Path

from rich.console import Console

from ..atomic import replacing
from ..config import units
from ..errors import InputError
from ..geometry.load import load_mesh
from ..geometry.verdict import describe_mesh, verdict_line
from ..voxels.report import voxel_report
from ..voxels.voxelize import voxelize as make_voxels
from .files import prepare_folder
from .layer_sheets import write_layer_sheets


def voxelize(
    mesh: Path, pitch: str, unit: str | None, height: str | None, up: str, out: Path
) -> None:
    """Writes `voxels.json` and sheets of the depth layers; prints two lines about them.

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
    facts = {"mesh": describe_mesh(loaded), **voxel_report(grid)}
    with replacing(folder / "voxels.json") as path:
        path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    sheets = write_layer_sheets(grid, folder)
    console = Console(highlight=False, soft_wrap=True)
    console.print(verdict_line(loaded), markup=False)
    console.print(
        f"{grid.solid_count} solid voxels of {edge:g} m, "
        f"{len(grid.fragment_area)} surface fragments; {folder / 'voxels.json'} "
        f"and {len(sheets)} sheets of layers",
        markup=False,
    )


def _length(option: str, text: str) -> float:
    try:
        value = units.to_si(text, units.LENGTH)
    except InputError as error:
        raise InputError(f"{option}: {error}") from error
    if value <= 0.0:
        raise InputError(f"{option}: must be more than 0, got '{text}'")
    return value
