"""Sentences on choices: error, run time and what is computed."""

from collections.abc import Mapping
from typing import Any

from jaxthermo.report.numbers import (
    seconds,
    seconds_with_range,
    significant,
    with_range,
)
from jaxthermo.timing import Spread

from .front import Point


def ratio_text(ratio: Spread | None) -> str:
    """A ratio with its spread, "8.1 (7.5-9)"; a dash if it is not known."""
    return "-" if ratio is None else with_range(*ratio)


def time_text(time: Spread | None) -> str:
    """A run time with its spread, "13 (12-15) ms"; a dash if it is not known."""
    return "-" if time is None else seconds_with_range(*time)


def error_text(point: Point) -> str:
    """The RMS error of a point: "0.5 % (0.3 K)"."""
    percent = significant(point.errors["rms_percent"])
    return f"{percent} % ({significant(point.errors['rms_kelvin'])} K)"


def sentence(point: Point) -> str:
    """A point of the front: "0.5 % (0.3 K) in 40 ms: blocks of 8 mm, ..."."""
    cost = "not timed" if point.time_s is None else f"in {seconds(point.time_s)}"
    if point.offline_s is not None:
        cost += f", after {seconds(point.offline_s)} of preparation"
    if point.words is None:
        return f"{error_text(point)} {cost}: {point.name}"
    return f"{error_text(point)} {cost}: {point.words} [{point.name}]"


def structure_words(
    structure: Mapping[str, Any], pitch: float, fitted: bool = False
) -> str:
    """A structure with sizes: "blocks of 8 mm from 1 mm voxels, fitted".

    Args:
        structure: as a scene config has it, in plain values.
        pitch: edge of a voxel [m].
        fitted: True if it has other weights than 1.
    """
    kind = structure["kind"]
    factor = structure.get("factor")
    small = f"{significant(1e3 * pitch)} mm voxels"
    blocks = f"blocks of {significant(1e3 * pitch * (factor or 1))} mm from {small}"
    layers = structure.get("layers")
    words = {
        "aggregate": blocks,
        "shell_over_core": f"{layers} surface layers over {blocks}",
    }
    default = f"{kind.replace('_', ' ')} of {small}"
    return words.get(kind, default) + ", fitted" * fitted
