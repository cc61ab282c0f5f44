"""Sizes of fitted numbers by their units, where a start of 0 tells none."""

from .schema import unit_of


_TYPICAL_SIZES = {
    "m": 0.01,
    "s": 10.0,
    "K": 10.0,
    "m/s": 1.0,
    "rad": 0.01,
    "deg": 1.0,
    "W": 1.0,
    "W/m^2": 100.0,
    "W/m^3": 1e4,
    "W/sr": 1.0,
    "W/(m^2 sr)": 10.0,
    "W/(m^2 K)": 10.0,
    "W/(m K)": 1.0,
    "kg/m^3": 1000.0,
    "J/(kg K)": 500.0,
}
"""Size by the unit of a quantity, where a value of 0 tells none: a change by it is seen
in a run of bodies of some centimetres. Numbers without a unit change by 1."""


def typical_size(name: str) -> float:
    """Typical size of a parameter in SI, where its start value, 0, tells none."""
    return _TYPICAL_SIZES.get(unit_of(name), 1.0)


def usable_start(name: str, start: float, lower: float) -> float:
    """Start of a parameter with a lower bound by its definition.

    At such a bound, where a heat transfer coefficient or an irradiance is 0, nothing
    changes in proportion: the search begins at a typical size above it.
    """
    return lower + typical_size(name) if start == lower else start
