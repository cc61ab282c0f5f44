"""Material property that depends on temperature."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..arrays import Samples, is_traced
from ..errors import InputError


def _as_array(numbers: Any) -> Any:
    """Convert a list of numbers to one array, of numpy unless one is traced."""
    if is_traced(numbers):
        return jnp.stack([jnp.asarray(x) for x in numbers])
    try:
        return np.asarray(numbers, float)
    except (TypeError, ValueError):
        raise InputError(f"Property: {numbers!r} are no numbers") from None


class Property(eqx.Module):
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
        if not is_traced(self.temperatures):
            _check_temperatures(np.asarray(self.temperatures, float))
        if not is_traced(self.values):
            self._check_values()

    def _check_values(self) -> None:
        values = np.asarray(self.values, float)
        wrong = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
        if not len(wrong):
            return
        first, kelvin = values[wrong[0]], self.temperatures
        where = f"value {wrong[0]}"
        if not is_traced(kelvin):
            where = f"at {float(kelvin[wrong[0]]):g} K"
        what = "goes negative" if first < 0 else "is no positive number"
        raise InputError(
            f"Property: it {what}, {first:g} {where}: give positive, finite values"
        )

    def __call__(self, temperature: Any) -> Any:
        """Value at a temperature [K]."""
        # numpy outside of jit: its result stays a number that can be checked.
        module = jnp if is_traced((self, temperature)) else np
        return module.interp(temperature, self.temperatures, self.values)


def _check_temperatures(kelvin: np.ndarray) -> None:
    if not np.isfinite(kelvin).all() or (kelvin < 0).any():
        raise InputError("Property: give temperatures in kelvin, finite and at least 0")
    if (np.diff(kelvin) <= 0).any():
        raise InputError("Property: the temperatures must increase")
