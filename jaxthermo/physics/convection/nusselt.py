"""Average Nusselt number of a cylinder in cross-flow, by Reynolds and Prandtl number.

| name | source | Re |
|---|---|---|
| `churchill_bernstein` | J. Heat Transfer 99 (1977) 300 | Re Pr > 0.2 |
| `sanitjai_goldstein` | Int. J. Heat Mass Transfer 47 (2004) 4795 | 2e3 to 9e4 |
| `profile` | the averages of the curves behind the local shape | 1 to 2.2e5 |

Above Re 1e4 they part: 1.3 times between the lowest and the highest at 2e5, where
`profile` rests on recalled curves. With Churchill-Bernstein's average the front of a
cylinder has 0.91 (Re 1e4) to 0.82 (3e4) of what laminar boundary-layer theory gives,
0.950 sqrt(Re); with `profile` 1.00 (1e4) to 1.09 (7e4).

All are smooth down to Re = 0, where the first is 0.3, and none has an infinite slope:
sqrt(Re) is taken as Re / sqrt(Re + 1e-4), which is off by 5e-9 at Re = 1e4.
"""

import csv
import difflib
import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...errors import InputError


# The local Nusselt number around a cylinder, as tabulated: `data/README.md`.


PROFILE_PRANDTL = 0.71
"""Of the air that the table was made for."""

_FILE = Path(__file__).parents[2] / "data" / "nu_shape_cosine_coeffs.csv"


class CylinderKnots(NamedTuple):
    """Nu(theta) = average (1 + sum_k shape_k cos k theta) at each Re."""

    reynolds: Float[np.ndarray, " n"]
    average: Float[np.ndarray, " n"]
    shape: Float[np.ndarray, "n k"]
    recalled: Bool[np.ndarray, " n"]
    """From memory of a published figure, +-15 %, not measured or computed."""


@functools.cache
def cylinder_knots() -> CylinderKnots:
    """The whole table, in the order of Re."""
    with _FILE.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    column = lambda name: np.array([float(row[name]) for row in rows])
    harmonics = [name for name in rows[0] if name.startswith("c")]
    return CylinderKnots(
        reynolds=column("Re"),
        average=column("Nbar_profile"),
        shape=np.stack([column(name) for name in harmonics], axis=1),
        recalled=np.array([row["provenance"].startswith("recalled") for row in rows]),
    )


# Piecewise cubic interpolation that keeps the shape of its data (PCHIP).
#
# Slopes by Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984): the weighted
# harmonic mean of the two neighbouring secants, zero where these differ in sign, so
# that between two knots the curve never leaves their range.


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


SMOOTHING = 1e-4
"""Added to Re under a root."""

Average = Callable[[Float[Array, "*n"], Float[Array, "*n"]], Float[Array, "*n"]]
"""From Reynolds and Prandtl number to the average Nusselt number."""


def _root(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return reynolds / jnp.sqrt(reynolds + SMOOTHING)


def churchill_bernstein(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """One formula for all Re with Re Pr > 0.2, and 0.3 at Re = 0.

    0.3 + 0.62 Re^(1/2) Pr^(1/3) [1 + (0.4/Pr)^(2/3)]^(-1/4)
          * [1 + (Re/282000)^(5/8)]^(4/5)
    """
    laminar = 0.62 * _root(reynolds) * jnp.cbrt(prandtl)
    laminar = laminar / (1 + (0.4 / prandtl) ** (2 / 3)) ** 0.25
    return 0.3 + laminar * (1 + ((reynolds + SMOOTHING) / 282000) ** 0.625) ** 0.8


def sanitjai_goldstein(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """For Re 2e3 to 9e4 and Pr 0.7 to 176.

    0.446 Re^0.5 Pr^0.35
      + 0.528 [(6.5 exp(Re/5000))^-5 + (0.031 Re^0.8)^-5]^(-1/5) Pr^0.42
    """
    front = 0.446 * _root(reynolds) * prandtl**0.35
    rear = 0.031 * (reynolds + SMOOTHING) ** 0.8
    # Of the two the smaller rules; divided by the second, neither can overflow.
    ratio = rear * jnp.exp(-reynolds / 5000) / 6.5
    return front + 0.528 * rear * (1 + ratio**5) ** -0.2 * prandtl**0.42


@functools.cache
def _profile_curve() -> Pchip:
    """Log of the profiles' averages by log Re."""
    knots = cylinder_knots()
    return pchip(np.log(knots.reynolds), np.log(knots.average)[:, None])


def profile(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Of the curves behind the local shape: it keeps the level of each.

    Interpolated in log Nu against log Re; with Pr, and beyond the ends of the table, it
    changes as `churchill_bernstein` does.
    """
    knots = cylinder_knots().reynolds
    held = jnp.clip(reynolds, float(knots[0]), float(knots[-1]))
    tabulated = jnp.exp(_profile_curve()(jnp.log(held))[..., 0])
    there = churchill_bernstein(held, jnp.full_like(held, PROFILE_PRANDTL))
    return tabulated * churchill_bernstein(reynolds, prandtl) / there


class NamedAverage(NamedTuple):
    """A correlation, and where it was measured."""

    name: str
    nusselt: Average
    lowest: float
    """Re."""
    highest: float
    """Re."""


AVERAGES = (
    NamedAverage("churchill_bernstein", churchill_bernstein, 0.0, np.inf),
    NamedAverage("sanitjai_goldstein", sanitjai_goldstein, 2e3, 9e4),
    NamedAverage("profile", profile, 1.0, 2.19e5),
)


def named_average(name: str) -> NamedAverage:
    """The correlation of that name.

    Raises:
        InputError: if there is none.
    """
    for average in AVERAGES:
        if average.name == name:
            return average
    names = [average.name for average in AVERAGES]
    close = difflib.get_close_matches(str(name), names, 1)
    hint = f"did you mean {close[0]}? " if close else ""
    raise InputError(f"average={name!r}: {hint}there are {', '.join(names)}")
