"""Claim C05: a cube of side n has n^2 log n voxels in the irregular structure (6.1)."""

from typing import Any

import numpy as np
from rich.table import Table

from jaxthermo.geometry.shapes import box
from jaxthermo.structures.build.assignment import nested_cells, voxel_depth
from jaxthermo.voxels.voxelize import voxelize


POWERS = range(3, 9)


def count_cubes(powers: range = POWERS) -> dict[str, Any]:
    """Cells of cubes with n = 2^p voxels a side, and which law they follow.

    The level l of a cube has about 6 (n / 2^l)^2 cells, so the sum is 4/3 of the shell
    however many levels there are: n^2. Only if the depth, not the cells, doubled from
    level to level would n^2 log n come out.

    Args:
        powers: p, two or more.
    """
    rows = [_count(1 << power) for power in powers]
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
    """From the smallest cube to the largest."""
    return float(values[-1] / values[0])


def _count(side: int) -> dict[str, Any]:
    grid = voxelize(box((1.0, 1.0, 1.0)), 1.0 / side)
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
    """For the terminal."""
    table = Table(title="C05: irregular cells of a cube of side n")
    for head in ("n", "levels", "shell", "cells", "/ shell", "/ n^2", "/ n^2 log2 n"):
        table.add_column(head, justify="right")
    for row in result["rows"]:
        table.add_row(
            str(row["side_voxels"]),
            str(row["levels"]),
            str(row["shell"]),
            str(row["cells"]),
            f"{row['cells_over_shell']:.3f}",
            f"{row['cells_over_n2']:.2f}",
            f"{row['cells_over_n2_log2_n']:.2f}",
        )
    table.caption = (
        f"slope {result['slope_of_the_largest']:.3f} between the largest two, "
        f"{result['slope_fitted']:.3f} fitted to all; "
        f"n^2 log n: {result['slope_claimed_there']:.3f} between the largest"
    )
    return table
