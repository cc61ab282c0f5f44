"""The error of a structure's surface temperatures against the full volume's."""

import contextlib
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float

from ..arrays import is_traced, precision
from ..errors import InputError
from ..integrate.run.abstract_solution import StoredSolution
from ..integrate.run.solution import Solution, SteadySolution
from ..scene.scene import SolvedSurface


# Where the surface has become uniform again, differences are not divided by 0.
_MIN_SPAN_FRACTION = 0.05
"""Smallest span of a time over the largest span of the run."""

PerTime = Float[Array | np.ndarray, " t"]
AnySolution = Solution | SteadySolution | StoredSolution


class SurfaceError(Module):
    """Difference of two runs on the same surface, at each saved time after 0."""

    times: Float[Array, " t"]
    """[s]"""
    rms_percent: Float[Array, " t"]
    """Area-weighted root mean square over the reference's span [%]."""
    p99_percent: Float[Array, " t"]
    """Difference that 99 % of the area does not exceed, over the span [%]."""
    max_percent: Float[Array, " t"]
    """Largest difference over the span [%]."""
    rms_kelvin: Float[Array, " t"]
    """Area-weighted root mean square [K]."""

    @property
    def worst_rms_percent(self) -> Float[Array, ""]:
        """Largest `rms_percent` of the saved times: the error of the run [%]."""
        return self.rms_percent.max()

    @property
    def worst_p99_percent(self) -> Float[Array, ""]:
        """Largest `p99_percent` of the saved times [%]."""
        return self.p99_percent.max()

    @property
    def worst_max_percent(self) -> Float[Array, ""]:
        """Largest `max_percent` of the saved times [%]."""
        return self.max_percent.max()

    @property
    def worst_rms_kelvin(self) -> Float[Array, ""]:
        """Largest `rms_kelvin` of the saved times [K]."""
        return self.rms_kelvin.max()


def surface_error(solution: AnySolution, reference: AnySolution) -> SurfaceError:
    """Compare a solution's surface temperatures with those of a reference.

    At a saved time t > 0, with areas a_s [m^2] and d_s = T_s - T_ref,s [K] over the
    fragments s,

        rms(t) = sqrt(sum a_s d_s^2 / sum a_s),    percent = 100 rms(t) / span(t),

    where span(t) is the reference's max - min over the surface at that time, or 5 % of
    the largest one in the run where that is more. The 99th percentile is weighted by
    area too. The result is differentiable in both; the root mean square has the slope
    0 where the two agree.

    Args:
        solution: run of some structure of a body.
        reference: run of the full volume of the same voxels, with the same save times.

    Raises:
        InputError: if they differ in their fragments or times, no time is after 0, or
            the reference's surface has one temperature at every time.
    """
    check_surfaces(solution.surfaces, reference.surfaces)
    with later_temperatures(solution, reference, "surface_error") as later:
        times, temperature, expected = (jnp.asarray(values) for values in later)
        if not is_traced(expected) and not jnp.ptp(expected, axis=1).max() > 0:
            raise InputError(
                "surface_error: the reference's surface has one temperature at every "
                "saved time: there is no range to measure by; give a scene that heats "
                "it unevenly"
            )
        areas = [np.asarray(s.geometry.fragment_area) for s in reference.surfaces]
        area = jnp.asarray(np.concatenate(areas), expected.dtype)
        return _error(times, temperature=temperature, expected=expected, area=area)


@eqx.filter_jit
def _error(
    times: Float[Array, " t"],
    temperature: Float[Array, "t s"],
    expected: Float[Array, "t s"],
    area: Float[Array, " s"],
) -> SurfaceError:
    span = jnp.asarray(error_span(expected))
    difference = temperature - expected
    weight = area / area.sum()
    rms = jnp.asarray(root((weight[None, :] * difference**2).sum(axis=1)))

    def percentile_99(row: Float[Array, " s"]) -> Float[Array, ""]:
        order = jnp.argsort(row)
        # Less what the sum of a million weights may lack by rounding.
        reached = jnp.cumsum(weight[order]) >= 0.99 - 1e-6
        return row[order[jnp.argmax(reached)]]

    size = jnp.abs(difference)
    return SurfaceError(
        times=times,
        rms_percent=100 * rms / span,
        p99_percent=100 * jax.vmap(percentile_99)(size) / span,
        max_percent=100 * size.max(axis=1) / span,
        rms_kelvin=rms,
    )


def error_span(
    reference: Float[Array | np.ndarray, "t s"],
    quantiles: tuple[float, float] = (0.0, 1.0),
) -> PerTime:
    """Return the span that differences are divided by at each time [K].

    The range between two quantiles of the reference, by default of all of it, or 5 % of
    the largest such range of the run if that is more; never 0.
    """
    xp = np if isinstance(reference, np.ndarray) else jnp
    if quantiles == (0.0, 1.0):
        low = reference.min(axis=1)
        high = reference.max(axis=1)
    else:
        ends = xp.asarray(quantiles, reference.dtype)
        low, high = xp.quantile(reference, ends, axis=1)
    spans = xp.maximum(high - low, _MIN_SPAN_FRACTION * (high - low).max())
    # A reference that is uniform at every time must not lead to NaN in a traced run.
    return xp.maximum(spans, xp.finfo(spans.dtype).tiny)


def root(square: PerTime) -> PerTime:
    """Return square roots, with the slope 0 at 0 instead of an infinite one."""
    xp = np if isinstance(square, np.ndarray) else jnp
    positive = square > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, square, 1)), 0)


@contextlib.contextmanager
def later_temperatures(
    solution: AnySolution, reference: AnySolution, caller: str
) -> Iterator[
    tuple[PerTime, Float[Array | np.ndarray, "t s"], Float[Array | np.ndarray, "t r"]]
]:
    """Give the saved times after 0 and the surface temperatures of both runs [K].

    Within the context both keep all their digits. The one time of a steady state is
    that of its loads, and may be 0.

    Raises:
        InputError: in the name of `caller`, for other times or none after 0.
    """
    wide = {str(s.surface_temperature.dtype) for s in (solution, reference)}
    with precision("float64" if "float64" in wide else "float32"):
        later = _later(solution, reference, caller)
        expected = reference.surface_temperature[later]
        temperature = solution.surface_temperature[later]
        dtype = np.promote_types(expected.dtype, temperature.dtype)
        times = reference.times[later]
        yield times, temperature.astype(dtype), expected.astype(dtype)


def _later(
    solution: AnySolution, reference: AnySolution, caller: str
) -> Bool[np.ndarray, " t"]:
    times = np.asarray(reference.times, float)
    traced = is_traced(solution.times)
    judged_times = times if traced else np.asarray(solution.times, float)
    if len(times) != len(judged_times) or not np.allclose(
        times, judged_times, rtol=1e-5
    ):
        raise InputError(
            f"{caller}: saved at [{_listed(judged_times)}] s and the reference at "
            f"[{_listed(times)}] s: give both the same save_at"
        )
    if isinstance(reference, SteadySolution):
        return np.ones(1, bool)
    if not (times > 0).any():
        raise InputError(
            f"{caller}: nothing is saved after time 0: give save_at later times"
        )
    return times > 0


def _listed(times: np.ndarray) -> str:
    return ", ".join([f"{t:g}" for t in times[:6]] + ["..."] * (len(times) > 6))


def check_surfaces(
    judged: tuple[SolvedSurface, ...], expected: tuple[SolvedSurface, ...]
) -> None:
    """Raise if the surfaces are not the same fragments of the same bodies."""
    if len(judged) != len(expected):
        raise InputError(
            f"surface_error: {len(judged)} bodies and the reference has "
            f"{len(expected)}: compare runs of the same scene"
        )
    pairs = zip(judged, expected, strict=True)
    for index, (judged_surface, reference_surface) in enumerate(pairs):
        geometry = judged_surface.geometry
        reference = reference_surface.geometry
        # Within a thousandth of a voxel: two voxelizations may round differently.
        if not (
            geometry.fragment_position.shape == reference.fragment_position.shape
            and np.allclose(
                geometry.fragment_position,
                reference.fragment_position,
                rtol=0,
                atol=1e-3 * reference.pitch,
            )
            and np.allclose(geometry.fragment_area, reference.fragment_area, rtol=1e-5)
        ):
            raise InputError(
                f"surface_error: body {index} has other surface fragments "
                f"({len(geometry.fragment_area)}) than the reference "
                f"({len(reference.fragment_area)}): voxelize once, and build both "
                "structures from that grid"
            )
