"""The local Nusselt number around a cylinder, as tabulated: `data/README.md`."""

import csv
import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


PROFILE_PRANDTL = 0.71
"""Of the air that the table was made for."""

_FILE = Path(__file__).parents[2] / "data" / "nu_shape_cosine_coeffs.csv"


class CylinderKnots(NamedTuple):
    """Nu(theta) = average (1 + sum_k shape_k cos k theta) at each Re."""

    reynolds: Float[np.ndarray, " n"]
    average: Float[np.ndarray, " n"]
    shape: Float[np.ndarray, "n k"]
    recalled: Bool[np.ndarray, " n"]
    """From memory of a published figure, +-15 %, not measured or computed."""


@functools.cache
def cylinder_knots() -> CylinderKnots:
    """The whole table, in the order of Re."""
    with _FILE.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    column = lambda name: np.array([float(row[name]) for row in rows])
    harmonics = [name for name in rows[0] if name.startswith("c")]
    return CylinderKnots(
        reynolds=column("Re"),
        average=column("Nbar_profile"),
        shape=np.stack([column(name) for name in harmonics], axis=1),
        recalled=np.array([row["provenance"].startswith("recalled") for row in rows]),
    )
