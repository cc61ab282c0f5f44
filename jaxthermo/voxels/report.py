"""Report of a voxel grid as plain types, for `voxels.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from .grid import VoxelGrid
from .surface import surface_links, surface_voxels


def voxel_report(grid: VoxelGrid) -> dict[str, Any]:
    """Counts, layers, true areas and volumes, and thin parts; units in the keys.

    Axes have z up; `file_axis` is the name of each in the mesh file.
    """
    surface = surface_voxels(grid.solid)
    links = surface_links(surface, grid.lattice.shape)
    return {
        "pitch_m": grid.pitch,
        "lattice_shape": list(grid.lattice.shape),
        "lattice_origin_m": [float(c) for c in grid.origin],
        "solid_voxels": grid.solid_count,
        "solid_share_of_lattice": grid.solid_count / grid.lattice.cells,
        "surface_voxels": len(surface),
        "surface_links": len(links),
        "fragments": len(grid.fragment_area),
        "layers": _layers(grid),
        **_true_sizes(grid),
        "thin_parts": _thin_parts(grid),
    }


def _layers(grid: VoxelGrid) -> dict[str, dict]:
    counts = zip(grid.layers.peeled, grid.layers.packed, grid.mesh.axes, strict=True)
    return {
        axis: {"file_axis": name, "peeled": peeled, "packed": packed}
        for axis, (peeled, packed, name) in zip("xyz", counts, strict=True)
    }


def _true_sizes(grid: VoxelGrid) -> dict[str, Any]:
    """Area and volume of the mesh and of the voxels, and the ratios between them."""
    watertight = grid.mesh.is_watertight
    return {
        "area_m2": {
            "mesh": grid.mesh.area,
            "fragments_unscaled": float(grid.fragment_area.sum() / grid.area_ratio),
        },
        "volume_m3": {
            "mesh": grid.mesh.volume if watertight else None,
            "voxels_unscaled": grid.solid_count * grid.pitch**3,
        },
        "area_ratio": grid.area_ratio,
        "volume_ratio": grid.volume_ratio,
        "ratios_applied": not grid.unscaled_because,
        "ratios_not_applied_because": grid.unscaled_because or None,
    }


def _thin_parts(grid: VoxelGrid) -> dict[str, Any]:
    thin = asdict(grid.thin)
    regions = [_finite(region) for region in thin.pop("regions")]
    return {
        "thinner_than_a_voxel": {
            "fragments": thin["thin_fragments"],
            "area_m2": thin["thin_area"],
        },
        "lost_for_want_of_a_voxel": {
            "fragments": thin["lost_fragments"],
            "area_m2": thin["lost_area"],
        },
        "largest_places": regions,
    }


def _finite(region: dict) -> dict:
    # JSON has no infinity, which stands for an unknown thickness (no far side).
    thickness = region["thickness_m"]
    return {**region, "thickness_m": thickness if np.isfinite(thickness) else None}
