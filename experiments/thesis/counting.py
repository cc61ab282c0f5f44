"""Claims on counts: C05 (cubes), C06 and table 6.1 (compression), C15 (capacity)."""

from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import box
from jaxthermo.report.table import Table
from jaxthermo.structures.kinds.shell import capacity_by_region
from jaxthermo.structures.partition.assignment import nested_cells, voxel_depth
from jaxthermo.structures.report import structure_report

from ..harness.meshes import thesis_meshes, voxels_high
from ..harness.present import show, table_of


# Cubes of 8 to 256 voxels a side, over which a logarithm grows by 8/3.
_POWERS = range(3, 9)


def count_cubes(powers: range = _POWERS) -> dict[str, Any]:
    """Cells of cubes with n = 2^p voxels a side, and which law they follow.

    The level l of a cube has about 6 (n / 2^l)^2 cells, so the sum is 4/3 of the shell
    however many levels there are: n^2. Only if the depth, not the cells, doubled from
    level to level would n^2 log n come out.
    """
    rows = [_count_cells(1 << power) for power in powers]
    side = np.array([row["side_voxels"] for row in rows], float)
    cells = np.array([row["cells"] for row in rows], float)
    log_side, log_cells = np.log(side), np.log(cells)
    local = np.diff(log_cells) / np.diff(log_side)
    # d ln(n^2 log n) / d ln n = 2 + 1 / ln n, between the two largest cubes.
    with_log = np.diff(2 * log_side + np.log(log_side)) / np.diff(log_side)
    return {
        "rows": rows,
        "slope_fitted": float(np.polyfit(log_side, log_cells, 1)[0]),
        "slope_of_the_largest": float(local[-1]),
        "slope_claimed_there": float(with_log[-1]),
        "slope_of_the_largest_is_2": bool(abs(local[-1] - 2) <= 0.05),
        "growth_beyond_n2": _growth(cells / side**2),
        "growth_beyond_n2_claimed": _growth(log_side),
    }


def _growth(values: np.ndarray) -> float:
    # From the smallest cube to the largest.
    return float(values[-1] / values[0])


def _count_cells(side: int) -> dict[str, Any]:
    grid = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / side)
    levels = nested_cells(voxel_depth(grid))
    cells = sum(len(level) for level in levels)
    return {
        "side_voxels": side,
        "full_volume": grid.solid_count,
        "levels": len(levels),
        "shell": len(levels[0]),
        "cells": cells,
        "cells_over_shell": cells / len(levels[0]),
        "cells_over_n2": cells / side**2,
        "cells_over_n2_log2_n": cells / (side**2 * np.log2(side)),
    }


def cube_table(result: dict[str, Any]) -> Table:
    """Cells of cubes by their side, over the laws that they may follow."""
    columns = [
        ("n", "{side_voxels}"),
        ("levels", "{levels}"),
        ("shell", "{shell}"),
        ("cells", "{cells}"),
        ("/ shell", "{cells_over_shell:.3f}"),
        ("/ n^2", "{cells_over_n2:.2f}"),
        ("/ n^2 log2 n", "{cells_over_n2_log2_n:.2f}"),
    ]
    caption = "slope {slope_of_the_largest:.3f} between the largest two, "
    caption += "{slope_fitted:.3f} fitted to all; "
    caption += "n^2 log n: {slope_claimed_there:.3f} between the largest"
    title = "C05: irregular cells of a cube of side n"
    return table_of(result["rows"], columns, title, caption.format_map(result))


# Voxels along up.
_HEIGHTS = (50, 100, 150, 200, 250)

# Table 6.1: voxels of the Happy Buddha at 225 x 550 x 225, and the time of one step of
# each structure [s]. Its full volume is the whole box, 2.8e7 cells, the empty ones too.
_TABLE_HEIGHT = 550
_KINDS = ("shell", "multi_level", "irregular", "full_volume")
TABLE: dict[str, float] = dict(zip(_KINDS, (2.5e6, 2.8e7, 3.2e6, 2.8e7), strict=True))
TIMES: dict[str, float] = dict(zip(_KINDS, (13e-3, 50e-3, 21e-3, 55e-3), strict=True))


def _count_heights(mesh: jt.Mesh, heights: tuple[int, ...] = _HEIGHTS) -> list[dict]:
    """Nodes of shell and irregular structure against body and box, by resolution."""
    return [count_structures(voxels_high(mesh, n), n) for n in heights]


def _count_table_6_1(mesh: jt.Mesh, height: int = _TABLE_HEIGHT) -> dict[str, Any]:
    """The thesis' counts beside ours, and what its own numbers say."""
    ours = count_structures(voxels_high(mesh, height), height)
    return {
        "ours": ours,
        "thesis": TABLE,
        "thesis_box_cells": 225 * 550 * 225,
        "irregular_over_shell": {
            "thesis": TABLE["irregular"] / TABLE["shell"],
            "ours": ours["irregular"] / ours["shell"],
        },
        "irregular_over_full": {
            "thesis": TABLE["irregular"] / TABLE["full_volume"],
            "ours_of_body": ours["irregular_of_body"],
            "ours_of_box": ours["irregular_of_box"],
        },
        "thesis_times_faster_than_full": {
            name: TIMES["full_volume"] / time for name, time in TIMES.items()
        },
        "remark": "the thesis' full volume is its bounding box, empty cells included",
    }


def count_structures(grid: jt.VoxelGrid, height: int) -> dict[str, Any]:
    """Voxels of a body so many voxels high, and nodes of shell and irregular levels."""
    body, box = grid.solid_count, grid.lattice.cells
    shell = jt.SingleShell(grid).node_count
    irregular = jt.IrregularMultiLevel(grid)
    return {
        "height_voxels": height,
        "lattice_shape": list(grid.lattice.shape),
        "box": box,
        "body": body,
        "shell": shell,
        "irregular": irregular.node_count,
        "irregular_levels": irregular.level_count,
        "shell_of_body": shell / body,
        "shell_of_box": shell / box,
        "irregular_of_body": irregular.node_count / body,
        "irregular_of_box": irregular.node_count / box,
    }


def _compression_table(found: dict[str, list[dict]]) -> Table:
    rows = [{**row, "mesh": name} for name, counts in found.items() for row in counts]
    columns = [
        ("mesh", "{mesh}"),
        ("high", "{height_voxels}"),
        ("shell", "{shell}"),
        ("/ body", "{shell_of_body:.1%}"),
        ("/ box", "{shell_of_box:.1%}"),
        ("irregular", "{irregular}"),
        ("/ body", "{irregular_of_body:.1%}"),
        ("/ box", "{irregular_of_box:.1%}"),
    ]
    # The thesis does not say of which: both are shown.
    title = "C06: voxels kept, over those of the body and of its box"
    return table_of(rows, columns, title, "claimed: 10-25 %")


def _table_6_1(result: dict[str, Any], name: str) -> Table:
    ours = result["ours"]
    size = " x ".join(map(str, ours["lattice_shape"]))
    rows = [
        ("single shell", TABLE["shell"], ours["shell"]),
        ("irregular multi-level", TABLE["irregular"], ours["irregular"]),
        ("full volume", TABLE["full_volume"], ours["body"]),
        ("bounding box", result["thesis_box_cells"], ours["box"]),
    ]
    columns = ("", "thesis, 225 x 550 x 225", "ours")
    cells = [[row, f"{thesis:.2g}", f"{count:.3g}"] for row, thesis, count in rows]
    return Table(columns, cells, f"Table 6.1, voxels: {name} at {size}")


# Voxels along up, the thesis' 100 x 250 x 100 of the capacity, and its levels there.
_CAPACITY_HEIGHT = 250
_THESIS_LEVELS = 7
# Voxels along an edge of a region: some cells of the deepest level, so that the error
# is one of places and not of single cells.
_REGION = 16


def _measure_capacity(mesh: jt.Mesh, height: int = _CAPACITY_HEIGHT) -> dict[str, Any]:
    """Capacity over volume, of the body and region by region."""
    # Of whole voxels, as in the thesis.
    pitch = float(np.ptp(mesh.bounds[:, 2])) / height
    grid = jt.voxelize(mesh, pitch, "dominant_axis")
    plain = jt.IrregularMultiLevel(grid)
    kept = jt.IrregularMultiLevel(grid, keep_capacity=True)
    cells, body = capacity_by_region(grid, plain.cover_count(), _REGION)
    ratio = cells[body > 0] / body[body > 0]
    fraction = body[body > 0] / body.sum()
    return {
        "structure": structure_report(plain),
        "levels": {"thesis": _THESIS_LEVELS, "ours": plain.level_count},
        "capacity_ratio": plain.capacity_ratio,
        "capacity_ratio_kept": kept.capacity_ratio,
        "regions": {
            "width_voxels": _REGION,
            "count": len(ratio),
            "capacity_ratio": _spread(ratio, fraction),
            "capacity_ratio_kept": _spread(ratio / plain.capacity_ratio, fraction),
        },
        "map": _map(cells, body, grid.pitch),
    }


def _spread(ratio: np.ndarray, fraction: np.ndarray) -> dict[str, float]:
    # Quantiles of the regions, weighted by their fractions of the body's volume.
    order = np.argsort(ratio)
    below = np.cumsum(fraction[order])
    at = lambda percent: ratio[order][np.searchsorted(below, percent / 100)]
    found = {f"percentile_{p}": float(at(p)) for p in (5, 25, 50, 75, 95)}
    rms = float(np.sqrt((fraction * (ratio - 1) ** 2).sum()))
    off = float(fraction[np.abs(ratio - 1) > 0.1].sum())
    return {**found, "rms_from_1": rms, "share_of_body_10_percent_off": off}


def _map(cells: np.ndarray, body: np.ndarray, pitch: float) -> dict[str, Any]:
    # Region numbers along x, y, z, and both volumes; only where there is either.
    there = np.argwhere((cells > 0) | (body > 0))
    return {
        "region_edge_m": _REGION * pitch,
        "region": there.tolist(),
        "cells_m3": cells[tuple(there.T)].tolist(),
        "body_m3": body[tuple(there.T)].tolist(),
    }


def _capacity_table(result: dict[str, Any], name: str) -> Table:
    shares = result["structure"]["share_of_body_volume"]
    regions = result["regions"]
    both = ("capacity_ratio", "capacity_ratio_kept")
    quantiles = (
        ("percentile_5", "in regions: 5th percentile"),
        ("percentile_95", "in regions: 95th percentile"),
        ("rms_from_1", "in regions: RMS from 1"),
    )
    rows = [
        ["levels (thesis 7)", str(result["levels"]["ours"]), ""],
        ["capacity / the body's", *(f"{result[key]:.4f}" for key in both)],
        *([text, *(f"{regions[k][q]:.3f}" for k in both)] for q, text in quantiles),
        *([f"{key}, of the body", f"{value:.2%}", ""] for key, value in shares.items()),
    ]
    title = f"C15: capacity of the irregular {name}, {_CAPACITY_HEIGHT} high"
    return Table(("", "as in the thesis", "total kept"), rows, title)


def run() -> dict[str, Any]:
    """C05, C06, C15 and the counts of table 6.1."""
    cubes = count_cubes()
    show(cube_table(cubes))
    meshes = thesis_meshes()
    rows = {name: _count_heights(mesh) for name, mesh in meshes.items()}
    show(_compression_table(rows))
    # The Happy Buddha, or what stands in for it.
    name, mesh = next(iter(meshes.items()))
    table = _count_table_6_1(mesh)
    show(_table_6_1(table, name))
    capacity = _measure_capacity(mesh)
    show(_capacity_table(capacity, name))
    return {
        "meshes": {name: mesh.name for name, mesh in meshes.items()},
        "C05": cubes,
        "C06": rows,
        "table_6_1": {"mesh": name, **table},
        "C15": {"mesh": name, **capacity},
    }
