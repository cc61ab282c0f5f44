"""Rows of a measured case: errors of models, by groups of times, and fitted values."""

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Bool, Float

from calibrate.analysis.identifiability import Identified

from ..harness.case import Check, Row
from .folds import rms


def limited(name: str, computed: float, highest: float, unit: str = "K") -> Check:
    """A number whose magnitude has a limit."""
    return Check(name, computed, highest=highest, lowest=-highest, unit=unit)


def by_group(
    what: str,
    groups: Mapping[str, Bool[np.ndarray, " t"]],
    errors: Mapping[str, Float[np.ndarray, " t"]],
) -> Iterator[Row]:
    """A row for each group of times, with bias and rms of several errors [K]."""
    for name, is_in in groups.items():
        if is_in.any():
            checks = [
                check
                for model, values in errors.items()
                for check in (
                    Check(f"bias, {model}", values[is_in].mean(), unit="K"),
                    Check(f"rms, {model}", rms(values[is_in]), unit="K"),
                )
            ]
            yield Row(what, name, checks=tuple(checks))


def fitted_values(identified: Identified, names: Mapping[str, str]) -> Iterator[Row]:
    """A row for each fitted value, with its verdict; `names` by its path."""
    for verdict in identified.verdicts:
        error = np.nan if verdict.standard_error is None else verdict.standard_error
        checks = (
            Check("value", verdict.value),
            Check("standard error", error),
        )
        words = [verdict.verdict, *(names[name] for name in verdict.with_others)]
        row = Row("values", names[verdict.label], seen=" with ".join(words))
        yield row._replace(checks=checks)
