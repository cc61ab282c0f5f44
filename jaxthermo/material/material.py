"""Properties of one material."""

import math
from collections.abc import Sequence

import equinox as eqx
from jaxtyping import Array, Float

from ..arrays import Scalar, is_traced
from ..errors import InputError
from .property import Property


DEFAULT_EMISSIVITY = 0.9
"""Of most painted, oxidized and non-metallic surfaces, long-wave infrared [-]."""

Conductivity = Scalar | tuple[Scalar, Scalar, Scalar] | Property
"""The same all ways, one for each axis of the body, or one that varies with T."""


def _check(name: str, value: object, most: float, unit: str) -> None:
    if is_traced(value):
        return
    try:
        number = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise InputError(f"{name}={value!r}: give one number [{unit}]") from None
    if most < math.inf and not 0.0 <= number <= most:
        raise InputError(f"{name}={number}: give a fraction from 0 to {most:g}")
    if most == math.inf and not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{name}={number}: give a positive, finite number [{unit}]")


def _conductivity(given) -> Conductivity:
    """Checked; a list or an array of three as a tuple."""
    if isinstance(given, Property):
        return given
    if not isinstance(given, list | tuple) and getattr(given, "ndim", 0) != 1:
        _check("conductivity", given, math.inf, "W/(m K)")
        return given
    if len(given) != 3:
        raise InputError(
            f"conductivity: got {len(given)} numbers; give one, or three, along the "
            "body's own x, y and z [W/(m K)]"
        )
    x, y, z = given
    for axis, value in zip("xyz", (x, y, z), strict=True):
        _check(f"conductivity along {axis}", value, math.inf, "W/(m K)")
    return x, y, z


class Material(eqx.Module):
    """An opaque solid (or a fluid at rest), the same everywhere.

    Attributes:
        conductivity: k [W/(m K)]; three along the body's own axes if they differ.
        density: rho [kg/m^3].
        specific_heat: c_p [J/(kg K)].
        emissivity: eps of the surface in the long-wave infrared [-].
        own_absorptivity: as given, or None; read `absorptivity` instead.
    """

    conductivity: Conductivity
    density: Scalar
    specific_heat: Scalar | Property
    emissivity: Scalar
    own_absorptivity: Scalar | None

    def __init__(
        self,
        conductivity: Conductivity | Sequence[Scalar] | Float[Array, "3"],
        density: Scalar,
        specific_heat: Scalar | Property,
        emissivity: Scalar = DEFAULT_EMISSIVITY,
        absorptivity: Scalar | None = None,
    ):
        """Takes numbers, which are checked, or traced values, which cannot be.

        Args:
            conductivity: k [W/(m K)]: one; three, along the body's own x, y, z; or a
                `Property`.
            density: rho [kg/m^3].
            specific_heat: c_p [J/(kg K)]; may be a `Property`.
            emissivity: eps [-], 0 to 1.
            absorptivity: of sources such as the sun [-]; the emissivity if not given.

        Raises:
            InputError: for a value that is not positive and finite, or no fraction.
        """
        _check("density", density, math.inf, "kg/m^3")
        if not isinstance(specific_heat, Property):
            _check("specific_heat", specific_heat, math.inf, "J/(kg K)")
        _check("emissivity", emissivity, 1.0, "-")
        if absorptivity is not None:
            _check("absorptivity", absorptivity, 1.0, "-")
        self.conductivity = _conductivity(conductivity)
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
    def varies(self) -> bool:
        """Whether a property depends on temperature."""
        return isinstance(self.conductivity, Property) or isinstance(
            self.specific_heat, Property
        )

    def at(self, temperature: Scalar) -> "Material":
        """The same material with every property as it is at `temperature` [K]."""
        if not self.varies:
            return self
        number = lambda p: p(temperature) if isinstance(p, Property) else p
        return Material(
            number(self.conductivity),
            self.density,
            number(self.specific_heat),
            self.emissivity,
            self.own_absorptivity,
        )

    @property
    def volumetric_heat_capacity(self) -> Scalar:
        """Returns rho c_p [J/(m^3 K)].

        Raises:
            InputError: where it depends on temperature; `at` gives a material at one.
        """
        if isinstance(self.specific_heat, Property):
            raise _no_number("specific_heat", "depends on temperature", ".at(kelvin)")
        return self.density * self.specific_heat

    @property
    def _scalar_conductivity(self) -> Scalar:
        k = self.conductivity
        if isinstance(k, Property):
            raise _no_number("conductivity", "depends on temperature", ".at(kelvin)")
        if isinstance(k, tuple):
            raise _no_number("conductivity", "differs by axis", ".conductivity")
        return k

    @property
    def diffusivity(self) -> Scalar:
        """Returns alpha = k / (rho c_p) [m^2/s]; raises as `effusivity` does."""
        return self._scalar_conductivity / self.volumetric_heat_capacity

    @property
    def effusivity(self) -> Scalar:
        """Returns e = sqrt(k rho c_p) [W s^0.5/(m^2 K)].

        Raises:
            InputError: where k or c_p depends on temperature or k on the axis.
        """
        return (self._scalar_conductivity * self.volumetric_heat_capacity) ** 0.5


def _no_number(name: str, why: str, use: str) -> InputError:
    return InputError(f"material: its {name} {why} and is no one number: use {use}")
