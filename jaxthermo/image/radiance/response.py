"""Response of detectors to wavelengths: names of bands, and tables that are checked.

Without jax, so that a config can check a band before jax is loaded.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from ...errors import InputError


BANDS = {"long-wave": (7.5e-6, 14e-6), "mid-wave": (3e-6, 5e-6)}
"""Ends of the bands [m] of most uncooled cameras, and of cooled ones."""


def checked_response(
    wavelengths: Any, response: Any
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Wavelengths [m] and the response at each in [0, 1], which is 1 if None.

    Raises:
        InputError: for wavelengths or responses that are none, or without energy.
    """
    argument = "Band(wavelengths=)"
    edges = _numbers(wavelengths, argument)
    if len(edges) < 2 or not (edges > 0).all() or not (np.diff(edges) > 0).all():
        raise InputError(f"{argument}: give two or more, in metres, increasing")
    if edges[0] < 1e-7 or edges[-1] > 1e-3:
        raise InputError(
            f"{argument}: {edges[0]:g} to {edges[-1]:g} m: give metres, from 1e-7 to "
            "1e-3; a long-wave camera has (7.5e-6, 14e-6)"
        )
    if response is None:
        return edges, np.ones(len(edges))
    values = _numbers(response, "Band(response=)")
    if len(values) != len(edges):
        raise InputError(
            f"Band(response=): {len(values)} values for {len(edges)} wavelengths: give "
            "one for each"
        )
    if not ((values >= 0) & (values <= 1)).all():
        raise InputError("Band(response=): give fractions, from 0 to 1")
    if not values.any():
        raise InputError("Band(response=): all 0: the band has no energy")
    return edges, values


def _numbers(values: Any, name: str) -> Float[np.ndarray, " k"]:
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError):
        numbers = np.full(1, np.nan)
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise InputError(f"{name}: give finite numbers")
    return numbers
