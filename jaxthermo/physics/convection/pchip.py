"""Piecewise cubic interpolation that keeps the shape of its data (PCHIP).

Slopes by Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984): the weighted
harmonic mean of the two neighbouring secants, zero where these differ in sign, so that
between two knots the curve never leaves their range.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Pchip(eqx.Module):
    """A curve through rows of values at increasing knots, constant beyond the ends."""

    knots: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n p"]
    slopes: Float[np.ndarray, "n p"]

    def __call__(self, x: Float[Array, "*q"]) -> Float[Array, "*q p"]:
        """The rows at `x`."""
        # Cast on the host: it compiles nothing.
        knots, values, slopes = (
            a.astype(x.dtype) for a in (self.knots, self.values, self.slopes)
        )
        knots, values, slopes = map(jnp.asarray, (knots, values, slopes))
        x = jnp.clip(x, knots[0], knots[-1])
        left = jnp.clip(jnp.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
        width = knots[left + 1] - knots[left]
        t = ((x - knots[left]) / width)[..., None]
        rise = values[left + 1] - values[left]
        start, end = (width[..., None] * slopes[at] for at in (left, left + 1))
        bend = start + end - 2 * rise
        return values[left] + t * (start + t * (rise - start - bend + t * bend))


def pchip(x: Float[np.ndarray, " n"], y: Float[np.ndarray, "n p"]) -> Pchip:
    """The curve through (x, y), three points or more."""
    width = np.diff(x)[:, None]
    secant = np.diff(y, axis=0) / width
    before, after = secant[:-1], secant[1:]
    w1, w2 = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same = before * after > 0
    safe = lambda s: np.where(same, s, 1.0)
    inner = np.where(same, (w1 + w2) / (w1 / safe(before) + w2 / safe(after)), 0.0)
    first = _end_slope(width[0], width[1], secant[0], secant[1])
    last = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return Pchip(x, y, np.concatenate([first[None], inner, last[None]]))


def _end_slope(near, far, secant, next_secant):
    """Of the parabola through three points, held within what keeps the shape."""
    slope = ((2 * near + far) * secant - near * next_secant) / (near + far)
    slope = np.where(slope * secant > 0, slope, 0.0)
    limited = (secant * next_secant < 0) & (np.abs(slope) > 3 * np.abs(secant))
    return np.where(limited, 3 * secant, slope)
