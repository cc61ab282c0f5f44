"""Units of parameters, by what they are called, and bounds where none are given."""

import math
from typing import Any

from jaxthermo.config.types import quantities as units
from jaxthermo.config.types.quantities import Unit, to_si
from jaxthermo.errors import InputError


DIMENSIONS: dict[str, Unit] = {
    "conductivity": units.CONDUCTIVITY,
    "density": units.DENSITY,
    "specific_heat": units.SPECIFIC_HEAT,
    "heat_transfer_coefficient": units.HEAT_TRANSFER_COEFFICIENT,
    "conductance": units.CONTACT_CONDUCTANCE,
    "irradiance": units.IRRADIANCE,
    "temperature": units.TEMPERATURE,
    "heat_flux": units.HEAT_FLUX,
    "heat_rate_density": units.HEAT_RATE_DENSITY,
    "speed": units.SPEED,
}
"""By the last word of a parameter's name that is one of these."""

BOUNDS: dict[str, tuple[float, float]] = {
    "within": (0.01, 100.0),
    "between": (0.01, 100.0),
    "surface": (0.01, 100.0),
    "capacity": (0.01, 100.0),
    "links": (0.1, 10.0),
    "surface_distance": (0.01, 100.0),
    "nearest_capacity": (-3.0, 3.0),
    "non_orthogonal": (-1.0, 2.0),
    "emissivity": (0.0, 1.0),
    "absorptivity": (0.0, 1.0),
    "temperature": (0.0, math.inf),
}


def _known(name: str, table: dict[str, Any]) -> Any:
    words = [word for word in name.split(".") if not word.isdigit()]
    return next((table[word] for word in reversed(words) if word in table), None)


def unit_of(name: str) -> str:
    """The SI unit of a parameter; none for a factor."""
    dimension = _known(name, DIMENSIONS)
    return "" if dimension is None else dimension.symbol


def value_in_si(value: Any, name: str) -> float:
    """A number of a config, perhaps with a unit.

    Args:
        value: such as 16 or "16 W/(m K)".
        name: of the parameter.

    Raises:
        ValueError: if it is neither.
    """
    if isinstance(value, str) and value.strip() in ("inf", "-inf"):
        return float(value)
    try:
        return to_si(value, _known(name, DIMENSIONS) or units.NUMBER)
    except InputError as error:
        raise ValueError(str(error)) from error


def default_bounds(name: str, start: float) -> tuple[float, float]:
    """Bounds of a parameter for which none are given.

    Args:
        name: of the parameter.
        start: its value at first.
    """
    known = _known(name, BOUNDS)
    if known is not None:
        return known
    return (0.0, math.inf) if start > 0 else (-math.inf, math.inf)
