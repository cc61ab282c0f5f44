"""The error of a run by itself, from two coarser ones: Richardson extrapolation."""

import numpy as np
from equinox import Module
from jaxtyping import Bool, Float
from scipy.optimize import root_scalar

from ..errors import InputError
from .error_records import ReferenceErrors, finite_numbers
from .surface_error import AnySolution
from .truth_error import truth_error


# The surface is of first, the interior of second order. Below half an order little is
# gained by finer voxels, and the error may be many times the difference; beyond the
# third two differences are small or large by chance.
_ORDERS = (0.5, 3.0)
"""Lowest and highest observed order that is used for extrapolation."""

_MAX_RATIO_CHANGE = 1.01
"""Ratio of two bodies' refinements up to which they count as equal."""


class DiscretizationError(Module):
    """Estimate of the error of the finest of three runs, at each saved time after 0."""

    times: Float[np.ndarray, " t"]
    """[s]"""
    rms_kelvin: Float[np.ndarray, " t"]
    """Estimated root mean square over the surface; a bound where `is_bound` [K]."""
    rms_percent: Float[np.ndarray, " t"]
    """`rms_kelvin` over the range of the finest run, see `truth_error` [%]."""
    order: Float[np.ndarray, " t"]
    """Observed order of convergence; NaN where the runs have none."""
    is_bound: Bool[np.ndarray, " t"]
    """True where the observed order is below 0.5 or above 3: the larger of the two
    differences is given instead, which errors that fall more slowly may exceed."""
    differences: Float[np.ndarray, "t 2"]
    """Root mean square of finest less middle, and of middle less coarsest run [K]."""

    @property
    def worst_rms_kelvin(self) -> float:
        """Largest `rms_kelvin` of the saved times [K]."""
        return float(self.rms_kelvin.max())

    def as_dict(self) -> ReferenceErrors:
        """Return all numbers as plain types for JSON; None for what is not finite."""
        return ReferenceErrors(
            rms_kelvin=finite_numbers(self.rms_kelvin),
            rms_percent=finite_numbers(self.rms_percent),
            order=finite_numbers(self.order),
            times_s=finite_numbers(self.times),
            is_bound=self.is_bound.tolist(),
            differences_kelvin=self.differences.tolist(),
            worst_rms_kelvin=self.worst_rms_kelvin,
        )


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
    if len(finer.surfaces) != len(coarser.surfaces):
        raise InputError("discretization_error: runs of one scene have equal bodies")
    ratios = _pitches(coarser) / _pitches(finer)
    low = float(ratios.min())
    high = float(ratios.max())
    if not (low > 1 and high < _MAX_RATIO_CHANGE * low):
        raise InputError(
            "discretization_error: from one run to the next, the voxels become "
            f"{low:.4g} to {high:.4g} times as large: give the finest run first, and "
            "one factor above 1 for all bodies"
        )
    return float(ratios.mean())


def _pitches(run: AnySolution) -> Float[np.ndarray, " b"]:
    return np.array([surface.geometry.pitch for surface in run.surfaces])


def _observed_order(fine: float, coarse: float, first: float, second: float) -> float:
    """Order at which two differences have their ratio; NaN outside of `_ORDERS`."""

    def ratio(p: float) -> float:
        # With h2 = 1, the left side of the equation for p, which rises with p.
        return (second**p - 1) / (1 - first**-p)

    low, high = _ORDERS
    if not ratio(low) * fine <= coarse <= ratio(high) * fine or fine == 0:
        return np.nan
    solution = root_scalar(lambda p: ratio(p) - coarse / fine, bracket=_ORDERS)
    return float(solution.root)
