"""Material: conductivity, density, specific heat and surface properties."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import Samples, Scalar, is_traced, namespace
from ..errors import InputError


def _as_array(numbers: Any) -> Any:
    if is_traced(numbers):
        return jnp.stack([jnp.asarray(x) for x in numbers])
    try:
        return np.asarray(numbers, float)
    except (TypeError, ValueError):
        raise InputError(f"Property: {numbers!r} are not numbers") from None


class Property(Module):
    """Property that is piecewise linear in temperature and constant outside the table.

    Raises:
        InputError: unless temperatures increase and values are positive and finite.
    """

    temperatures: Samples = eqx.field(converter=_as_array)
    """Temperatures, increasing [K]."""
    values: Samples = eqx.field(converter=_as_array)
    """Values at these temperatures, in the unit of the property."""

    def __check_init__(self):
        shape = np.shape(self.temperatures)
        if len(shape) != 1 or shape != np.shape(self.values) or shape == (0,):
            raise InputError(
                f"Property: {shape} temperatures and {np.shape(self.values)} values: "
                "give two lists of the same length"
            )
        kelvin = self.temperatures
        values = self.values
        if not is_traced(kelvin):
            if not np.isfinite(kelvin).all() or (kelvin < 0).any():
                raise InputError(
                    "Property: give temperatures in kelvin, finite and at least 0"
                )
            if (np.diff(kelvin) <= 0).any():
                raise InputError("Property: the temperatures must increase")
        if is_traced(values):
            return
        # At zero or below diffusion is ill-posed; fits beyond their range end there.
        wrong = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
        if len(wrong):
            first = values[wrong[0]]
            has_kelvin = not is_traced(kelvin)
            where = f"at {kelvin[wrong[0]]:g} K" if has_kelvin else f"value {wrong[0]}"
            fault = "goes negative" if first < 0 else "is no positive number"
            raise InputError(
                f"Property: it {fault}, {first:g} {where}: give positive, finite values"
            )

    def __call__(self, temperature: Any) -> Any:
        """Value at a temperature [K]."""
        # numpy outside of jit: its result stays a number that can be checked.
        xp = namespace((self, temperature))
        return xp.interp(temperature, self.temperatures, self.values)


DEFAULT_EMISSIVITY = 0.9
"""Long-wave emissivity of most painted, oxidized and non-metallic surfaces [-]."""

_AlongAxis = Scalar | Property
_Conductivity = Scalar | tuple[_AlongAxis, _AlongAxis, _AlongAxis] | Property
"""Isotropic, or one per axis of the body; each may depend on temperature."""


def _check(name: str, value: object, maximum: float, unit: str) -> None:
    # A traced value has no number yet to check.
    if is_traced(value):
        return
    try:
        number = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise InputError(f"{name}={value!r}: give one number [{unit}]") from None
    # Zero is the limit of a perfect mirror, but no density or conductivity.
    if maximum < math.inf and not 0.0 <= number <= maximum:
        raise InputError(f"{name}={number}: give a fraction from 0 to {maximum:g}")
    if maximum == math.inf and not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{name}={number}: give a positive, finite number [{unit}]")


def _checked_conductivity(conductivity) -> _Conductivity:
    if isinstance(conductivity, Property):
        return conductivity
    is_list = isinstance(conductivity, list | tuple)
    if not is_list and getattr(conductivity, "ndim", 0) != 1:
        _check("conductivity", value=conductivity, maximum=math.inf, unit="W/(m K)")
        return conductivity
    if len(conductivity) != 3:
        # One number a direction: a full tensor would couple all 26 neighbours.
        raise InputError(
            f"conductivity: got {len(conductivity)} numbers; give one, or three, along "
            "the body's own x, y and z [W/(m K)]"
        )
    x, y, z = conductivity
    for axis, value in zip("xyz", (x, y, z), strict=True):
        if not isinstance(value, Property):
            _check(
                f"conductivity along {axis}",
                value=value,
                maximum=math.inf,
                unit="W/(m K)",
            )
    return x, y, z


class Material(Module):
    """Homogeneous opaque solid, or a fluid at rest.

    Example:
        >>> import jaxthermo as jt
        >>> paint = jt.Material(0.2, 1500.0, specific_heat=1400.0, emissivity=0.95)
        >>> paint.absorptivity
        0.95
    """

    conductivity: _Conductivity
    density: Scalar
    specific_heat: Scalar | Property
    emissivity: Scalar
    given_absorptivity: Scalar | None

    def __init__(
        self,
        conductivity: _Conductivity | Sequence[_AlongAxis] | Float[Array, "3"],
        density: Scalar,
        specific_heat: Scalar | Property,
        emissivity: Scalar = DEFAULT_EMISSIVITY,
        absorptivity: Scalar | None = None,
    ):
        """Define a material by numbers or traced values; only numbers are checked.

        Args:
            conductivity: k [W/(m K)]: one, or three, along the body's x, y, z; each a
                number or a `Property`.
            density: rho [kg/m^3].
            specific_heat: c_p [J/(kg K)]; may be a `Property`.
            emissivity: eps of the surface in the long-wave infrared [-], 0 to 1.
            absorptivity: for radiation sources such as the sun [-], 0 to 1; by
                default the emissivity.

        Raises:
            InputError: for a value out of range.
        """
        _check("density", value=density, maximum=math.inf, unit="kg/m^3")
        if not isinstance(specific_heat, Property):
            _check(
                "specific_heat", value=specific_heat, maximum=math.inf, unit="J/(kg K)"
            )
        _check("emissivity", value=emissivity, maximum=1.0, unit="-")
        if absorptivity is not None:
            _check("absorptivity", value=absorptivity, maximum=1.0, unit="-")
        self.conductivity = _checked_conductivity(conductivity)
        self.density = density
        self.specific_heat = specific_heat
        self.emissivity = emissivity
        # Separate, so that by default a fit of the emissivity changes this with it.
        self.given_absorptivity = absorptivity

    @property
    def absorptivity(self) -> Scalar:
        """Fraction of a source's radiation that the surface absorbs [-]."""
        if self.given_absorptivity is None:
            return self.emissivity
        return self.given_absorptivity

    @property
    def varies(self) -> bool:
        """True if a property depends on temperature."""
        k = self.conductivity
        conductivities = k if isinstance(k, tuple) else (k,)
        properties = (*conductivities, self.specific_heat)
        return any(isinstance(value, Property) for value in properties)

    def at(self, temperature: Scalar) -> "Material":
        """Material with constant properties, evaluated at `temperature` [K]."""
        if not self.varies:
            return self

        def constant(value):
            return value(temperature) if isinstance(value, Property) else value

        k = self.conductivity
        if isinstance(k, tuple):
            conductivity = tuple(constant(along_axis) for along_axis in k)
        else:
            conductivity = constant(k)
        return Material(
            conductivity=conductivity,
            density=self.density,
            specific_heat=constant(self.specific_heat),
            emissivity=self.emissivity,
            absorptivity=self.given_absorptivity,
        )

    @property
    def volumetric_heat_capacity(self) -> Scalar:
        """Volumetric heat capacity rho c_p [J/(m^3 K)].

        Raises:
            InputError: if c_p depends on temperature (use `at` first).
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
        """Diffusivity alpha = k / (rho c_p) [m^2/s]; raises as `effusivity`."""
        return self._scalar_conductivity / self.volumetric_heat_capacity

    @property
    def effusivity(self) -> Scalar:
        """Effusivity e = sqrt(k rho c_p) [W s^0.5/(m^2 K)].

        Raises:
            InputError: if k or c_p depends on temperature, or k on the axis.
        """
        return (self._scalar_conductivity * self.volumetric_heat_capacity) ** 0.5


def _no_number(name: str, why: str, use: str) -> InputError:
    return InputError(f"material: its {name} {why} and is no one number: use {use}")
