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

The correlations are evaluated once for each group of fragments, on a handful of
numbers; every fragment multiplies the result of its group by its own angular shape.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import array_namespace, is_traced, namespace, unique_rows
from ...voxels.cylinders import CylinderParts
from ..flux_law import Values
from .air import (
    FILM_TEMPERATURES,
    conductivity,
    film_polynomial,
    kinematic_viscosity,
    prandtl,
)
from .nusselt import (
    MAX_REYNOLDS,
    Average,
    NamedAverage,
    Pchip,
    cylinder_table,
    pchip,
)


# Relative difference of x / D + 1/2 within which fragments share a group.
_WAKE_STEP = 0.01

# Sine of the angle between wind and axis from which on the full shape applies.
_FULL_CROSS_FLOW = 0.5

_HARMONICS = 16

_Values = Float[Array, "..."] | Float[np.ndarray, "..."]


@functools.cache
def _shape() -> Pchip:
    table = cylinder_table()
    return pchip(np.log10(table.reynolds), table.shape)


def _shape_coefficients(reynolds: Float[Array, "*n"]) -> Float[Array, "*n k"]:
    # Re 1 is the first tabulated value, and log 0 has no derivative.
    return _shape()(jnp.log10(jnp.maximum(reynolds, 1.0)))


def _harmonics(cosine: _Values, square: _Values | float = 1.0) -> Any:
    """R_1 to R_16 along the first axis, from R_1 = r cos(theta) and r^2.

    The result is a numpy array for numpy input.
    """
    # Chebyshev's recurrence where r = 1, as on a cylinder's side: no arc cosine. On an
    # end, where the normal is parallel to the axis, all R_k vanish smoothly and Nu is
    # its average; a harmonic function has no extreme inside, so Nu > 0 in between.
    harmonics = [1.0, cosine]
    for _ in range(_HARMONICS - 1):
        harmonics.append(2 * cosine * harmonics[-1] - square * harmonics[-2])
    return array_namespace(cosine).stack(harmonics[1:])


def surface_harmonics(
    normal: Float[np.ndarray, "*n 3"],
    axis: Float[np.ndarray, "*#n 3"],
    wind: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "k *n"]:
    """R_k of cylinder surfaces, from unit vectors along normal, axis and wind."""
    along = (normal * axis).sum(-1)
    yaw = (wind * axis).sum(-1)
    crossing = 1 - yaw * yaw
    # The shape fades out towards wind along the axis, where theta is undefined.
    gain = 1 / np.maximum(np.sqrt(np.maximum(crossing, 0)), _FULL_CROSS_FLOW)
    cosine = -((normal * wind).sum(-1) - along * yaw) * gain
    return _harmonics(cosine, (1 - along * along) * crossing * gain * gain)


def _shape_factor(
    coefficients: Float[Array, "*n k"], harmonics: Float[Array, "k *n"]
) -> Float[Array, "*n"]:
    """Local over average Nusselt number [-], from the c_k and the R_k."""
    return 1 + (coefficients * jnp.moveaxis(harmonics, 0, -1)).sum(-1)


def local_nusselt(
    cosine: Float[Array, "*n"],
    reynolds: Float[Array, "*n"],
    prandtl_number: Float[Array, "*n"],
    average: Average,
) -> Float[Array, "*n"]:
    """Nu(theta, Re, Pr) on the side of a cylinder, from cos(theta)."""
    limited = jnp.minimum(reynolds, MAX_REYNOLDS)
    factor = _shape_factor(_shape_coefficients(limited), _harmonics(cosine))
    return average(limited, prandtl_number) * factor


def _mean_coefficient(
    speed: Float[Array, "*n"],
    diameter: Float[Array, "*#n"],
    film: Float[Array, "*#n"],
    average: Average,
) -> Float[Array, "*n"]:
    """Mean h of a cylinder [W/(m^2 K)]: Nbar k / D for air at the film temperature."""
    reynolds = speed * diameter / kinematic_viscosity(film)
    return average(reynolds, prandtl(film)) * conductivity(film) / diameter


class FlowGroups(NamedTuple):
    """Groups of fragments on one cylinder, at one distance behind another object."""

    diameter: Float[np.ndarray, " g"]
    """[m]"""
    behind: Float[np.ndarray, " g"]
    """x / D behind the upstream object [-]; infinite without one."""
    member: Int[np.ndarray, " s"]
    """Index of each fragment's group."""
    axis: Float[np.ndarray, "s 3"]
    """Unit vector along each fragment's cylinder, in the body's frame."""
    part: Int[np.ndarray, " g"]
    """Index of each group's cylinder."""


def group_fragments(
    cylinder_parts: CylinderParts, behind: Float[np.ndarray, " s"]
) -> FlowGroups:
    """Groups of the fragments at x / D = `behind`, rounded by half of a wake step."""
    exposed = np.isinf(behind)
    offset = np.where(exposed, 1.0, behind + 0.5)
    step = np.rint(np.log(offset) / _WAKE_STEP).astype(np.int64)
    number = cylinder_parts.fragment
    groups, member = unique_rows(np.stack([number, exposed, step], axis=1))
    group_cylinder, group_exposed, group_step = groups.T
    diameter = np.array([cylinder.diameter for cylinder in cylinder_parts.cylinders])
    axis = np.stack([cylinder.direction for cylinder in cylinder_parts.cylinders])
    rounded = np.maximum(np.exp(group_step * _WAKE_STEP) - 0.5, 0)
    return FlowGroups(
        diameter=diameter[group_cylinder],
        behind=np.where(group_exposed > 0, np.inf, rounded),
        member=member,
        axis=axis[number],
        part=group_cylinder,
    )


@functools.partial(jax.jit, static_argnames="average")
def _group_coefficients(
    speeds: Float[Array, " v"],
    air: Float[Array, ""],
    ratio: Float[Array, "*#v g"],
    diameter: Float[Array, " g"],
    average: NamedAverage,
) -> tuple[Float[Array, "v g n"], Float[Array, "v g k"]]:
    """Film polynomial of the mean h, and the c_k, of each group at each wind speed."""
    viscosity = kinematic_viscosity(air)
    ratio = ratio if ratio.ndim == 2 else ratio[None]
    local = speeds[:, None] * ratio
    # The average is constant above the largest Reynolds number.
    local = jnp.minimum(local, average.constant_above * viscosity / diameter[None])
    film = jnp.asarray(FILM_TEMPERATURES.astype(speeds.dtype))
    speed, width, film = jnp.broadcast_arrays(
        local[..., None], diameter[None, :, None], film[None, None]
    )
    mean = _mean_coefficient(speed, diameter=width, film=film, average=average.nusselt)
    # The stream as a whole determines where the flow separates, so the shape depends on
    # its temperature, not on the local film temperature. With the film of a surface
    # that is 50 K warmer it would differ by 0.2 % at Re 4e3, 5 % at 1e4, 13 % at 1.5e5.
    shape = _shape_coefficients(local * diameter[None] / viscosity)
    return film_polynomial(mean), shape


def film_coefficients(
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
    speed_ratio: Float[Values, "*#v g"],
    groups: FlowGroups,
    average: NamedAverage,
    harmonics: Float[np.ndarray, "k s"],
    dtype: Any,
) -> Float[Values, "v n s"]:
    """Film polynomial of h for every fragment at every wind speed [W/(m^2 K)].

    Wind speeds are in m/s, the temperature of the air in K; `speed_ratio` is the local
    speed of each group over the wind speed, one for all wind speeds or one for each,
    and `harmonics` are the R_k of each fragment.
    """
    mean, shape = _known_coefficients(
        speeds,
        air=air,
        speed_ratio=speed_ratio,
        groups=groups,
        average=average,
        dtype=dtype,
    )
    xp = namespace((mean, shape))
    member = groups.member
    typed_harmonics = harmonics.astype(dtype, copy=False)
    rows = []
    for polynomial, coefficients in zip(mean, shape, strict=True):
        cosines = xp.einsum("sk,ks->s", coefficients[member], typed_harmonics)
        rows.append(polynomial[member].T * (1 + cosines)[None])
    return xp.stack(rows)


def uniform_coefficients(
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
    speed_ratio: Float[Values, "*#v g"],
    groups: FlowGroups,
    average: NamedAverage,
    dtype: Any,
) -> Float[Values, "v n s"]:
    """Film polynomial of h as by `film_coefficients`, equal all around each group."""
    mean, _ = _known_coefficients(
        speeds,
        air=air,
        speed_ratio=speed_ratio,
        groups=groups,
        average=average,
        dtype=dtype,
    )
    return namespace(mean).moveaxis(mean[:, groups.member], 1, 2)


def _known_coefficients(
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
    speed_ratio: Float[Values, "*#v g"],
    groups: FlowGroups,
    average: NamedAverage,
    dtype: Any,
) -> tuple[Float[Values, "v h n"], Float[Values, "v h k"]]:
    """Results of `_group_coefficients`, as arrays of numpy where they are known."""

    def cast(values: Values) -> Float[Array, "..."]:
        host = values if is_traced(values) else np.asarray(values, dtype)
        return jnp.asarray(host, dtype)

    # Known values are computed at once, even while a scene is traced, and in numpy
    # from there on.
    with jax.ensure_compile_time_eval():
        mean, shape = _group_coefficients(
            cast(speeds),
            air=cast(air),
            ratio=cast(_padded(speed_ratio)),
            diameter=cast(_padded(groups.diameter)),
            average=average,
        )
        if not is_traced((mean, shape)):
            mean = np.asarray(mean)
            shape = np.asarray(shape)
    return mean, shape


def _padded(values: Float[Values, "*v g"]) -> Float[Values, "*v h"]:
    """Values with the last one repeated up to a power of two."""
    # Few distinct sizes require few programs.
    count = values.shape[-1]
    spare = max(16, 1 << (count - 1).bit_length()) - count
    widths = [(0, 0)] * (values.ndim - 1) + [(0, spare)]
    return namespace(values).pad(values, widths, mode="edge")


def validity_notes(reynolds: float, average: NamedAverage) -> tuple[str, ...]:
    """Limits of validity that a result at this Reynolds number exceeds."""
    table = cylinder_table()
    notes = []
    if reynolds > MAX_REYNOLDS:
        notes.append(
            f"Re {reynolds:.3g} is above {MAX_REYNOLDS:.3g}, beyond which the Nusselt "
            "number is constant: give a lower speed or a smaller cylinder"
        )
    if reynolds > table.reynolds[~table.recalled].max():
        notes.append(
            f"at Re {reynolds:.3g} the local Nusselt number rests on recalled curves, "
            "+-15 %, not on measured ones"
        )
    return (*notes, *average.range_note(reynolds))
