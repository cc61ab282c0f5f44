"""Nusselt number of a cylinder in cross-flow: average correlations and shape table.

| name | source | Re |
|---|---|---|
| `churchill_bernstein` | J. Heat Transfer 99 (1977) 300 | Re Pr > 0.2 |
| `sanitjai_goldstein` | Int. J. Heat Mass Transfer 47 (2004) 4795 | 2e3 to 9e4 |
| `profile` | the averages of the curves behind the local shape | 1 to 2.2e5 |

Above Re 1e4 they diverge: the highest is 1.3 times the lowest at 2e5, where `profile`
rests on recalled curves. With Churchill-Bernstein's average the front of a cylinder has
0.91 (Re 1e4) to 0.82 (3e4) of the value of laminar boundary-layer theory, 0.950
sqrt(Re); with `profile` 1.00 (1e4) to 1.09 (7e4).

The table of the local Nusselt number is described in `data/README.md`. It is
interpolated by piecewise cubics that preserve the shape of the data (PCHIP), with
slopes by Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984).
"""

import csv
import difflib
import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from equinox import Module
from jaxtyping import Array, Bool, Float

from ...errors import InputError


# Prandtl number of the air that the table was made for.
_PROFILE_PRANDTL = 0.71

_FILE = Path(__file__).parents[2] / "data" / "nu_shape_cosine_coeffs.csv"


class _CylinderTable(NamedTuple):
    """Nu(theta) = average (1 + sum_k shape_k cos k theta) at each Reynolds number."""

    reynolds: Float[np.ndarray, " n"]
    average: Float[np.ndarray, " n"]
    shape: Float[np.ndarray, "n k"]
    recalled: Bool[np.ndarray, " n"]
    """True for rows recalled from a published figure, +-15 %, not measured."""


@functools.cache
def cylinder_table() -> _CylinderTable:
    """Table of the local Nusselt number, in ascending order of Re."""
    with _FILE.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    harmonics = [name for name in rows[0] if name.startswith("c")]
    return _CylinderTable(
        reynolds=np.array([float(row["Re"]) for row in rows]),
        average=np.array([float(row["Nbar_profile"]) for row in rows]),
        shape=np.array([[float(row[name]) for name in harmonics] for row in rows]),
        recalled=np.array([row["provenance"].startswith("recalled") for row in rows]),
    )


class Pchip(Module):
    """Piecewise cubic curve through rows of values, constant beyond the ends."""

    knots: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n p"]
    slopes: Float[np.ndarray, "n p"]

    def __call__(self, x: Float[Array, "*q"]) -> Float[Array, "*q p"]:
        """Interpolated rows at `x`."""
        # A cast on the host compiles nothing.
        knots = jnp.asarray(self.knots.astype(x.dtype))
        values = jnp.asarray(self.values.astype(x.dtype))
        slopes = jnp.asarray(self.slopes.astype(x.dtype))
        x = jnp.clip(x, knots[0], knots[-1])
        left = jnp.clip(jnp.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
        width = knots[left + 1] - knots[left]
        t = ((x - knots[left]) / width)[..., None]
        rise = values[left + 1] - values[left]
        start, end = (width[..., None] * slopes[at] for at in (left, left + 1))
        cubic = start + end - 2 * rise
        return values[left] + t * (start + t * (rise - start - cubic + t * cubic))


def pchip(x: Float[np.ndarray, " n"], y: Float[np.ndarray, "n p"]) -> Pchip:
    """Shape-preserving curve through three points (x, y) or more."""
    slopes = scipy.interpolate.PchipInterpolator(x, y).derivative()(x)
    return Pchip(knots=x, values=y, slopes=slopes)


MAX_REYNOLDS = 2.5e5
"""Reynolds number above which that of a cylinder is constant: near the drag crisis."""

# Added to Re under a root, so that all correlations are smooth down to Re = 0, without
# an infinite slope there; the relative error is 5e-9 at Re = 1e4.
_SMOOTHING = 1e-4

Average = Callable[[Float[Array, "*n"], Float[Array, "*n"]], Float[Array, "*n"]]
"""Average Nusselt number as a function of Reynolds and Prandtl number."""


def smooth_root(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Re^(1/2) with a finite slope at 0."""
    return reynolds / jnp.sqrt(reynolds + _SMOOTHING)


def smooth_two_thirds(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Re^(2/3) with a finite slope at 0."""
    return reynolds / jnp.cbrt(reynolds + _SMOOTHING)


def churchill_bernstein(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Average Nusselt number for all Re with Re Pr > 0.2; 0.3 at Re = 0.

    0.3 + 0.62 Re^(1/2) Pr^(1/3) [1 + (0.4/Pr)^(2/3)]^(-1/4)
          * [1 + (Re/282000)^(5/8)]^(4/5)
    """
    laminar = 0.62 * smooth_root(reynolds) * jnp.cbrt(prandtl)
    laminar = laminar / (1 + (0.4 / prandtl) ** (2 / 3)) ** 0.25
    return 0.3 + laminar * (1 + ((reynolds + _SMOOTHING) / 282000) ** 0.625) ** 0.8


def _sanitjai_goldstein(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Average Nusselt number for Re 2e3 to 9e4 and Pr 0.7 to 176.

    0.446 Re^0.5 Pr^0.35
      + 0.528 [(6.5 exp(Re/5000))^-5 + (0.031 Re^0.8)^-5]^(-1/5) Pr^0.42
    """
    front = 0.446 * smooth_root(reynolds) * prandtl**0.35
    rear = 0.031 * (reynolds + _SMOOTHING) ** 0.8
    # The smaller of the two prevails; divided by the second, neither can overflow.
    ratio = rear * jnp.exp(-reynolds / 5000) / 6.5
    return front + 0.528 * rear * (1 + ratio**5) ** -0.2 * prandtl**0.42


@functools.cache
def _profile_curve() -> Pchip:
    """Logarithm of the tabulated averages by log Re."""
    table = cylinder_table()
    return pchip(np.log(table.reynolds), np.log(table.average)[:, None])


def profile(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Average Nusselt number of the tabulated curves, which preserves their level.

    Interpolated in log Nu against log Re; with Pr, and beyond the ends of the table, it
    changes as `churchill_bernstein` does.
    """
    tabulated_re = cylinder_table().reynolds
    inside = jnp.clip(reynolds, float(tabulated_re[0]), float(tabulated_re[-1]))
    tabulated = jnp.exp(_profile_curve()(jnp.log(inside))[..., 0])
    formula_inside = churchill_bernstein(
        inside, jnp.full_like(inside, _PROFILE_PRANDTL)
    )
    return tabulated * churchill_bernstein(reynolds, prandtl) / formula_inside


class NamedAverage(NamedTuple):
    """Correlation with the range of Reynolds numbers in which it was measured."""

    name: str
    nusselt: Average
    min_reynolds: float
    max_reynolds: float
    constant_above: float = np.inf
    """Reynolds number above which it is constant."""

    def range_note(self, reynolds: float) -> tuple[str, ...]:
        """A line if it was not measured at this Reynolds number."""
        if self.min_reynolds <= reynolds <= self.max_reynolds:
            return ()
        return (
            f"Re {reynolds:.3g} is outside {self.name}'s range, "
            f"{self.min_reynolds:g} to {self.max_reynolds:g}",
        )


AVERAGES = (
    NamedAverage(
        name="churchill_bernstein",
        nusselt=churchill_bernstein,
        min_reynolds=0.0,
        max_reynolds=np.inf,
        constant_above=MAX_REYNOLDS,
    ),
    NamedAverage(
        name="sanitjai_goldstein",
        nusselt=_sanitjai_goldstein,
        min_reynolds=2e3,
        max_reynolds=9e4,
        constant_above=MAX_REYNOLDS,
    ),
    NamedAverage(
        name="profile",
        nusselt=profile,
        min_reynolds=1.0,
        max_reynolds=2.19e5,
        constant_above=MAX_REYNOLDS,
    ),
)


def named_average(name: str) -> NamedAverage:
    """Correlation of that name.

    Raises:
        InputError: for an unknown name.
    """
    for average in AVERAGES:
        if average.name == name:
            return average
    names = [average.name for average in AVERAGES]
    close = difflib.get_close_matches(str(name), names, 1)
    hint = f"did you mean {close[0]}? " if close else ""
    raise InputError(f"average={name!r}: {hint}there are {', '.join(names)}")
