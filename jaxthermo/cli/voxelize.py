"""`jaxthermo voxelize`: the voxels of a mesh at a pitch, without a simulation."""

import json
from pathlib import Path
from typing import cast, get_args

from ..atomic import write_text
from ..choices import UpAxis
from ..config.types.quantities import LENGTH, to_si
from ..console.results_folder import results_folder
from ..console.terminal import open_console, print_line, status
from ..errors import InputError, located
from ..geometry.load import load_mesh
from ..geometry.mesh import describe_mesh, mesh_summary
from ..image.colour.annotate import write_png
from ..report.layer_sheets import write_layer_sheets
from ..report.table import Table
from ..report.voxel_sheet import voxel_sheet
from ..voxels.grid import VoxelReport, voxel_report
from ..voxels.represented import Represented
from ..voxels.voxelize import SurfaceCells, voxelize as make_voxels


def voxelize(
    mesh: Path,
    pitch: str,
    unit: str | None,
    height: str | None,
    up: str,
    surface_cells: str,
    out: Path,
) -> None:
    """Write `voxels.json`, `voxels.png` and sheets of the layers; print a summary."""
    # Options are checked before the mesh is read, which may take a while.
    edge = _length("--pitch", pitch)
    if surface_cells not in get_args(SurfaceCells):
        choices = " or ".join(get_args(SurfaceCells))
        raise InputError(f"--surface-cells {surface_cells}: choose {choices}")
    if (unit is None) == (height is None):
        raise InputError(f"{mesh}: give either --unit, such as mm, or --height")
    target = None if height is None else _length("--height", height)
    loaded = load_mesh(mesh, unit=unit, height=target, up=cast(UpAxis, up))
    console = open_console()
    print_line(console, mesh_summary(loaded))
    with results_folder(out) as folder:
        with status(console, "voxelizing"):
            grid = make_voxels(loaded, edge, cast(SurfaceCells, surface_cells))
            report = voxel_report(grid)
            facts = {"mesh": describe_mesh(loaded), **report}
            write_text(folder / "voxels.json", json.dumps(facts, indent=2) + "\n")
            write_png(folder / "voxels.png", voxel_sheet(grid))
            sheets = write_layer_sheets(grid, folder)
        for line in _lines(report, grid.represented):
            print_line(console, line)
        columns = ("depth layers along", "in the file", "peeled", "packed")
        rows = [
            (axis, row["file_axis"], str(row["peeled"]), str(row["packed"]))
            for axis, row in report["layers"].items()
        ]
        console.print(Table(columns, rows, left=(), framed=False).rich())
        print_line(
            console,
            f"voxels.json, voxels.png with thin parts marked, and {len(sheets)} sheets "
            f"of layers in {folder}",
        )


def _lines(report: VoxelReport, represented: Represented | None) -> list[str]:
    shape = " x ".join(str(n) for n in report["lattice_shape"])
    why_not = report["ratios_not_applied_because"]
    scaling = (
        f"scaled to the mesh: areas by {report['area_ratio']:.4f}, "
        f"volumes by {report['volume_ratio']:.4f}"
    )
    if why_not and report["area_ratio"] != 1:
        scaling = f"areas scaled by {report['area_ratio']:.4f}, volumes as counted: "
        scaling += why_not
    elif why_not:
        scaling = f"areas and volumes as counted: {why_not}"
    thin = report["thin_parts"]["thinner_than_a_voxel"]
    lost = report["thin_parts"]["lost_for_want_of_a_voxel"]
    lines = [
        f"{report['solid_voxels']:,} solid voxels of "
        f"{report['pitch_m'] * 1e3:.4g} mm in "
        f"{shape} ({100 * report['solid_share_of_lattice']:.0f} %)",
        f"{report['surface_voxels']:,} surface voxels, "
        f"{report['surface_links']:,} links, {report['fragments']:,} surface fragments",
        *([] if represented is None else [represented.described()]),
        scaling,
        f"under one voxel thick: {thin['area_m2'] * 1e4:.4g} cm^2 of surface; "
        f"lost: {lost['area_m2'] * 1e4:.4g} cm^2",
    ]
    for thin_part in report["thin_parts"]["largest_places"][:3]:
        x, y, z = thin_part["centre_m"]
        area = thin_part["area_m2"] * 1e4
        line = f"  {area:.3g} cm^2 around ({x:.4g}, {y:.4g}, {z:.4g}) m"
        share = thin_part["lost_share"]
        if share:
            line += f", {100 * share:.0f} % lost"
        lines.append(line)
    return lines


def _length(option: str, text: str) -> float:
    with located(option):
        value = to_si(text, LENGTH)
    # A length has no sign for the parser of units.
    if value <= 0.0:
        raise InputError(f"{option}: must be more than 0, got '{text}'")
    return value
