"""Physical constants, CODATA 2018 (exact since the 2019 SI), and limits, in SI."""

STEFAN_BOLTZMANN = 5.670374419e-8
"""Stefan-Boltzmann constant [W/(m^2 K^4)]."""

ZERO_CELSIUS = 273.15
"""0 degC [K]."""

SOLAR_TEMPERATURE = 5800.0
"""Black body with about the spectrum of the sun [K]."""

MIN_TEMPERATURE = 150.0
"""Smallest plausible temperature [K]: a lower number is most likely in degrees
Celsius."""

MAX_TEMPERATURE = 6000.0
"""Largest plausible temperature [K]: the surface of the sun is at 5772 K."""
