"""The thin-part report: what is under one voxel thick, and what of it is lost."""

import numpy as np
from jaxtyping import Bool, Float, Int

from .grid import ThinParts


BLOCK = 8
"""Thin fragments within a block of this many cells are reported as one place."""


def report_thin_parts(
    position: Float[np.ndarray, "s 3"],
    thickness: Float[np.ndarray, " s"],
    area: Float[np.ndarray, " s"],
    lost: Bool[np.ndarray, " s"],
    cell: Int[np.ndarray, "s 3"],
    pitch: float,
    most: int = 10,
) -> ThinParts:
    """Sum up fragments with less than one voxel behind them, by place.

    Args:
        position: of every fragment [m].
        thickness: of the body behind it, along its normal [m].
        area: true area [m^2].
        lost: whether no solid voxel is near.
        cell: lattice cell of the fragment.
        pitch: edge of a voxel [m].
        most: how many places to name.
    """
    thin = lost | (thickness < pitch)
    blocks, inverse = np.unique(cell[thin] // BLOCK, axis=0, return_inverse=True)
    total = np.bincount(inverse, weights=area[thin], minlength=len(blocks))
    gone = np.bincount(inverse, weights=(area * lost)[thin], minlength=len(blocks))
    places = []
    for block in np.argsort(-total)[:most]:
        members = np.flatnonzero(thin)[inverse == block]
        places.append(
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
        places=tuple(places),
    )
