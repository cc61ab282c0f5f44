"""From a stream of air and a body's cylinders to what `film` needs at every place.

Fragments of one cylinder at nearly the same place in a wake form a group: of each group
the correlations are evaluated once, on a handful of numbers, and every fragment takes
its group's, times its own share of the angular shape.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import is_traced
from ...voxels.cylinders import CylinderParts
from ..term import Values
from ..time_varying import Table, Until, is_unknown_function, largest, value_at
from .air import FILM_TEMPERATURES, film_polynomial
from .cross_flow import held_speed, mean_coefficient, stream_shape
from .nusselt import Average


STRONGEST = 100.0
"""Where a speed is a plain function of time, it is held above this [m/s]."""

LEAST = 1e-3
"""Top of a table of speeds, at least [m/s]."""

WAKE_STEP = 0.01
"""Places whose x / D + 1/2 differ by less than this share are taken together."""


class Groups(NamedTuple):
    """Fragments on one cylinder, at one place in a wake."""

    diameter: Float[np.ndarray, " g"]
    """[m]"""
    behind: Float[np.ndarray, " g"]
    """x / D; infinite in the open."""
    member: Int[np.ndarray, " s"]
    """The group of each fragment."""
    axis: Float[np.ndarray, "s 3"]
    """Of each fragment's cylinder, in the body's own frame."""


def grouped(parts: CylinderParts, behind: Float[np.ndarray, " s"]) -> Groups:
    """Groups of the fragments at x / D = `behind`, rounded by half of WAKE_STEP."""
    exposed = np.isinf(behind)
    offset = np.where(exposed, 1.0, behind + 0.5)
    step = np.rint(np.log(offset) / WAKE_STEP).astype(np.int64)
    key = np.stack([parts.fragment, exposed, step], axis=1)
    found, member = np.unique(key, axis=0, return_inverse=True)
    diameter = np.array([cylinder.diameter for cylinder in parts.cylinders])
    axis = np.stack([cylinder.direction for cylinder in parts.cylinders])
    rounded = np.maximum(np.exp(found[:, 2] * WAKE_STEP) - 0.5, 0)
    return Groups(
        diameter=diameter[found[:, 0]],
        behind=np.where(found[:, 1] > 0, np.inf, rounded),
        member=member.reshape(-1),
        axis=axis[parts.fragment],
    )


class Stream(NamedTuple):
    """The air that meets each group."""

    air: Float[Values, ""]
    """T_inf [K]."""
    share: Float[Values, " g"]
    """Speed there over that of the wind."""
    diameter: Float[Values, " g"]
    """[m]"""


@partial(jax.jit, static_argnames="average")
def _of_groups(
    speeds: Float[Array, " v"], stream: Stream, average: Average
) -> tuple[Float[Array, "v g n"], Float[Array, "v g k"]]:
    """Film polynomial of the mean h, and the c_k, of each group at each wind speed."""
    air, share, diameter = (jnp.asarray(v, speeds.dtype) for v in stream)
    local = held_speed(speeds[:, None] * share[None], diameter[None], air)
    film = jnp.asarray(FILM_TEMPERATURES.astype(speeds.dtype))
    speed, width, film = jnp.broadcast_arrays(
        local[..., None], diameter[None, :, None], film[None, None]
    )
    mean = mean_coefficient(speed, width, film, average)
    shape = stream_shape(local, jnp.broadcast_to(diameter, local.shape), air)
    return film_polynomial(mean), shape


def at_places(
    speeds: Float[Values, " v"],
    stream: Stream,
    average: Average,
    member: Int[np.ndarray, " s"],
    harmonics: Float[np.ndarray, "k s"],
    dtype: Any,
) -> Float[Values, "v n s"]:
    """Coefficients of the film polynomial of h at every fragment [W/(m^2 K)].

    Args:
        speeds: of the wind [m/s].
        stream: at each group.
        average: the correlation of the mean.
        member: the group of each fragment.
        harmonics: R_k of each fragment.
        dtype: of the result.
    """
    mean, shape = _known(partial(_of_groups, average=average), speeds, stream, dtype)
    own = jnp if is_traced((mean, shape)) else np
    found = harmonics.astype(dtype)
    rows = [
        m[member].T * (1 + own.einsum("sk,ks->s", c[member], found))[None]
        for m, c in zip(mean, shape, strict=True)
    ]
    return own.stack(rows)


def _known(function: Any, speeds: Any, stream: Stream, dtype: Any) -> Any:
    """The function's value, as numpy where nothing is traced, even inside a trace."""
    cast = lambda v: jnp.asarray(v if is_traced(v) else np.asarray(v, dtype), dtype)
    # What is known while the rest of a scene is traced is found there too.
    with jax.ensure_compile_time_eval():
        every = Stream(
            stream.air, _rounded_up(stream.share), _rounded_up(stream.diameter)
        )
        found = function(cast(speeds), Stream(*map(cast, every)))
        return found if is_traced(found) else jax.tree.map(np.asarray, found)


def _rounded_up(values: Float[Values, " g"]) -> Float[Values, " h"]:
    """With the last one repeated up to a power of two: few programs are compiled."""
    more = max(16, 1 << (len(values) - 1).bit_length()) - len(values)
    own = jnp if is_traced(values) else np
    return own.pad(values, (0, more), mode="edge")


def at_start(value: Any, dtype: Any) -> Float[Values, ""]:
    """A number or a function of time, at 0 s."""
    with jax.ensure_compile_time_eval():
        found = value_at(value, jnp.zeros((), dtype))
        return found if is_traced(found) else np.asarray(found)


def known_largest(value: Any) -> float | None:
    """The largest value ever taken; None for what only a run would tell."""
    stated = value.value if isinstance(value, Until) else value
    stated = stated.values if isinstance(stated, Table) else stated
    if callable(stated) or is_traced(stated):
        return None
    return float(np.max(np.asarray(stated, float)))


def highest_speed(speed: Any) -> Float[Array, ""] | float:
    """Where a table of speeds may end [m/s]."""
    if is_unknown_function(speed):
        return STRONGEST
    known = known_largest(speed)
    return jnp.maximum(largest(speed, 0.0), LEAST) if known is None else known
