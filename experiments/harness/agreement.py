"""Results that are timed against one another, compared before their times count."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike


class DisagreementError(RuntimeError):
    """Results that a benchmark compares are further apart than they may be."""


def require_within(
    quantity: str, value: float, *, tolerance: float, unit: str = ""
) -> float:
    """Return an error that is at most its tolerance.

    Raises:
        DisagreementError: if it is larger, or NaN.
    """
    if not value <= tolerance:
        units = f" {unit}" if unit else ""
        raise DisagreementError(
            f"{quantity}: {value:.3g}{units}, more than {tolerance:.3g}{units}: the "
            "times are not those of equal things"
        )
    return float(value)


def largest_difference(
    quantity: str,
    results: Mapping[str, ArrayLike],
    *,
    tolerance: float,
    unit: str = "",
) -> float:
    """Return the largest difference of results from the first one of them.

    Args:
        quantity: name of what the results are.
        results: values by the name of the alternative that gives them.
        tolerance: largest difference, in the unit.
        unit: of the values.

    Raises:
        DisagreementError: if a difference is larger or NaN, or if shapes differ.
    """
    (first, reference), *compared = results.items()
    expected = np.asarray(reference, float)
    largest = 0.0
    for name, result in compared:
        values = np.asarray(result, float)
        if values.shape != expected.shape:
            raise DisagreementError(
                f"{quantity}: {values.shape} values of {name}, {expected.shape} of "
                f"{first}"
            )
        difference = require_within(
            f"{quantity}, {name} against {first}",
            float(np.abs(values - expected).max()),
            tolerance=tolerance,
            unit=unit,
        )
        largest = max(largest, difference)
    return largest
