"""Claim C06: voxels compress to 10-25 % (ch. 3, 6.3), and the counts of table 6.1."""

from typing import Any

import numpy as np
from rich.table import Table

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.structures.kinds.irregular import IrregularMultiLevel
from jaxthermo.structures.kinds.shell import SingleShell
from jaxthermo.voxels.voxelize import voxelize


HEIGHTS = (50, 100, 150, 200, 250)
"""Voxels along up."""

TABLE_HEIGHT = 550
TABLE = {
    "shell": 2.5e6,
    "multi_level": 2.8e7,
    "irregular": 3.2e6,
    "full_volume": 2.8e7,
}
"""Voxels of the Happy Buddha at 225 x 550 x 225, as table 6.1 has them."""
TIMES = {"shell": 13e-3, "multi_level": 50e-3, "irregular": 21e-3, "full_volume": 55e-3}
"""Of one simulation step there [s]; measured anew by other experiments."""


def count_heights(mesh: Mesh, heights: tuple[int, ...] = HEIGHTS) -> list[dict]:
    """Nodes of shell and irregular structure against body and box, by resolution.

    Args:
        mesh: the body.
        heights: voxels along up.
    """
    return [_count(mesh, height) for height in heights]


def count_table_6_1(mesh: Mesh, height: int = TABLE_HEIGHT) -> dict[str, Any]:
    """The thesis' counts beside ours, and what its own numbers say.

    Args:
        mesh: the Happy Buddha, if it is at hand.
        height: voxels along up.
    """
    ours = _count(mesh, height)
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


def _count(mesh: Mesh, height: int) -> dict[str, Any]:
    grid = voxelize(mesh, float(np.ptp(mesh.bounds[:, 2])) / height)
    body, box = grid.solid_count, grid.lattice.cells
    shell = SingleShell(grid).node_count
    irregular = IrregularMultiLevel(grid)
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


def compression_table(rows: dict[str, list[dict]]) -> Table:
    """For the terminal."""
    table = Table(title="C06: voxels kept, over those of the body and of its box")
    table.add_column("mesh", no_wrap=True)
    for head in ("high", "shell", "/ body", "/ box", "irregular", "/ body", "/ box"):
        table.add_column(head, justify="right")
    for name, counts in rows.items():
        for row in counts:
            table.add_row(
                name,
                str(row["height_voxels"]),
                str(row["shell"]),
                f"{row['shell_of_body']:.1%}",
                f"{row['shell_of_box']:.1%}",
                str(row["irregular"]),
                f"{row['irregular_of_body']:.1%}",
                f"{row['irregular_of_box']:.1%}",
            )
    table.caption = "claimed: 10-25 %"
    return table


def table_6_1(result: dict[str, Any], name: str) -> Table:
    """For the terminal."""
    ours, shape = result["ours"], result["ours"]["lattice_shape"]
    size = " x ".join(str(n) for n in shape)
    table = Table(title=f"Table 6.1, voxels: {name} at {size}")
    for head in ("", "thesis, 225 x 550 x 225", "ours"):
        table.add_column(head, justify="right" if head else "left")
    for row, thesis, count in (
        ("single shell", TABLE["shell"], ours["shell"]),
        ("irregular multi-level", TABLE["irregular"], ours["irregular"]),
        ("full volume", TABLE["full_volume"], ours["body"]),
        ("bounding box", result["thesis_box_cells"], ours["box"]),
    ):
        table.add_row(row, f"{thesis:.2g}", f"{count:.3g}")
    return table
