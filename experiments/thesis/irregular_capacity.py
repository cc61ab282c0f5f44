"""Claim C15: overlap and cracks change the irregular structure's capacity (6.1)."""

from typing import Any

import numpy as np
from rich.table import Table

from jaxthermo.geometry.mesh import Mesh
from jaxthermo.structures.kinds.irregular import IrregularMultiLevel, capacity_by_region
from jaxthermo.structures.report import structure_report
from jaxthermo.voxels.voxelize import voxelize


HEIGHT = 250
"""Voxels along up: the thesis' 100 x 250 x 100."""
REGION = 16
"""Voxels along an edge of a region."""
THESIS_LEVELS = 7


def measure_capacity(mesh: Mesh, height: int = HEIGHT) -> dict[str, Any]:
    """Capacity over volume, of the body and region by region.

    Args:
        mesh: the Happy Buddha, if it is at hand.
        height: voxels along up.
    """
    grid = voxelize(mesh, float(np.ptp(mesh.bounds[:, 2])) / height)
    plain = IrregularMultiLevel(grid)
    kept = IrregularMultiLevel(grid, keep_capacity=True)
    cells, body = capacity_by_region(grid, plain.cover_count(), REGION)
    ratio = cells[body > 0] / body[body > 0]
    share = body[body > 0] / body.sum()
    return {
        "structure": structure_report(plain),
        "levels": {"thesis": THESIS_LEVELS, "ours": plain.level_count},
        "capacity_ratio": plain.capacity_ratio,
        "capacity_ratio_kept": kept.capacity_ratio,
        "regions": {
            "width_voxels": REGION,
            "count": len(ratio),
            "capacity_ratio": _spread(ratio, share),
            "capacity_ratio_kept": _spread(ratio / plain.capacity_ratio, share),
        },
        "map": _map(cells, body, grid.pitch),
    }


def _spread(ratio: np.ndarray, share: np.ndarray) -> dict[str, float]:
    """Of the regions' ratios, each region counting with its share of the body."""
    order = np.argsort(ratio)
    below = np.cumsum(share[order])
    found = {
        f"percentile_{percent}": float(
            ratio[order][np.searchsorted(below, percent / 100)]
        )
        for percent in (5, 25, 50, 75, 95)
    }
    rms = float(np.sqrt((share * (ratio - 1) ** 2).sum()))
    off = float(share[np.abs(ratio - 1) > 0.1].sum())
    return {**found, "rms_from_1": rms, "share_of_body_10_percent_off": off}


def _map(cells: np.ndarray, body: np.ndarray, pitch: float) -> dict[str, Any]:
    """Region numbers along x, y, z, and both volumes; only where there is either."""
    there = np.argwhere((cells > 0) | (body > 0))
    return {
        "region_edge_m": REGION * pitch,
        "region": there.tolist(),
        "cells_m3": cells[tuple(there.T)].tolist(),
        "body_m3": body[tuple(there.T)].tolist(),
    }


def capacity_table(result: dict[str, Any], name: str) -> Table:
    """For the terminal."""
    shares = result["structure"]["share_of_body_volume"]
    regions = result["regions"]
    table = Table(title=f"C15: capacity of the irregular {name}, {HEIGHT} high")
    table.add_column("")
    for head in ("as in the thesis", "total kept"):
        table.add_column(head, justify="right")
    table.add_row("levels (thesis 7)", str(result["levels"]["ours"]), "")
    table.add_row(
        "capacity / the body's",
        f"{result['capacity_ratio']:.4f}",
        f"{result['capacity_ratio_kept']:.4f}",
    )
    for key, text in (
        ("percentile_5", "in regions: 5th percentile"),
        ("percentile_95", "in regions: 95th percentile"),
        ("rms_from_1", "in regions: RMS from 1"),
    ):
        values = [regions[k][key] for k in ("capacity_ratio", "capacity_ratio_kept")]
        table.add_row(text, *(f"{value:.3f}" for value in values))
    for key, value in shares.items():
        table.add_row(f"{key}, of the body", f"{value:.2%}", "")
    return table
