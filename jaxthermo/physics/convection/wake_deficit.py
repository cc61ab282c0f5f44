"""The wind behind an object, as a share of the undisturbed one.

    u / U = 1 - A (1 + (x / l)^2)^(-p / 2)

x and l in diameters of the object, from its rear. The family of steady laminar wakes:
fitted to computed centrelines at Re 10 to 40 it is off by 0.007 to 0.03 (a pure
exponential by 0.07 to 0.08); far away p tends to 1/2 (Schlichting). The thesis (6.2)
draws such a "convergent function" without a formula.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Scalar, is_traced
from ...errors import InputError


STILL = 0.05
"""Where the formula is negative, u / U decays to 0 over about this much."""


class WakeDeficit(eqx.Module):
    """A wake as a function of x / D; the defaults fit the computed one at Re 20.

    Any other callable from x / D to u / U in (0, 1] may take its place.
    """

    amplitude: Scalar = 1.027
    """A, in (0, 1.3)."""
    length: Scalar = 2.227
    """l / D."""
    exponent: Scalar = 0.497
    """p, in [0.4, 1.1]."""

    def __check_init__(self):
        _check("amplitude", self.amplitude, 0.0, 1.3)
        _check("length", self.length, 0.0, np.inf)
        _check("exponent", self.exponent, 0.4 - 1e-9, 1.1 + 1e-9)

    def __call__(self, x: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The share u / U at x diameters behind the rear."""
        a, l, p = (
            jnp.asarray(v, x.dtype)
            for v in (self.amplitude, self.length, self.exponent)
        )
        share = 1 - a * (1 + (x / l) ** 2) ** (-p / 2)
        # Inside the bubble the mean flow runs backwards; a speed cannot.
        return jax.nn.softplus(share / STILL) / jax.nn.softplus(1 / STILL)


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


def wake_share(wake: Any, x: Float[np.ndarray, " g"]) -> Float[Any, " g"]:
    """What `wake` leaves of the wind at x / D, infinite where nothing is upstream.

    Raises:
        InputError: if `wake` gives what is not in (0, 1].
    """
    behind = np.isfinite(x)
    # The power of an infinite distance has no derivative.
    with jax.ensure_compile_time_eval():
        share = jnp.where(behind, wake(jnp.asarray(np.where(behind, x, 1.0))), 1.0)
        if is_traced(share):
            return share
        values = np.asarray(share)
    bad = ~((values > 0) & (values <= 1))
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise InputError(
            f"Wind(wake=): gives u/U = {values[first]:.3g} at x/D = {x[first]:.3g}; "
            "it must lie in (0, 1]"
        )
    return values
