"""Local Nusselt number around a cylinder in cross-flow (thesis 5.4, figure 5.6).

    Nu(theta) = Nbar(Re, Pr) [1 + sum_{k=1..16} c_k(log10 Re) cos(k theta)],

theta from the stagnation line. Every cosine averages to zero around the cylinder, so
the average is Nbar whatever the shape, and the curve is smooth and even at 0 and 180
degrees. The harmonic polynomials R_k = r^k cos(k theta) follow from the normal n and
the wind direction w projected off the axis,

    R_0 = 1,    R_1 = -n.w,    R_{k+1} = 2 R_1 R_k - |n|^2 |w|^2 R_{k-1}.

The shape is constant below Re 1 and above 2.2e5, the average above 2.5e5. The tabulated
Reynolds numbers up to 40 are computed, those from 100 to 3e4 joined from boundary-layer
theory and an average, those from 7.08e4 up recalled, +-15 %.
"""

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .air import conductivity, kinematic_viscosity, prandtl
from .nusselt import Average, NamedAverage, Pchip, cylinder_table, pchip


MAX_REYNOLDS = 2.5e5
"""Reynolds number above which the average is constant: the drag crisis is near."""

# Sine of the angle between wind and axis from which on the full shape applies.
_FULL_CROSS_FLOW = 0.5

_HARMONICS = 16

_Values = Float[Array, "..."] | Float[np.ndarray, "..."]


@functools.cache
def _shape() -> Pchip:
    table = cylinder_table()
    return pchip(np.log10(table.reynolds), table.shape)


def shape_coefficients(reynolds: Float[Array, "*n"]) -> Float[Array, "*n k"]:
    """Shape coefficients c_k at each Reynolds number."""
    # Re 1 is the first tabulated value, and log 0 has no derivative.
    return _shape()(jnp.log10(jnp.maximum(reynolds, 1.0)))


def harmonics(cosine: _Values, square: _Values | float = 1.0) -> Any:
    """R_1 to R_16 along the first axis, from R_1 = r cos(theta) and r^2.

    The result is a numpy array for numpy input.
    """
    # Chebyshev's recurrence where r = 1, as on a cylinder's side: no arc cosine. On an
    # end, where the normal is parallel to the axis, all R_k vanish smoothly and Nu is
    # its average; a harmonic function has no extreme inside, so Nu > 0 in between.
    before, here = 1.0, cosine
    found = [here]
    for _ in range(_HARMONICS - 1):
        before, here = here, 2 * cosine * here - square * before
        found.append(here)
    xp = jnp if isinstance(cosine, Array) else np
    return xp.stack(found)


def surface_harmonics(
    normal: Float[np.ndarray, "*n 3"],
    axis: Float[np.ndarray, "*#n 3"],
    wind: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "k *n"]:
    """R_k of cylinder surfaces, from unit vectors along normal, axis and wind."""
    along, yaw = (normal * axis).sum(-1), (wind * axis).sum(-1)
    crossing = 1 - yaw * yaw
    # The shape fades out towards wind along the axis, where theta is undefined.
    gain = 1 / np.maximum(np.sqrt(np.maximum(crossing, 0)), _FULL_CROSS_FLOW)
    cosine = -((normal * wind).sum(-1) - along * yaw) * gain
    return harmonics(cosine, (1 - along * along) * crossing * gain * gain)


def shape_factor(
    coefficients: Float[Array, "*n k"], found: Float[Array, "k *n"]
) -> Float[Array, "*n"]:
    """Local over average Nusselt number [-], from the c_k and the R_k."""
    return 1 + (coefficients * jnp.moveaxis(found, 0, -1)).sum(-1)


def local_nusselt(
    cosine: Float[Array, "*n"],
    reynolds: Float[Array, "*n"],
    prandtl_number: Float[Array, "*n"],
    average: Average,
) -> Float[Array, "*n"]:
    """Nu(theta, Re, Pr) on the side of a cylinder, from cos(theta)."""
    limited = jnp.minimum(reynolds, MAX_REYNOLDS)
    factor = shape_factor(shape_coefficients(limited), harmonics(cosine))
    return average(limited, prandtl_number) * factor


def limited_speed(
    speed: Float[Array, "*n"], diameter: Float[Array, "*#n"], air: Float[Array, ""]
) -> Float[Array, "*n"]:
    """Speed [m/s], reduced where the Reynolds number would exceed `MAX_REYNOLDS`.

    The diameter is in m, the temperature of the air in K.
    """
    return jnp.minimum(speed, MAX_REYNOLDS * kinematic_viscosity(air) / diameter)


def mean_coefficient(
    speed: Float[Array, "*n"],
    diameter: Float[Array, "*#n"],
    film: Float[Array, "*#n"],
    average: Average,
) -> Float[Array, "*n"]:
    """Mean h of a cylinder [W/(m^2 K)]: Nbar k / D for air at the film temperature."""
    reynolds = speed * diameter / kinematic_viscosity(film)
    return average(reynolds, prandtl(film)) * conductivity(film) / diameter


def stream_shape(
    speed: Float[Array, "*n"], diameter: Float[Array, "*#n"], air: Float[Array, ""]
) -> Float[Array, "*n k"]:
    """Shape coefficients c_k in a stream of air at one temperature [K].

    The stream as a whole determines where the flow separates, so the shape depends on
    its temperature, not on the local film temperature. With the film of a surface that
    is 50 K warmer it would differ by 0.2 % at Re 4e3, 5 % at 1e4, 13 % at 1.5e5.
    """
    return shape_coefficients(speed * diameter / kinematic_viscosity(air))


def validity_notes(reynolds: float, average: NamedAverage) -> tuple[str, ...]:
    """Limits of validity that a result at this Reynolds number exceeds."""
    table = cylinder_table()
    found = []
    if reynolds > MAX_REYNOLDS:
        found.append(
            f"Re {reynolds:.3g} is above {MAX_REYNOLDS:.3g}, beyond which the Nusselt "
            "number is constant: give a lower speed or a smaller cylinder"
        )
    if reynolds > table.reynolds[~table.recalled].max():
        found.append(
            f"at Re {reynolds:.3g} the local Nusselt number rests on recalled curves, "
            "+-15 %, not on measured ones"
        )
    if not average.min_reynolds <= reynolds <= average.max_reynolds:
        found.append(
            f"Re {reynolds:.3g} is outside {average.name}'s range, "
            f"{average.min_reynolds:g} to {average.max_reynolds:g}"
        )
    return tuple(found)
