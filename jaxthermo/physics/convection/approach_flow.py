"""Flow that meets a body's cylinders, and film coefficients of every fragment in it."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import is_traced
from ...voxels.cylinders import CylinderParts
from ..flux_law import Values
from ..time_varying import Table, Until, is_unknown_function, largest, value_at
from .air import FILM_TEMPERATURES, film_polynomial
from .cross_flow import limited_speed, mean_coefficient, stream_shape
from .nusselt import Average


# A speed given as a plain function of time is limited to this [m/s].
_MAX_UNKNOWN_SPEED = 100.0

# Smallest upper end of a table of speeds [m/s].
_MIN_TABLE_LIMIT = 1e-3

# Relative difference of x / D + 1/2 below which fragments share a group.
_WAKE_STEP = 0.01


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


def group_fragments(
    parts: CylinderParts, behind: Float[np.ndarray, " s"]
) -> FlowGroups:
    """Groups of the fragments at x / D = `behind`, rounded by half of a wake step."""
    # The correlations are evaluated once for each group, on a handful of numbers, and
    # every fragment multiplies the result of its group by its own angular shape.
    exposed = np.isinf(behind)
    offset = np.where(exposed, 1.0, behind + 0.5)
    step = np.rint(np.log(offset) / _WAKE_STEP).astype(np.int64)
    key = np.stack([parts.fragment, exposed, step], axis=1)
    found, member = np.unique(key, axis=0, return_inverse=True)
    diameter = np.array([cylinder.diameter for cylinder in parts.cylinders])
    axis = np.stack([cylinder.direction for cylinder in parts.cylinders])
    rounded = np.maximum(np.exp(found[:, 2] * _WAKE_STEP) - 0.5, 0)
    return FlowGroups(
        diameter=diameter[found[:, 0]],
        behind=np.where(found[:, 1] > 0, np.inf, rounded),
        member=member.reshape(-1),
        axis=axis[parts.fragment],
    )


class ApproachFlow(NamedTuple):
    """Air that meets each group."""

    air: Float[Values, ""]
    """T_inf [K]."""
    speed_ratio: Float[Values, " g"]
    """Local speed over that of the wind, u / U [-]."""
    diameter: Float[Values, " g"]
    """[m]"""


@partial(jax.jit, static_argnames="average")
def _group_coefficients(
    speeds: Float[Array, " v"], flow: ApproachFlow, average: Average
) -> tuple[Float[Array, "v g n"], Float[Array, "v g k"]]:
    """Film polynomial of the mean h, and the c_k, of each group at each wind speed."""
    air, ratio, diameter = (jnp.asarray(v, speeds.dtype) for v in flow)
    local = limited_speed(speeds[:, None] * ratio[None], diameter[None], air)
    film = jnp.asarray(FILM_TEMPERATURES.astype(speeds.dtype))
    speed, width, film = jnp.broadcast_arrays(
        local[..., None], diameter[None, :, None], film[None, None]
    )
    mean = mean_coefficient(speed, width, film, average)
    shape = stream_shape(local, jnp.broadcast_to(diameter, local.shape), air)
    return film_polynomial(mean), shape


def film_coefficients(
    speeds: Float[Values, " v"],
    flow: ApproachFlow,
    average: Average,
    member: Int[np.ndarray, " s"],
    harmonics: Float[np.ndarray, "k s"],
    dtype: Any,
) -> Float[Values, "v n s"]:
    """Film polynomial of h for every fragment at every wind speed [W/(m^2 K)].

    Speeds are in m/s, `member` is the group and `harmonics` the R_k of each fragment.
    """
    function = partial(_group_coefficients, average=average)
    mean, shape = _evaluate(function, speeds, flow, dtype)
    xp = jnp if is_traced((mean, shape)) else np
    found = harmonics.astype(dtype)
    rows = [
        m[member].T * (1 + xp.einsum("sk,ks->s", c[member], found))[None]
        for m, c in zip(mean, shape, strict=True)
    ]
    return xp.stack(rows)


def _evaluate(function: Any, speeds: Any, flow: ApproachFlow, dtype: Any) -> Any:
    """Value of the function, in numpy where nothing is traced."""
    cast = lambda v: jnp.asarray(v if is_traced(v) else np.asarray(v, dtype), dtype)
    # Known values are computed at once, even while the rest of a scene is traced.
    with jax.ensure_compile_time_eval():
        padded = ApproachFlow(
            flow.air, _padded(flow.speed_ratio), _padded(flow.diameter)
        )
        found = function(cast(speeds), ApproachFlow(*map(cast, padded)))
        return found if is_traced(found) else jax.tree.map(np.asarray, found)


def _padded(values: Float[Values, " g"]) -> Float[Values, " h"]:
    """Values with the last one repeated up to a power of two."""
    # Few distinct sizes, hence few programs to compile.
    more = max(16, 1 << (len(values) - 1).bit_length()) - len(values)
    xp = jnp if is_traced(values) else np
    return xp.pad(values, (0, more), mode="edge")


def initial_value(value: Any, dtype: Any) -> Float[Values, ""]:
    """Value of a number or a function of time at 0 s."""
    with jax.ensure_compile_time_eval():
        found = value_at(value, jnp.zeros((), dtype))
        return found if is_traced(found) else np.asarray(found)


def known_maximum(value: Any) -> float | None:
    """Largest value at any time; None for functions of time and traced values."""
    stated = value.value if isinstance(value, Until) else value
    stated = stated.values if isinstance(stated, Table) else stated
    if callable(stated) or is_traced(stated):
        return None
    return float(np.max(np.asarray(stated, float)))


def table_limit(speed: Any) -> Float[Array, ""] | float:
    """Largest speed that a table of speeds has to cover [m/s]."""
    if is_unknown_function(speed):
        return _MAX_UNKNOWN_SPEED
    known = known_maximum(speed)
    if known is None:
        return jnp.maximum(largest(speed, 0.0), _MIN_TABLE_LIMIT)
    return known
