"""Thin walls: surface with less than one voxel behind it, and what is lost of it."""

import numpy as np
from jaxtyping import Bool, Float, Int

from .grid import ThinParts


# Thin fragments within a cube of this many cells per edge are one region.
_REGION = 8


def thin_parts(
    position: Float[np.ndarray, "s 3"],
    thickness: Float[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    lost: Bool[np.ndarray, " s"],
    cell: Int[np.ndarray, "s 3"],
    pitch: float,
    max_regions: int = 10,
) -> ThinParts:
    """Sum up the fragments with less than one voxel behind them, by region."""
    thin = lost | (thickness < pitch)
    blocks, inverse = np.unique(cell[thin] // _REGION, axis=0, return_inverse=True)
    total = np.bincount(inverse, weights=area[thin], minlength=len(blocks))
    gone = np.bincount(inverse, weights=(area * lost)[thin], minlength=len(blocks))
    regions = []
    for block in np.argsort(-total)[:max_regions]:
        members = np.flatnonzero(thin)[inverse == block]
        regions.append(
            {
                "centre_m": [round(float(c), 6) for c in position[members].mean(0)],
                "thickness_m": round(float(thickness[members].min()), 9),
                "area_m2": float(total[block]),
                "lost_share": float(gone[block] / total[block]),
            }
        )
    return ThinParts(
        thin_fragments=int(thin.sum()),
        thin_area=float(area[thin].sum()),
        lost_fragments=int(lost.sum()),
        lost_area=float(area[lost].sum()),
        regions=tuple(regions),
        thin_voxel=np.unique(cell[thin & ~lost], axis=0),
        lost_position=position[lost],
    )
