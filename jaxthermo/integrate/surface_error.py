"""How far a cheap structure's surface is from the full volume's: one definition.

At a saved time t > 0, with areas a_s and d_s = T_s - T_ref,s over the fragments s:

    rms(t) = sqrt(sum a_s d_s^2 / sum a_s),    percent = 100 rms(t) / span(t),

where span(t) is the reference's max - min over the surface at that time, or 5 % of the
largest one in the run where that is more. The 99th percentile is weighted by area too.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..arrays import is_traced, precision
from ..errors import InputError
from ..scene.solved_surface import SolvedSurface
from .run.solution import Solution
from .run.solution_file import StoredSolution


LEAST_SPAN = 0.05
"""Of the run's largest range: a time at which all is even again counts with this."""

AnySolution = Solution | StoredSolution


class SurfaceError(eqx.Module):
    """The difference of two runs on the same surface, at each saved time after 0."""

    times: Float[Array, " t"]
    """[s]"""
    rms_percent: Float[Array, " t"]
    """Of the reference's span at that time."""
    p99_percent: Float[Array, " t"]
    """Not exceeded on 99 % of the area."""
    max_percent: Float[Array, " t"]
    rms_kelvin: Float[Array, " t"]

    @property
    def worst_rms_percent(self) -> Float[Array, ""]:
        """The run's error: the largest over its saved times."""
        return self.rms_percent.max()

    @property
    def worst_p99_percent(self) -> Float[Array, ""]:
        """The largest over the saved times."""
        return self.p99_percent.max()

    @property
    def worst_max_percent(self) -> Float[Array, ""]:
        """The largest over the saved times."""
        return self.max_percent.max()

    @property
    def worst_rms_kelvin(self) -> Float[Array, ""]:
        """The largest over the saved times."""
        return self.rms_kelvin.max()


def surface_error(solution: AnySolution, reference: AnySolution) -> SurfaceError:
    """How far a solution's surface temperatures are from a reference's.

    It can be differentiated in both; the root mean square has the slope 0 where the two
    agree.

    Args:
        solution: of some structure of a body.
        reference: of the same voxels at the same times: the full volume's.

    Raises:
        InputError: if they differ in their fragments or times, no time is after 0, or
            the reference's surface has no range to measure by.
    """
    check_surfaces(solution.surfaces, reference.surfaces)
    wide = {str(s.surface_temperature.dtype) for s in (solution, reference)}
    with precision("float64" if "float64" in wide else "float32"):
        later = _later(solution, reference)
        expected = jnp.asarray(reference.surface_temperature)[later]
        found = jnp.asarray(solution.surface_temperature)[later]
        _check_range(expected)
        areas = [np.asarray(s.geometry.fragment_area) for s in reference.surfaces]
        area = jnp.asarray(np.concatenate(areas), expected.dtype)
        times = jnp.asarray(reference.times)[later]
        return _error(times, found.astype(expected.dtype), expected, area)


@eqx.filter_jit
def _error(
    times: Float[Array, " t"],
    found: Float[Array, "t s"],
    expected: Float[Array, "t s"],
    area: Float[Array, " s"],
) -> SurfaceError:
    """The sums of `surface_error`."""
    span = error_span(expected)
    percent = lambda kelvin: 100 * kelvin / span
    difference, share = found - expected, area / area.sum()
    rms = _root((share[None, :] * difference**2).sum(axis=1))
    size = jnp.abs(difference)
    return SurfaceError(
        times=times,
        rms_percent=percent(rms),
        p99_percent=percent(_percentile(size, share, 0.99)),
        max_percent=percent(size.max(axis=1)),
        rms_kelvin=rms,
    )


def error_span(reference: Float[Array, "t s"]) -> Float[Array, " t"]:
    """What differences are measured by at each time [K].

    Args:
        reference: surface temperatures of the full volume [K].
    """
    ranges = reference.max(axis=1) - reference.min(axis=1)
    spans = jnp.maximum(ranges, LEAST_SPAN * ranges.max())
    return jnp.maximum(spans, jnp.finfo(spans.dtype).tiny)


def _check_range(reference: Float[Array, "t s"]) -> None:
    if is_traced(reference) or float(jnp.ptp(reference, axis=1).max()) > 0:
        return
    raise InputError(
        "surface_error: the reference's surface has one temperature at every saved "
        "time: there is no range to measure by; give a scene that heats it unevenly"
    )


def _root(square: Float[Array, " t"]) -> Float[Array, " t"]:
    """Square root with the slope 0, not infinity, at 0."""
    some = square > 0
    return jnp.where(some, jnp.sqrt(jnp.where(some, square, 1)), 0)


def _percentile(
    values: Float[Array, "t s"], share: Float[Array, " s"], level: float
) -> Float[Array, " t"]:
    """The smallest value that `level` of the area does not exceed."""

    def one(row: Float[Array, " s"]) -> Float[Array, ""]:
        order = jnp.argsort(row)
        # What a sum of a million shares may lack of its true value by rounding.
        reached = jnp.cumsum(share[order]) >= level - 1e-6
        return row[order[jnp.argmax(reached)]]

    return jax.vmap(one)(values)


def _later(solution: AnySolution, reference: AnySolution) -> Bool[np.ndarray, " t"]:
    """Which saved times are after 0; the same ones in both."""
    times = np.asarray(reference.times, float)
    traced = is_traced(solution.times)
    others = times if traced else np.asarray(solution.times, float)
    if len(times) != len(others) or not np.allclose(times, others, rtol=1e-5):
        raise InputError(
            f"surface_error: saved at {_listed(others)} s and the reference at "
            f"{_listed(times)} s: give both the same save_at"
        )
    if not (times > 0).any():
        raise InputError(
            "surface_error: nothing is saved after time 0: give save_at later times"
        )
    return times > 0


def _listed(times: Float[np.ndarray, " t"]) -> str:
    shown = [f"{t:g}" for t in times[:6]] + ["..."] * (len(times) > 6)
    return f"[{', '.join(shown)}]"


def check_surfaces(
    found: tuple[SolvedSurface, ...], expected: tuple[SolvedSurface, ...]
) -> None:
    """Raise unless both are the same fragments of the same bodies."""
    if len(found) != len(expected):
        raise InputError(
            f"surface_error: {len(found)} bodies and the reference has "
            f"{len(expected)}: compare runs of the same scene"
        )
    for index, (one, other) in enumerate(zip(found, expected, strict=True)):
        here, there = one.geometry, other.geometry
        same = here.fragment_position.shape == there.fragment_position.shape and (
            np.allclose(
                here.fragment_position,
                there.fragment_position,
                rtol=0,
                atol=1e-3 * there.pitch,
            )
            and np.allclose(here.fragment_area, there.fragment_area, rtol=1e-5)
        )
        if not same:
            raise InputError(
                f"surface_error: body {index} has other surface fragments "
                f"({len(here.fragment_area)}) than the reference "
                f"({len(there.fragment_area)}): voxelize once, and build both "
                "structures from that grid"
            )
