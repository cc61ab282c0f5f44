"""Forced convection of plates and spheres in wind.

| surface | Nusselt number | Re | source |
|---|---|---|---|
| plate along the wind | 0.664 Re^(1/2) Pr^(1/3) | to 5e5 | Pohlhausen 1921 |
| | (0.037 Re^(4/5) - 871) Pr^(1/3) | to 1e8 | Incropera, 7.38 |
| plate across, windward side | 0.86 Re^(1/2) Pr^(1/3) | 2e4 to 9e4 | Sparrow 1979 |
| plate across, leeward side | 0.191 Re^(2/3) Pr^(1/3) | 7e3 to 8e4 | Sparrow 2004 |
| sphere | 2 + (0.4 Re^(1/2) + 0.06 Re^(2/3)) Pr^(0.4) | 3.5 to 7.6e4 | Whitaker 1972 |

Along the wind the flow is laminar up to x_c, 5e5 nu / V at the temperature of the
stream, and turbulent behind it, with y = x_c / L and 1 at most:

    Nu = [0.664 Re^(1/2) y^(1/2) + 0.037 Re^(4/5) (1 - y^(4/5))] Pr^(1/3)

These are the two lines of the table where the film has the temperature of the stream.

The lengths are, along the wind, the mean length of the plate in its direction; on the
windward side 4 A / P; on the leeward side the short side of the plate; the diameter of
a sphere. Sparrow, Ramsey and Mass (J. Heat Transfer 101, 199) found one number for all
angles of attack from 25 degrees on; below, the numbers of both sides pass smoothly into
that along the wind. The leeward side is that of Sparrow, Abraham and Tong (IJHMT 47,
5285). Narrow sides have the mean of both. Whitaker's factor (mu / mu_s)^(1/4) is left
out, since properties are those at the film temperature: 3 % at 50 K in air.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced, smooth_step
from ...geometry.vectors import row_dot, unit_vector
from ...voxels.body_shape import Plates, Sphere
from ..flux_law import Values
from .air import kinematic_viscosity
from .cross_flow import FlowGroups, uniform_coefficients
from .nusselt import NamedAverage, smooth_root, smooth_two_thirds


# Reynolds number at which the boundary layer of a plate becomes turbulent.
_TRANSITION = 5e5

# Sine of the angle of attack from which on a plate is across the wind, 25 degrees.
_FULL_ATTACK = float(np.sin(np.radians(25.0)))


def _laminar(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Mean Nusselt number of a laminar flow along a plate."""
    return 0.664 * smooth_root(reynolds) * jnp.cbrt(prandtl)


def _turbulent(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Mean Nusselt number of a flow along a plate, turbulent from its edge on."""
    # Below this number the flow has no turbulent part.
    developed = jnp.maximum(reynolds, _TRANSITION / 100)
    return 0.037 * developed**0.8 * jnp.cbrt(prandtl)


def _laminar_fraction(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Part of the laminar number, by that of the stream over the whole length."""
    return jnp.sqrt(_TRANSITION / jnp.maximum(reynolds, _TRANSITION))


def _turbulent_fraction(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Part of the turbulent number, by that of the stream over the whole length."""
    return 1 - (_TRANSITION / jnp.maximum(reynolds, _TRANSITION)) ** 0.8


def _whole(reynolds: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Part of a number that acts at all Reynolds numbers."""
    return jnp.ones_like(reynolds)


def _windward(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Mean Nusselt number of the windward side of a plate across the wind."""
    return 0.86 * smooth_root(reynolds) * jnp.cbrt(prandtl)


def _leeward(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Mean Nusselt number of the leeward side of a plate across the wind."""
    return 0.191 * smooth_two_thirds(reynolds) * jnp.cbrt(prandtl)


def _whitaker(
    reynolds: Float[Array, "*n"], prandtl: Float[Array, "*#n"]
) -> Float[Array, "*n"]:
    """Mean Nusselt number of a sphere."""
    flow = 0.4 * smooth_root(reynolds) + 0.06 * smooth_two_thirds(reynolds)
    return 2 + flow * prandtl**0.4


_LAMINAR = NamedAverage(
    name="laminar flow along it",
    nusselt=_laminar,
    min_reynolds=500.0,
    max_reynolds=np.inf,
)
_TURBULENT = NamedAverage(
    name="turbulent flow along it",
    nusselt=_turbulent,
    min_reynolds=0.0,
    max_reynolds=1e8,
)
_WINDWARD = NamedAverage(
    name="windward side", nusselt=_windward, min_reynolds=2e4, max_reynolds=9e4
)
_LEEWARD = NamedAverage(
    name="leeward side", nusselt=_leeward, min_reynolds=7e3, max_reynolds=8e4
)
_WHITAKER = NamedAverage(
    name="Whitaker", nusselt=_whitaker, min_reynolds=3.5, max_reynolds=7.6e4
)


class MeanNumber(NamedTuple):
    """A mean Nusselt number that acts on a body, with its length."""

    correlation: NamedAverage
    length: Float[np.ndarray, " p"]
    """Length on each plate, or of the sphere [m]."""
    weight: Float[np.ndarray, " s"]
    """Part that it has in the number of each fragment [-]."""
    by_reynolds: Callable[[Float[Array, "*n"]], Float[Array, "*n"]] = _whole
    """Part that it has by the Reynolds number of the stream [-]."""


def mean_numbers(
    shape: Plates | Sphere,
    normal: Float[np.ndarray, "s 3"],
    wind: Float[np.ndarray, "3"],
) -> tuple[MeanNumber, ...]:
    """Numbers of plates or a sphere, from outward normals and the wind's direction.

    All vectors have length one, in the frame of the body.
    """
    if isinstance(shape, Sphere):
        diameter = np.array([shape.diameter])
        return (MeanNumber(_WHITAKER, diameter, np.ones(len(normal))),)
    plates = shape.plates
    across_plate = np.stack([plate.normal for plate in plates])
    toward = across_plate @ wind
    attack = smooth_step(np.minimum(np.abs(toward) / _FULL_ATTACK, 1.0))
    across = attack[shape.member]
    against = np.sign(toward)[:, None] * across_plate
    windward = (1 - row_dot(normal, against[shape.member])) / 2
    along = np.array([float(plate.mean_length(wind)) for plate in plates])
    along_weight = 1 - across
    hydraulic_length = np.array([plate.hydraulic_length for plate in plates])
    short_side = np.array([plate.short_side for plate in plates])
    numbers = (
        MeanNumber(_LAMINAR, along, weight=along_weight, by_reynolds=_laminar_fraction),
        MeanNumber(
            _TURBULENT, along, weight=along_weight, by_reynolds=_turbulent_fraction
        ),
        MeanNumber(_WINDWARD, length=hydraulic_length, weight=across * windward),
        MeanNumber(_LEEWARD, length=short_side, weight=across * (1 - windward)),
    )
    return tuple(number for number in numbers if number.weight.any())


def mean_coefficients(
    numbers: tuple[MeanNumber, ...],
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
    speed_ratio: Float[Values, "*#v g"],
    groups: FlowGroups,
    dtype: Any,
) -> Float[Values, "v n s"]:
    """Film polynomial of h for every fragment at every wind speed [W/(m^2 K)].

    Arguments are those of `film_coefficients`.
    """
    total: Any = 0.0
    for number in numbers:
        rows = uniform_coefficients(
            speeds,
            air=air,
            speed_ratio=speed_ratio,
            groups=groups._replace(diameter=number.length[groups.part]),
            average=number.correlation,
            dtype=dtype,
        )
        by_group = _weight_by_reynolds(
            number,
            length=number.length[groups.part],
            speeds=speeds,
            air=air,
            ratio=speed_ratio,
            dtype=dtype,
        )
        by_fragment = by_group[:, groups.member] * number.weight.astype(dtype)[None]
        total = total + by_fragment[:, None] * rows
    return total


def _weight_by_reynolds(
    number: MeanNumber,
    length: Float[np.ndarray, " g"],
    speeds: Float[Values, " v"],
    air: Float[Values, ""],
    ratio: Float[Values, "*#v g"],
    dtype: Any,
) -> Float[Values, "v g"]:
    """Part of a number at each wind speed, for each group."""
    with jax.ensure_compile_time_eval():
        ratios = jnp.asarray(ratio, dtype)
        # One ratio for all wind speeds, or one for each.
        ratios = ratios if ratios.ndim == 2 else ratios[None]
        local = jnp.asarray(speeds, dtype)[:, None] * ratios
        viscosity = kinematic_viscosity(jnp.asarray(air, dtype))
        lengths = jnp.asarray(length.astype(dtype))[None]
        weight = number.by_reynolds(local * lengths / viscosity)
        return weight if is_traced(weight) else np.asarray(weight)


def described(
    shape: Plates | Sphere, numbers: tuple[MeanNumber, ...], wind: np.ndarray
) -> str:
    """One line on the shape of a body, its numbers and their lengths."""
    sources = ", ".join(
        f"{number.correlation.name} with L = {_range_of(number.length)}"
        for number in numbers
    )
    if isinstance(shape, Sphere):
        return f"a sphere: {sources}, its diameter"
    plate, *others = shape.plates
    if others:
        return f"{len(shape.plates)} panels, each a plate: {sources}"
    attack = np.degrees(np.arcsin(min(abs(float(plate.normal @ unit_vector(wind))), 1)))
    return (
        f"a plate {plate.thickness:.3g} m thick, {attack:.3g} degrees out of the wind: "
        f"{sources}"
    )


def _range_of(lengths: Float[np.ndarray, " p"]) -> str:
    ends = dict.fromkeys(f"{end:.3g} m" for end in (lengths.min(), lengths.max()))
    return " to ".join(ends)
