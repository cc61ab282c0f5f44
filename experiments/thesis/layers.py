"""Depth layers of a body: their numbers, and how often a surface is stored."""

from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.report.table import Table
from jaxthermo.voxels.lattice import peel_axes, pixel_axes
from jaxthermo.voxels.surface import surface_voxels

from .bodies import AXES, Statue
from .exhibit import Row, Verdict


# Largest error of the area, and fraction of voxels that may be stored twice [-].
_AREA, _TWICE = 0.02, 0.1

Counts = tuple[int, int, int]
"""Numbers of layers along the thesis' x, y and z."""


def layer_counts(grid: jt.VoxelGrid) -> tuple[Counts, Counts]:
    """Numbers of layers as peeled, and stored once and packed."""
    peeled, packed = grid.layers.peeled, grid.layers.packed
    order = tuple(AXES.values())
    x, y, z = order
    return (peeled[x], peeled[y], peeled[z]), (packed[x], packed[y], packed[z])


def shown(counts: Counts) -> str:
    """Counts as the thesis writes them: "18/20/8"."""
    return "/".join(map(str, counts))


def count_by_height(statue: Statue, heights: tuple[int, ...]) -> list[dict[str, Any]]:
    """Layers at several resolutions."""
    rows = []
    for height in heights:
        grid = statue.grid(height, "dominant_axis")
        peeled, packed = layer_counts(grid)
        x, y, z = (grid.lattice.shape[axis] for axis in AXES.values())
        rows.append(
            {
                "mesh": statue.name,
                "lattice": f"{x} x {y} x {z}",
                "peeled": list(peeled),
                "packed": list(packed),
                "packed_over_peeled": sum(packed) / sum(peeled),
            }
        )
    return rows


def count_table(rows: list[dict[str, Any]]) -> Table:
    """The layers at several resolutions, a line each."""
    lines = [
        [
            row["mesh"],
            row["lattice"],
            shown(row["peeled"]),
            str(sum(row["peeled"])),
            shown(row["packed"]),
            str(sum(row["packed"])),
            f"{row['packed_over_peeled']:.2f}",
        ]
        for row in rows
    ]
    columns = ["mesh", "voxels", "peeled x/y/z", "sum", "packed x/y/z", "sum", "ratio"]
    return Table(columns, lines, "Layers by resolution", left=(0, 1))


def deep_fraction(grid: jt.VoxelGrid, axis: str, beyond: int) -> float:
    """Fraction of the fragments of a view that lie beyond some layers [-]."""
    layers = peel_axes(grid.mesh, grid.lattice)[AXES[axis]]
    return float(np.mean(layers.layer >= beyond))


def storage(grid: jt.VoxelGrid) -> dict[str, float]:
    """Texels for each voxel of the surface before and after duplicates are removed.

    Of a grid with `surface_cells="dominant_axis"`.
    """
    peeled, cells = 0, []
    for axis, layers in enumerate(peel_axes(grid.mesh, grid.lattice)):
        row_axis, column_axis = pixel_axes(axis)
        cell = np.zeros((len(layers.pixel), 3), np.int64)
        cell[:, row_axis], cell[:, column_axis] = np.divmod(layers.pixel, layers.width)
        cell[:, axis] = np.floor(layers.depth)
        cells.append(cell)
        peeled += len(cell)
    every = _distinct(np.concatenate(cells))
    position = grid.lattice.to_cells(grid.fragment_position)
    own = np.floor(position).astype(np.int64)
    stored = _distinct(own)
    shell = surface_voxels(grid.solid)
    kept = _distinct(grid.fragment_voxel)
    surface = {tuple(voxel) for voxel in shell.tolist()}
    held = {tuple(voxel) for voxel in kept.tolist()}
    return {
        "texels_peeled": peeled,
        "voxels_peeled": len(every),
        "texels_for_a_voxel_peeled": peeled / len(every),
        "texels_stored": len(own),
        "voxels_stored": len(stored),
        "texels_for_a_voxel_stored": len(own) / len(stored),
        "stored_over_peeled": len(own) / peeled,
        "shell_voxels": len(shell),
        "shell_voxels_with_a_texel": len(surface & held) / len(shell),
        "texels_outside_the_shell": len(held - surface) / len(held),
        "area_over_the_mesh": 1 / grid.area_ratio,
        "area_of_square_texels_over_the_mesh": (
            len(own) * grid.pitch**2 / grid.mesh.area
        ),
    }


def _distinct(cells: np.ndarray) -> np.ndarray:
    return np.unique(cells, axis=0)


def storage_rows(found: dict[str, float]) -> tuple[Row, ...]:
    """Findings of `storage`, beside the thesis' words."""
    percent = lambda key: f"{found[key]:.1%}"
    return (
        Row(
            "texels for each voxel of the surface, as peeled from three sides",
            "some rendered more than once",
            found["texels_for_a_voxel_peeled"],
        ),
        Row(
            "the same, kept by the largest component of the normal",
            "1, each voxel once",
            found["texels_for_a_voxel_stored"],
            "the seams between two axes are there twice",
        ),
        Row("texels kept of those peeled", None, percent("stored_over_peeled")),
        Row(
            "voxels of the shell that hold a texel",
            "all",
            percent("shell_voxels_with_a_texel"),
        ),
        Row(
            "area h² / max |n| of the texels over the mesh's",
            None,
            found["area_over_the_mesh"],
            "within 2 % asked",
        ),
        Row(
            "area h² of the texels over the mesh's, as in the thesis",
            None,
            found["area_of_square_texels_over_the_mesh"],
            "a texel stands for more surface the more it is inclined",
        ),
    )


def judged(name: str, found: dict[str, float]) -> tuple[Verdict, str]:
    """Verdict on "each piece of surface once" for a body, and the reason."""
    twice = found["texels_for_a_voxel_stored"] - 1
    missing = 1 - found["shell_voxels_with_a_texel"]
    area = found["area_over_the_mesh"]
    reason = (
        f"{name}: {found['texels_for_a_voxel_peeled']:.2f} texels for each voxel "
        f"become {found['texels_for_a_voxel_stored']:.3f}: {twice:.1%} are still there "
        "twice, at the seams where the largest component changes, and "
        f"{missing:.1%} of the shell's voxels hold none. Each piece of surface is "
        f"there once: the areas h² / max |n| sum up to {area:.4f} of the mesh's."
    )
    exact = twice < 1e-3 and missing < 1e-3
    near = abs(area - 1) <= _AREA and twice < _TWICE
    good = Verdict.REPRODUCED if exact else Verdict.DIFFERENT
    return (good if near else Verdict.CONTRADICTED), reason
