"""Errors of runs as plain types, as files and reports have them."""

from typing import NotRequired, Required

import numpy as np
from typing_extensions import TypedDict


class TruthErrors(TypedDict, total=False):
    """Errors against finer voxels at the saved times; None for an infinite one."""

    times_s: Required[list[float]]
    rms_kelvin: Required[list[float | None]]
    worst_rms_kelvin: float | None
    rms_percent: Required[list[float | None]]
    worst_rms_percent: float | None
    p99_kelvin: list[float | None]
    worst_p99_kelvin: float | None
    bias_kelvin: list[float | None]
    worst_bias_kelvin: float | None
    lost_fraction: list[float | None]
    worst_lost_fraction: float | None
    reference_lost_fraction: float
    remarks: Required[list[str]]


class ReferenceComparison(TruthErrors):
    """Errors against a finer run in a file, and how the two were compared."""

    reference: str
    """Path of the file."""
    points: int
    seed: int
    pitch_m: list[float]
    """Pitch of each body."""
    reference_pitch_m: list[float]


class ReferenceErrors(TypedDict):
    """Estimated error of a reference at the saved times; None where not finite."""

    rms_kelvin: list[float | None]
    rms_percent: list[float | None]
    order: NotRequired[list[float | None]]
    """Observed order of convergence."""
    times_s: NotRequired[list[float | None]]
    is_bound: list[bool]
    differences_kelvin: NotRequired[list[list[float]]]
    """Differences of each run from the next coarser one, by saved time."""
    worst_rms_kelvin: float


def finite_number(value: object) -> float | None:
    """Return a number for JSON; None for one that is not finite."""
    number = float(np.asarray(value))
    return number if np.isfinite(number) else None


def finite_numbers(values: object) -> list[float | None]:
    """Return numbers for JSON; None for those that are not finite."""
    return [finite_number(value) for value in np.asarray(values, float)]
