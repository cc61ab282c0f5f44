"""Properties of one material."""

import math

import equinox as eqx
from jax.core import Tracer

from .array_types import Scalar
from .errors import InputError


DEFAULT_EMISSIVITY = 0.9
"""Of most painted, oxidized and non-metallic surfaces, long-wave infrared [-]."""


def _check(name: str, value: object, most: float, unit: str) -> None:
    if isinstance(value, Tracer):
        return
    try:
        number = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise InputError(f"{name}={value!r}: give one number [{unit}]") from None
    if most < math.inf and not 0.0 <= number <= most:
        raise InputError(f"{name}={number}: give a fraction from 0 to {most:g}")
    if most == math.inf and not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{name}={number}: give a positive, finite number [{unit}]")


class Material(eqx.Module):
    """A uniform, isotropic, opaque solid (or a fluid at rest).

    Attributes:
        conductivity: k [W/(m K)].
        density: rho [kg/m^3].
        specific_heat: c_p [J/(kg K)].
        emissivity: eps of the surface in the long-wave infrared [-].
        own_absorptivity: as given, or None; read `absorptivity` instead.
    """

    conductivity: Scalar
    density: Scalar
    specific_heat: Scalar
    emissivity: Scalar
    own_absorptivity: Scalar | None

    def __init__(
        self,
        conductivity: Scalar,
        density: Scalar,
        specific_heat: Scalar,
        emissivity: Scalar = DEFAULT_EMISSIVITY,
        absorptivity: Scalar | None = None,
    ):
        """Takes numbers, which are checked, or traced values, which cannot be.

        Args:
            conductivity: k [W/(m K)].
            density: rho [kg/m^3].
            specific_heat: c_p [J/(kg K)].
            emissivity: eps [-], 0 to 1.
            absorptivity: of sources such as the sun [-]; the emissivity if not given.

        Raises:
            InputError: for a value that is not positive and finite, or no fraction.
        """
        _check("conductivity", conductivity, math.inf, "W/(m K)")
        _check("density", density, math.inf, "kg/m^3")
        _check("specific_heat", specific_heat, math.inf, "J/(kg K)")
        _check("emissivity", emissivity, 1.0, "-")
        if absorptivity is not None:
            _check("absorptivity", absorptivity, 1.0, "-")
        self.conductivity = conductivity
        self.density = density
        self.specific_heat = specific_heat
        self.emissivity = emissivity
        # Kept apart, so that a fit that moves the emissivity moves this with it.
        self.own_absorptivity = absorptivity

    @property
    def absorptivity(self) -> Scalar:
        """The fraction of a source's radiation that the surface takes in [-]."""
        if self.own_absorptivity is None:
            return self.emissivity
        return self.own_absorptivity

    @property
    def volumetric_heat_capacity(self) -> Scalar:
        """Returns rho c_p [J/(m^3 K)]."""
        return self.density * self.specific_heat

    @property
    def diffusivity(self) -> Scalar:
        """Returns alpha = k / (rho c_p) [m^2/s]."""
        return self.conductivity / self.volumetric_heat_capacity

    @property
    def effusivity(self) -> Scalar:
        """Returns e = sqrt(k rho c_p) [W s^0.5/(m^2 K)]."""
        return (self.conductivity * self.volumetric_heat_capacity) ** 0.5
