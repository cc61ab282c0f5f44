"""The local Nusselt number around a cylinder, and the points that it was made from."""

import csv
import functools
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import cylinder_table, profile

from .exhibit import Numbers


_DATA = Path(__file__).with_name("data") / "nu_local_cylinder.csv"
PRANDTL = 0.71
"""Prandtl number of air, as in figure 5.6."""
DEGREES = np.arange(0.0, 180.5, 0.5)
"""Angles from the front."""
FAST = (7.08e4, 1.013e5, 1.4e5, 1.7e5, 2.19e5)
"""Reynolds numbers of figure 5.6."""


def local_number(
    degrees: Float[np.ndarray, " a"],
    reynolds: float,
    prandtl: float = PRANDTL,
    average: Callable = profile,
) -> Float[np.ndarray, " a"]:
    """Local Nusselt numbers at angles from the front, on the level of an average."""
    # The mismatch of an average is rounding only, which float32 would hide.
    with jax.enable_x64(True):
        return np.asarray(_local_number(degrees, reynolds, prandtl, average=average))


@functools.partial(jax.jit, static_argnames="average")
def _local_number(degrees, reynolds, prandtl, average):
    cosine = jnp.cos(jnp.radians(degrees))
    return local_nusselt(
        cosine,
        jnp.full(cosine.shape, reynolds),
        jnp.full(cosine.shape, prandtl),
        average,
    )


def mean_number(reynolds: float, prandtl: float = PRANDTL) -> float:
    """Average of the local number around the cylinder."""
    # Evenly spaced angles average cos kθ to 0 exactly for every k below their number.
    degrees = np.arange(64) * (360.0 / 64)
    return float(local_number(degrees, reynolds, prandtl).mean())


@functools.cache
def tabulated() -> list[dict[str, str]]:
    """Published points from which the shape was made, at low and at high Re."""
    with _DATA.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def measure_knots() -> list[Numbers]:
    """Each knot: how the average holds, the minima, the distance from the data."""
    table = cylinder_table()
    columns = zip(table.reynolds, table.average, table.recalled, strict=True)
    return [
        _knot(float(reynolds), float(average), recalled=bool(recalled))
        for reynolds, average, recalled in columns
    ]


def _knot(reynolds: float, average: float, *, recalled: bool) -> Numbers:
    local = local_number(DEGREES, reynolds)
    inner = local[1:-1]
    is_minimum = (inner < local[:-2]) & (inner <= local[2:])
    errors = []
    for row in tabulated():
        if float(row["Re"]) == reynolds:
            interpolated = np.interp(float(row["theta_deg"]), DEGREES, local)
            errors.append(abs(interpolated - float(row["Nu"])))
    return {
        "Re": reynolds,
        "average": average,
        "average_mismatch": mean_number(reynolds) / average - 1,
        # A laminar stagnation point has one constant over Re.
        "front_over_sqrt_Re": float(local[0] / np.sqrt(reynolds)),
        "rear_over_front": float(local[-1] / local[0]),
        "minima_deg": DEGREES[1:-1][is_minimum].tolist(),
        "off_data_of_average": max(errors) / average if errors else None,
        "recalled": recalled,
    }
