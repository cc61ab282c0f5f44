"""Air as an ideal gas, of constant specific heat.

c_p is 1.005 to 1.009 kJ/(kg K) from 250 to 350 K (Lemmon et al. 2000).
"""

from typing import Any

from .material import Material


_GAS_CONSTANT = 287.05
"""R of dry air [J/(kg K)]."""

_PRESSURE = 101_325.0
"""Standard atmosphere [Pa]."""

_SPECIFIC_HEAT = 1006.0
"""c_p [J/(kg K)]."""


def body_of_air(volume: Any, kelvin: Any) -> Material:
    """Air of a volume [m^3] as the content of 1 m^3.

    rho = p / (R T). A node of 1 m^3 then has the heat capacity of the whole volume.
    """
    density = _PRESSURE / (_GAS_CONSTANT * kelvin)
    return Material(0.026, density * volume, specific_heat=_SPECIFIC_HEAT)
