"""Physical constants, CODATA 2018 (exact since the 2019 SI), in SI units."""

STEFAN_BOLTZMANN = 5.670374419e-8
"""Stefan-Boltzmann constant [W/(m^2 K^4)]."""

ZERO_CELSIUS = 273.15
"""0 degC [K]."""
