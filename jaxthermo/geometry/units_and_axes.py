"""From a file's own units and axes to metres and z up."""

import math

import numpy as np
from jaxtyping import Float

from jaxthermo.errors import InputError


_METRES = {
    "nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2,
    "dm": 1e-1, "m": 1.0, "km": 1e3, "mil": 2.54e-5, "in": 0.0254, "inch": 0.0254,
    "ft": 0.3048, "foot": 0.3048, "yd": 0.9144,
    "micrometre": 1e-6, "millimetre": 1e-3, "centimetre": 1e-2, "metre": 1.0,
    "micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0,
}  # fmt: skip

# Every row triple is a proper rotation, so that winding and volume keep their sign.
_AXES = {
    "x": ("y", "z", "x"),
    "y": ("x", "-z", "y"),
    "z": ("x", "y", "z"),
    "-x": ("z", "y", "-x"),
    "-y": ("x", "z", "-y"),
    "-z": ("x", "-y", "-z"),
}


def metres_per_unit(unit: str | float | int) -> float:
    """Length of one file unit [m], from a name ("mm") or a number.

    Raises:
        InputError: the name is unknown, or the number is not positive and finite.
    """
    if isinstance(unit, str):
        metres = _METRES.get(unit.strip().lower())
        if metres is None:
            raise InputError(
                f"unit {unit!r} is not known: name one of m, mm, cm, um, in, ft, "
                "or give the metres per file unit as a number"
            )
        return metres
    return positive_length("unit", unit)


def positive_length(argument: str, value: float | int) -> float:
    """The value [m] as a float, refused unless positive and finite.

    Raises:
        InputError: naming the argument and its value.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(
            f"{argument}={value} is no length: give a positive number of metres"
        )
    return float(value)


def axes_for_up(up: str) -> tuple[str, str, str]:
    """What our x, y and z are called in a file whose axis `up` points up.

    Raises:
        InputError: `up` is none of x, y, z, -x, -y, -z.
    """
    axes = _AXES.get(up.strip().lower().removeprefix("+"))
    if axes is None:
        raise InputError(f"up={up!r} is no axis: name one of {', '.join(_AXES)}")
    return axes


def turn_matrix(axes: tuple[str, str, str]) -> Float[np.ndarray, "3 3"]:
    """The rotation from file axes to ours: `ours = matrix @ file`."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=True):
        row["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return rows
