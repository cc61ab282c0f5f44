"""Wind speed in the wake of an object by the distance behind it alone.

    u / U = 1 - A (1 + (x / l)^2)^(-p / 2)

x and l in diameters of the object, from its rear: the family of steady laminar wakes.
Fitted to computed centrelines at Re 10 to 40 its error is 0.007 to 0.03 (a pure
exponential: 0.07 to 0.08); far away p tends to 1/2 (Schlichting). The thesis (6.2)
draws such a "convergent function" without a formula. `fitted_wake` goes by Reynolds
number and has a width.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...module import Module


# Where the formula is negative, u / U decays to 0 over about this much.
_TRANSITION = 0.05

# Range of Reynolds numbers to whose wakes the family was fitted.
_MIN_FITTED_REYNOLDS = 10.0
_MAX_FITTED_REYNOLDS = 40.0


class WakeDeficit(Module):
    """Wake u / U = 1 - A (1 + (x / l)^2)^(-p / 2); the defaults fit Re 20.

    Any other callable from x / D to u / U in (0, 1] can be given instead.
    """

    amplitude: Scalar = 1.027
    """A [-], in (0, 1.3)."""
    length: Scalar = 2.227
    """l / D [-]."""
    exponent: Scalar = 0.497
    """p [-], in [0.4, 1.1]."""

    def __check_init__(self):
        _check("amplitude", value=self.amplitude, low=0.0, high=1.3)
        _check("length", value=self.length, low=0.0, high=np.inf)
        _check("exponent", value=self.exponent, low=0.4 - 1e-9, high=1.1 + 1e-9)

    def __call__(self, x: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Speed ratio u / U [-] at x diameters behind the rear."""
        a = jnp.asarray(self.amplitude, x.dtype)
        length = jnp.asarray(self.length, x.dtype)
        p = jnp.asarray(self.exponent, x.dtype)
        return above_zero(1 - a * (1 + (x / length) ** 2) ** (-p / 2))


def above_zero(ratio: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Speed ratio u / U, smoothly limited to positive values."""
    # Inside the bubble the mean flow runs backwards; a speed cannot.
    return jax.nn.softplus(ratio / _TRANSITION) / jax.nn.softplus(1 / _TRANSITION)


def _check(name: str, value: Any, low: float, high: float) -> None:
    if is_traced(value):
        return
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not low < number < high:
        raise InputError(
            f"WakeDeficit({name}={value!r}): give a number between {low:.3g} and "
            f"{high:.3g}"
        )


def wake_notes(wake: Any, reynolds: Float[np.ndarray, " n"]) -> tuple[str, ...]:
    """Note on a wake of objects at other Reynolds numbers V D / nu than its fit."""
    low = _MIN_FITTED_REYNOLDS
    high = _MAX_FITTED_REYNOLDS
    beyond = reynolds[(reynolds < low) | (reynolds > high)]
    # The range of a user's function is not known.
    if not isinstance(wake, WakeDeficit) or not len(beyond):
        return ()
    ends = f"{beyond.min():.3g}"
    if beyond.max() > beyond.min() * 1.01:
        ends += f" to {beyond.max():.3g}"
    sooner = ": a turbulent wake recovers sooner" if beyond.max() > high else ""
    return (
        f"the wake is of an object at Re {ends}, and the deficit was fitted at Re "
        f"{low:g} to {high:g} (its defaults at 20){sooner}",
    )


def wake_speed_ratio(wake: Any, x: Float[np.ndarray, " g"]) -> Float[Any, " g"]:
    """Speed ratio u / U [-] at x / D, which is infinite with nothing upstream.

    Raises:
        InputError: if `wake` returns values outside (0, 1].
    """
    behind = np.isfinite(x)
    # The power of an infinite distance has no derivative.
    with jax.ensure_compile_time_eval():
        ratio = jnp.where(behind, wake(jnp.asarray(np.where(behind, x, 1.0))), 1.0)
        if is_traced(ratio):
            return ratio
        values = np.asarray(ratio)
    bad = ~((values > 0) & (values <= 1))
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"Wind(wake=): gives u/U = {values[first]:.3g} at x/D = {x[first]:.3g}; "
            "it must lie in (0, 1]"
        )
    return values
