"""Thin parts: surface with less than one voxel behind it, and what is lost of it."""

from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np
from jaxtyping import Bool, Float, Int


# Thin fragments within a cube of this many cells per edge are one region.
_REGION = 8


class ThinRegion(TypedDict):
    """A part of the surface with less than a voxel behind it."""

    centre_m: list[float]
    thickness_m: float | None
    """None where a ray meets no far side."""
    area_m2: float
    lost_share: float
    """Fraction of the area without any voxel [-]."""


@dataclass(frozen=True, eq=False)
class ThinParts:
    """Parts thinner than a voxel along a ray, and those lost without any voxel."""

    thin_fragments: int
    thin_area: float
    """Area of the fragments on parts less than one voxel thick [m^2]."""
    lost_fragments: int
    lost_area: float
    """Area of the fragments without a solid voxel nearby [m^2]."""
    regions: tuple[ThinRegion, ...]
    """Largest thin regions."""
    thin_voxel: Int[np.ndarray, "t 3"] = field(
        default_factory=lambda: np.zeros((0, 3), np.int64)
    )
    """Cells of the solid voxels that the thin fragments belong to."""
    lost_position: Float[np.ndarray, "l 3"] = field(
        default_factory=lambda: np.zeros((0, 3))
    )
    """Positions of the lost fragments in the body's frame [m]."""

    @classmethod
    def of(
        cls,
        position: Float[np.ndarray, "s 3"],
        thickness: Float[np.ndarray, " s"],
        area: Float[np.ndarray, " s"],
        lost: Bool[np.ndarray, " s"],
        cell: Int[np.ndarray, "s 3"],
        pitch: float,
        max_regions: int = 10,
    ) -> "ThinParts":
        """Sum up the fragments with less than one voxel behind them, by region."""
        thin = lost | (thickness < pitch)
        blocks, inverse = np.unique(cell[thin] // _REGION, axis=0, return_inverse=True)
        total = np.bincount(inverse, weights=area[thin], minlength=len(blocks))
        gone = np.bincount(inverse, weights=(area * lost)[thin], minlength=len(blocks))
        regions = []
        for block in np.argsort(-total)[:max_regions]:
            members = np.flatnonzero(thin)[inverse == block]
            regions.append(
                ThinRegion(
                    centre_m=[round(float(c), 6) for c in position[members].mean(0)],
                    thickness_m=round(float(thickness[members].min()), 9),
                    area_m2=float(total[block]),
                    lost_share=float(gone[block] / total[block]),
                )
            )
        return cls(
            thin_fragments=int(thin.sum()),
            thin_area=float(area[thin].sum()),
            lost_fragments=int(lost.sum()),
            lost_area=float(area[lost].sum()),
            regions=tuple(regions),
            thin_voxel=np.unique(cell[thin & ~lost], axis=0),
            lost_position=position[lost],
        )
