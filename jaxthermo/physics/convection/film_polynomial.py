"""Properties of air by film temperature, as polynomials known beforehand.

Logarithms and powers at every place and step would cost more than conduction does. So a
value is taken at five film temperatures between 200 and 1000 K and interpolated by the
polynomial through them in 1 / (T_f + 600 K), a division and five products; outside, its
values at the ends hold.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


LOWEST, HIGHEST = 200.0, 1000.0
"""Film temperatures between which h is interpolated [K]."""

NODES = 5

SHIFT = 600.0
"""Added to the film temperature [K]: the error has its least here."""

_NEAR, _FAR = 1 / (HIGHEST + SHIFT), 1 / (LOWEST + SHIFT)
MIDDLE, HALF = (_FAR + _NEAR) / 2, (_FAR - _NEAR) / 2
_PLACES = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)

FILM_TEMPERATURES = 1 / (MIDDLE - HALF * _PLACES) - SHIFT
"""Where h has to be known [K]: the Chebyshev nodes."""


def film_polynomial(values: Float[Array, "*g n"]) -> Float[Array, "*g n"]:
    """Coefficients, lowest power first, through h at the `FILM_TEMPERATURES`."""
    to_powers = np.linalg.inv(np.vander(_PLACES, NODES, increasing=True))
    return values @ jnp.asarray(to_powers.T.astype(values.dtype))


def film_place(double_film: Float[Array, "*m"]) -> tuple[Array, Array]:
    """The polynomial's argument, and its derivative, by T_s + T_inf [K]."""
    inverse = 2 / (double_film + 2 * SHIFT)
    x = (MIDDLE - inverse) / HALF
    slope = jnp.where(jnp.abs(x) < 1, inverse * inverse / (2 * HALF), 0)
    return jnp.clip(x, -1, 1), slope


def horner(rows, x) -> tuple[Array, Array]:
    """A polynomial and its derivative; the coefficients' powers on the first axis."""
    value, slope = rows[NODES - 1], jnp.zeros_like(x)
    for power in range(NODES - 2, -1, -1):
        slope = slope * x + value
        value = value * x + rows[power]
    return value, slope
