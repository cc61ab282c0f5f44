"""The error of a run by itself, from two coarser ones: Richardson extrapolation."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import root_scalar

from ..errors import InputError
from ..module import Module
from .surface_error import AnySolution
from .truth_error import truth_error


# The surface is of first, the interior of second order. Below half an order little is
# gained by finer voxels, and the error may be many times the difference; beyond the
# third two differences are small or large by chance.
_ORDERS = (0.5, 3.0)
"""Observed orders from which is extrapolated."""

_MAX_RATIO_CHANGE = 1.01
"""Ratio of two bodies' refinements up to which they are one."""


class DiscretizationError(Module):
    """Estimate of the error of the finest of three runs, at each saved time after 0."""

    times: Float[np.ndarray, " t"]
    """[s]"""
    rms_kelvin: Float[np.ndarray, " t"]
    """Estimated root mean square over the surface; a bound where `is_bound` [K]."""
    rms_percent: Float[np.ndarray, " t"]
    """The same over the range of the finest run, as of `truth_error` [%]."""
    order: Float[np.ndarray, " t"]
    """Observed order of convergence; NaN where the runs have none."""
    is_bound: Bool[np.ndarray, " t"]
    """True where the observed order is below 0.5 or above 3: the larger of the two
    differences is given instead, which errors that fall more slowly may exceed."""
    differences: Float[np.ndarray, "t 2"]
    """Finest to middle and middle to coarsest run, root mean square [K]."""

    @property
    def worst_rms_kelvin(self) -> float:
        """Largest `rms_kelvin` of the saved times [K]."""
        return float(self.rms_kelvin.max())

    def as_dict(self) -> dict[str, Any]:
        """Return all numbers as plain types for JSON; None for what is not finite."""
        plain = lambda values: [float(v) if np.isfinite(v) else None for v in values]
        columns = ("times", "rms_kelvin", "rms_percent", "order")
        found: dict[str, Any] = {name: plain(getattr(self, name)) for name in columns}
        found["times_s"] = found.pop("times")
        found["is_bound"] = self.is_bound.tolist()
        found["differences_kelvin"] = self.differences.tolist()
        return {**found, "worst_rms_kelvin": self.worst_rms_kelvin}


def discretization_error(
    finest: AnySolution,
    middle: AnySolution,
    coarsest: AnySolution,
    count: int = 10_000,
    seed: int = 0,
) -> DiscretizationError:
    """Estimate the error of a run from two runs with coarser voxels.

    With pitches h1 < h2 < h3 and differences D12, D23 of neighbouring runs (root mean
    square over points of the surface, as `truth_error` reads them), errors c h^p give

        (h3^p - h2^p) / (h2^p - h1^p) = D23 / D12,    error = D12 / ((h2 / h1)^p - 1)

    at each time, with its own p. Where p is not within 0.5 to 3, as where differences
    grow with finer voxels, the larger difference is given and marked as a bound.

    Args:
        finest: the run whose error is estimated.
        middle: the same scene and structure with larger voxels.
        coarsest: with still larger ones; a factor of 2 each time serves well.
        count: number of points, on all bodies together.
        seed: of the points.

    Raises:
        InputError: if the voxels do not become larger, by one factor for all bodies, or
            the runs cannot be compared.

    Source:
        P. J. Roache, Verification and Validation in Computational Science, 1998.
    """
    first = _ratio(finest, middle)
    second = _ratio(middle, coarsest)
    fine = truth_error(middle, reference=finest, count=count, seed=seed)
    coarse = truth_error(coarsest, reference=middle, count=count, seed=seed)
    pairs = np.stack([fine.rms_kelvin, coarse.rms_kelvin], axis=1).astype(float)
    order = np.array(
        [_observed_order(a, coarse=b, first=first, second=second) for a, b in pairs]
    )
    # Runs that agree have no error, and no order either.
    agree = (pairs == 0).all(axis=1)
    is_bound = ~np.isfinite(order) & ~agree
    factor = np.where(is_bound | agree, 1.0, first**order - 1)
    kelvin = np.where(is_bound, pairs.max(axis=1), pairs[:, 0] / factor)
    # The range that the difference was divided by; no range, no percentage.
    per_kelvin = np.asarray(fine.rms_percent) / np.where(
        pairs[:, 0] > 0, pairs[:, 0], 1
    )
    return DiscretizationError(
        times=np.asarray(fine.times, float),
        rms_kelvin=kelvin,
        rms_percent=kelvin * per_kelvin,
        order=order,
        is_bound=is_bound,
        differences=pairs,
    )


def _ratio(finer: AnySolution, coarser: AnySolution) -> float:
    """Pitch of the coarser run over that of the finer one [-]."""
    pitches = lambda run: np.array([s.geometry.pitch for s in run.surfaces])
    if len(finer.surfaces) != len(coarser.surfaces):
        raise InputError("discretization_error: runs of one scene have equal bodies")
    ratios = pitches(coarser) / pitches(finer)
    low, high = float(ratios.min()), float(ratios.max())
    if not (low > 1 and high < _MAX_RATIO_CHANGE * low):
        raise InputError(
            "discretization_error: from one run to the next, the voxels become "
            f"{low:.4g} to {high:.4g} times as large: give the finest run first, and "
            "one factor above 1 for all bodies"
        )
    return float(ratios.mean())


def _observed_order(fine: float, coarse: float, first: float, second: float) -> float:
    """Order at which two differences have their ratio; NaN outside of `_ORDERS`."""
    # h2 is 1: the left side of the equation for p, which rises with it.
    ratio = lambda p: (second**p - 1) / (1 - first**-p)
    low, high = _ORDERS
    if not ratio(low) * fine <= coarse <= ratio(high) * fine or fine == 0:
        return np.nan
    excess = lambda p: ratio(p) - coarse / fine
    return float(root_scalar(excess, bracket=_ORDERS).root)
