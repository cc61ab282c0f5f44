"""Local Nusselt number around a cylinder in cross-flow (thesis 5.4, figure 5.6).

    Nu(theta) = Nbar(Re, Pr) [1 + sum_{k=1..16} c_k(log10 Re) cos(k theta)],

theta from where the stream meets the cylinder. Every cosine averages to zero around the
cylinder, so the average is Nbar whatever the shape, and the curve is smooth and even at
0 and 180 degrees. No arc cosine is taken: with the normal n and the direction w of the
wind projected off the axis, the harmonic polynomials r^k cos(k theta) follow from

    R_0 = 1,    R_1 = -n.w,    R_{k+1} = 2 R_1 R_k - |n|^2 |w|^2 R_{k-1},

Chebyshev's recurrence where |n| = |w| = 1, as on a cylinder's side. On an end, where n
has no direction across the axis, all of them vanish smoothly and Nu = Nbar; a harmonic
function has no extreme inside, so Nu stays positive in between.

The shape is held below Re 1 and above 2.2e5, the average above 2.5e5. Of its knots
those to Re 40 are computed, those from 100 to 3e4 joined from boundary-layer theory and
an average, those from 7.08e4 up recalled, +-15 %.
"""

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .air import conductivity, kinematic_viscosity, prandtl
from .nusselt import Average, NamedAverage, Pchip, cylinder_knots, pchip


HIGHEST_REYNOLDS = 2.5e5
"""Where the average is held: the drag crisis is near."""

FULL_CROSSING = 0.5
"""Sine of the angle between wind and axis from which on the full shape applies."""

HARMONICS = 16

Values = Float[Array, "..."] | Float[np.ndarray, "..."]


@functools.cache
def _shape() -> Pchip:
    knots = cylinder_knots()
    return pchip(np.log10(knots.reynolds), knots.shape)


def shape_coefficients(reynolds: Float[Array, "*n"]) -> Float[Array, "*n k"]:
    """The c_k at each Reynolds number."""
    # Re 1 is the first knot, and log 0 has no derivative.
    return _shape()(jnp.log10(jnp.maximum(reynolds, 1.0)))


def harmonics(cosine: Values, square: Values | float = 1.0) -> Any:
    """R_1 to R_16 along the first axis, on the host if that is where they come from.

    Args:
        cosine: R_1 = r cos(theta).
        square: r^2.
    """
    before, here = 1.0, cosine
    found = [here]
    for _ in range(HARMONICS - 1):
        before, here = here, 2 * cosine * here - square * before
        found.append(here)
    own = jnp if isinstance(cosine, Array) else np
    return own.stack(found)


def surface_harmonics(
    normal: Float[np.ndarray, "*n 3"],
    axis: Float[np.ndarray, "*#n 3"],
    wind: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "k *n"]:
    """The R_k of surfaces on cylinders in a wind.

    Args:
        normal: outward, unit.
        axis: of each cylinder, unit.
        wind: the way it blows, unit.
    """
    along, yaw = (normal * axis).sum(-1), (wind * axis).sum(-1)
    crossing = 1 - yaw * yaw
    gain = 1 / np.maximum(np.sqrt(np.maximum(crossing, 0)), FULL_CROSSING)
    cosine = -((normal * wind).sum(-1) - along * yaw) * gain
    return harmonics(cosine, (1 - along * along) * crossing * gain * gain)


def shape_factor(
    coefficients: Float[Array, "*n k"], found: Float[Array, "k *n"]
) -> Float[Array, "*n"]:
    """Local over average Nusselt number, from the c_k and the R_k."""
    return 1 + (coefficients * jnp.moveaxis(found, 0, -1)).sum(-1)


def local_nusselt(
    cosine: Float[Array, "*n"],
    reynolds: Float[Array, "*n"],
    prandtl_number: Float[Array, "*n"],
    average: Average,
) -> Float[Array, "*n"]:
    """Nu(theta, Re, Pr) on the side of a cylinder.

    Args:
        cosine: of theta.
        reynolds: Re = V D / nu.
        prandtl_number: Pr.
        average: the correlation for the average.
    """
    held = jnp.minimum(reynolds, HIGHEST_REYNOLDS)
    factor = shape_factor(shape_coefficients(held), harmonics(cosine))
    return average(held, prandtl_number) * factor


def held_speed(
    speed: Float[Array, "*n"], diameter: Float[Array, "*#n"], air: Float[Array, ""]
) -> Float[Array, "*n"]:
    """The speed [m/s], no higher than where the Nusselt number is held.

    Args:
        speed: V [m/s].
        diameter: D [m].
        air: temperature of the stream [K].
    """
    return jnp.minimum(speed, HIGHEST_REYNOLDS * kinematic_viscosity(air) / diameter)


def mean_coefficient(
    speed: Float[Array, "*n"],
    diameter: Float[Array, "*#n"],
    film: Float[Array, "*#n"],
    average: Average,
) -> Float[Array, "*n"]:
    """The mean h of a cylinder, Nbar k / D with air at the film temperature.

    Args:
        speed: V [m/s].
        diameter: D [m].
        film: temperature (T_s + T_inf) / 2 [K].
        average: the correlation.
    """
    reynolds = speed * diameter / kinematic_viscosity(film)
    return average(reynolds, prandtl(film)) * conductivity(film) / diameter


def stream_shape(
    speed: Float[Array, "*n"], diameter: Float[Array, "*#n"], air: Float[Array, ""]
) -> Float[Array, "*n k"]:
    """The c_k in a stream of air at one temperature [K].

    Where the flow separates is up to the stream as a whole, so the shape goes by its
    own temperature, not by the film's at each place. By the film of a surface that is
    50 K warmer it would differ by 0.2 % at Re 4e3, 5 % at 1e4, 13 % at 1.5e5.
    """
    return shape_coefficients(speed * diameter / kinematic_viscosity(air))


def doubts(reynolds: float, average: NamedAverage) -> tuple[str, ...]:
    """What to know before trusting a result at this Reynolds number."""
    knots = cylinder_knots()
    found = []
    if reynolds > HIGHEST_REYNOLDS:
        found.append(
            f"Re {reynolds:.3g} is above {HIGHEST_REYNOLDS:.3g}, where the Nusselt "
            "number is held: give a lower speed or a smaller cylinder"
        )
    if reynolds > knots.reynolds[~knots.recalled].max():
        found.append(
            f"at Re {reynolds:.3g} the local Nusselt number rests on recalled curves, "
            "+-15 %, not on measured ones"
        )
    if not average.lowest <= reynolds <= average.highest:
        found.append(
            f"Re {reynolds:.3g} is outside {average.name}'s range, "
            f"{average.lowest:g} to {average.highest:g}"
        )
    return tuple(found)
