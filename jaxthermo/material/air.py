"""Air as an ideal gas."""

from typing import Any

from .material import Material


_GAS_CONSTANT = 287.05
"""R of dry air [J/(kg K)]."""

_PRESSURE = 101_325.0
"""Standard atmosphere [Pa]."""


def body_of_air(volume: Any, kelvin: Any) -> Material:
    """Air of a volume [m^3] as the content of 1 m^3.

    rho = p / (R T). A node of 1 m^3 then has the heat capacity of the whole volume.
    """
    density = _PRESSURE / (_GAS_CONSTANT * kelvin)
    return Material(0.026, density * volume, specific_heat=1006.0)
