"""The error of a run against a finer one, at points of the mesh that both stand for."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float, Int

from ..arrays import namespace
from ..errors import InputError
from ..geometry.mesh import Mesh, joined
from ..geometry.sample import MeshSample, mesh_sample
from ..integrate.run.abstract_solution import StoredSolution
from ..integrate.run.solution import Solution
from ..integrate.run.surface_reading import SurfaceReading, surface_reading
from ..scene.scene import BodyGeometry, SolvedSurface
from .error_records import TruthErrors, finite_number, finite_numbers
from .surface_error import (
    AnySolution,
    PerTime,
    error_span,
    later_temperatures,
    root,
)


# Ends of the range that a difference is compared with: a few points on thin parts,
# which are much warmer or colder than all others, would make every error look small.
_RANGE_QUANTILES = (0.005, 0.995)


# Half, with room for rounding: with errors of second order, the reference's error is
# then a quarter of the run's.
_MAX_PITCH_RATIO = 0.501
"""Largest pitch of a reference over that of the run that it judges [-]."""

_STORED_POSITIONS = 200
"""Number of fragments by whose positions two runs on the same voxels are recognized."""

_Number = Float[Array | np.ndarray, ""] | np.floating


class AtPoints(NamedTuple):
    """Surface temperatures of a run, read at points of a mesh."""

    temperature: Float[Array | np.ndarray, "t p"]
    """[K]"""
    is_lost: Bool[np.ndarray, " p"]
    """True where the run's voxels have no surface: the temperature has no meaning."""


class _BodyOutline(NamedTuple):
    """Properties of a body that show whether two runs have the same mesh, or voxels."""

    pitch: float
    """[m]"""
    extent: Float[np.ndarray, "2 3"]
    """Lowest and highest corner of the mesh [m]."""
    fragments: int
    """Number of fragments."""
    position: Float[np.ndarray, "k 3"]
    """Positions of every n-th fragment [m]."""


class TruthPoints(NamedTuple):
    """A reference run, read at points of its meshes, to which runs are compared.

    Much smaller than the run, so that one reference serves many runs in many processes.
    """

    times: PerTime
    """[s]"""
    samples: tuple[MeshSample, ...]
    """Points of each body in its own frame."""
    expected: AtPoints
    """The reference at the points of all bodies."""
    outlines: tuple[_BodyOutline, ...]

    def reading(self, surfaces: tuple[SolvedSurface, ...]) -> SurfaceReading:
        """Find the fragments from which temperatures at the points are read."""
        return _reading(surfaces, list(self.samples))

    def error(
        self, solution: AnySolution, reading: SurfaceReading | None = None
    ) -> "TruthError":
        """Compare a run with the reference, as `truth_error` does.

        Args:
            solution: a run of the same bodies.
            reading: how to read its surfaces at the points; None to find it.

        Raises:
            InputError: if the run is of other bodies or save times.
        """
        outlines = _outlines(solution.surfaces)
        _check_meshes(outlines, self.outlines)
        expected = self.expected
        reference = StoredSolution(self.times, expected.temperature, ())
        used_reading = self.reading(solution.surfaces) if reading is None else reading
        with later_temperatures(solution, reference, "truth_error") as later:
            times, temperature, expected_temperature = (
                np.asarray(values) for values in later
            )
            return error_at_points(
                times,
                judged=AtPoints(used_reading.read(temperature), used_reading.is_lost),
                expected=AtPoints(expected_temperature, expected.is_lost),
                remarks=_remarks(outlines, self.outlines),
            )


class TruthError(Module):
    """Difference of a run from a reference on the mesh, at each saved time after 0."""

    times: PerTime
    """[s]"""
    rms_kelvin: PerTime
    """Root mean square over the points [K]."""
    rms_percent: PerTime
    """`rms_kelvin` over the reference's range [%]."""
    p99_kelvin: PerTime
    """Difference that 99 % of the points do not exceed [K]."""
    bias_kelvin: PerTime
    """Mean difference [K]; positive if the run is too warm."""
    lost_fraction: PerTime
    """Fraction of the reference's surface that the run's voxels do not have [-]: left
    out of the differences."""
    reference_lost_fraction: _Number
    """Fraction of the mesh that the reference's own voxels do not have [-]."""
    remarks: tuple[str, ...] = eqx.field(static=True, default=())
    """Sentences on bodies whose reference is not independent of the run, or not twice
    as fine."""

    @property
    def worst_rms_kelvin(self) -> _Number:
        """Largest `rms_kelvin` of the saved times [K]."""
        return self.rms_kelvin.max()

    @property
    def worst_rms_percent(self) -> _Number:
        """Largest `rms_percent` of the saved times: the error of the run [%]."""
        return self.rms_percent.max()

    @property
    def worst_p99_kelvin(self) -> _Number:
        """Largest `p99_kelvin` of the saved times [K]."""
        return self.p99_kelvin.max()

    @property
    def worst_bias_kelvin(self) -> _Number:
        """The `bias_kelvin` farthest from 0, with its sign [K]."""
        return self.bias_kelvin[abs(self.bias_kelvin).argmax()]

    @property
    def worst_lost_fraction(self) -> _Number:
        """Largest `lost_fraction` of the saved times [-]."""
        return self.lost_fraction.max()

    def as_dict(self) -> TruthErrors:
        """Return all numbers as plain types for JSON; None for an infinite one."""
        return TruthErrors(
            times_s=np.asarray(self.times, float).tolist(),
            rms_kelvin=finite_numbers(self.rms_kelvin),
            worst_rms_kelvin=finite_number(self.worst_rms_kelvin),
            rms_percent=finite_numbers(self.rms_percent),
            worst_rms_percent=finite_number(self.worst_rms_percent),
            p99_kelvin=finite_numbers(self.p99_kelvin),
            worst_p99_kelvin=finite_number(self.worst_p99_kelvin),
            bias_kelvin=finite_numbers(self.bias_kelvin),
            worst_bias_kelvin=finite_number(self.worst_bias_kelvin),
            lost_fraction=finite_numbers(self.lost_fraction),
            worst_lost_fraction=finite_number(self.worst_lost_fraction),
            reference_lost_fraction=float(self.reference_lost_fraction),
            remarks=list(self.remarks),
        )


def truth_points(
    reference: Solution | StoredSolution, count: int = 10_000, seed: int = 0
) -> TruthPoints:
    """Read a reference run at points spread evenly over the area of its meshes.

    Args:
        reference: a run in fine voxels.
        count: number of points, on all bodies together.
        seed: of the points.
    """
    samples = _samples(reference.surfaces, count, seed)
    reading = _reading(reference.surfaces, samples)
    temperature = np.asarray(reference.surface_temperature)
    return TruthPoints(
        times=np.asarray(reference.times),
        samples=tuple(samples),
        expected=AtPoints(reading.read(temperature), reading.is_lost),
        outlines=_outlines(reference.surfaces),
    )


def truth_error(
    solution: AnySolution, reference: AnySolution, count: int = 10_000, seed: int = 0
) -> TruthError:
    """Compare a run's surface temperatures with those of a finer one of any voxels.

    With T and T_ref read to second order at points spread evenly over the area of the
    reference's meshes, at a saved time t > 0

        rms(t) = sqrt(mean (T - T_ref)^2) [K],    percent = 100 rms(t) / range(t),

    where range(t) is from the 0.5 to the 99.5 % quantile of T_ref over the points, or
    5 % of the largest such range of the run where that is more. Bodies are compared in
    their own frames, so that they may move. Differentiable in both temperatures.

    Args:
        solution: from `simulate` or `steady`, or read from a file. For the error of its
            surface, with a surface map `at="surface"`, as is the default.
        reference: of the same bodies, at least twice as fine: its own error is part of
            every difference. It has the save times of the run.
        count: number of points, on all bodies together.
        seed: of the points.

    Raises:
        InputError: if they differ in the number of bodies or in times, no time is after
            0, or they have no surface in common.

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
        >>> sun = jt.Sun(direction=(-1.0, 0.0, -1.0), irradiance=1000.0)
        >>> def solve(pitch):
        ...     grid = jt.voxelize(jt.shapes.sphere(0.04), pitch)
        ...     body = jt.Body(jt.FullVolume(grid), steel, temperature=300.0)
        ...     return jt.simulate(jt.Scene((body,), (sun,)), 60.0, save_at=[60.0])
        >>> error = jt.truth_error(solve(0.01), solve(0.005))
        >>> bool(error.worst_rms_kelvin < 0.5), float(error.worst_lost_fraction)
        (True, 0.0)
    """
    outlines = _outlines(solution.surfaces)
    reference_outlines = _outlines(reference.surfaces)
    _check_meshes(outlines, reference_outlines)
    samples = _samples(reference.surfaces, count, seed)
    reference_reading = _reading(reference.surfaces, samples)
    solution_reading = _reading(solution.surfaces, samples)
    with later_temperatures(solution, reference, "truth_error") as later:
        times, temperature, expected = later
        # Without derivatives by numpy: nothing to compile for each number of points.
        xp = namespace((temperature, expected))
        temperature = xp.asarray(temperature)
        expected = xp.asarray(expected)
        return error_at_points(
            xp.asarray(times),
            judged=AtPoints(
                solution_reading.read(temperature), solution_reading.is_lost
            ),
            expected=AtPoints(
                reference_reading.read(expected), reference_reading.is_lost
            ),
            remarks=_remarks(outlines, reference_outlines),
        )


def _outlines(surfaces: tuple[SolvedSurface, ...]) -> tuple[_BodyOutline, ...]:
    outlines = []
    for geometry in (surface.geometry for surface in surfaces):
        extent = np.stack(
            [geometry.vertices.min(axis=0), geometry.vertices.max(axis=0)]
        )
        position = np.asarray(geometry.fragment_position)
        stride = max(1, len(position) // _STORED_POSITIONS)
        outlines.append(
            _BodyOutline(
                pitch=geometry.pitch,
                extent=extent,
                fragments=len(position),
                position=np.array(position[::stride], float),
            )
        )
    return tuple(outlines)


def _check_meshes(
    judged: tuple[_BodyOutline, ...], reference: tuple[_BodyOutline, ...]
) -> None:
    """Raise for bodies of other sizes: part of their surfaces could agree by chance."""
    if len(judged) != len(reference):
        raise InputError(
            f"truth_error: {len(judged)} bodies and the reference has "
            f"{len(reference)}: compare runs of the same scene"
        )
    for index, (a, b) in enumerate(zip(judged, reference, strict=True)):
        off = float(abs(a.extent - b.extent).max())
        # Meshes made of voxels end on their faces.
        if off > max(a.pitch, b.pitch):
            raise InputError(
                f"truth_error: the mesh of body {index} ends up to {off:.3g} m away "
                "from that of the reference: compare runs of the same meshes, each in "
                "the frame of its body"
            )


def _remarks(
    judged: tuple[_BodyOutline, ...], reference: tuple[_BodyOutline, ...]
) -> tuple[str, ...]:
    """Name the bodies whose reference is not independent of the run, or too coarse."""
    remarks = []
    for index, (outline, finer) in enumerate(zip(judged, reference, strict=True)):
        if outline.fragments == finer.fragments and np.allclose(
            outline.position, finer.position, rtol=0, atol=1e-3 * outline.pitch
        ):
            remarks.append(
                f"body {index} has the voxels of the reference: the error is that of "
                "its structure alone"
            )
        elif finer.pitch > _MAX_PITCH_RATIO * outline.pitch:
            remarks.append(
                f"the reference's voxels of body {index}, {finer.pitch * 1e3:.4g} mm, "
                f"are not twice as fine as the run's, {outline.pitch * 1e3:.4g} mm: a "
                "part of the difference is the reference's own error"
            )
    return tuple(remarks)


def _samples(
    surfaces: tuple[SolvedSurface, ...], count: int, seed: int
) -> list[MeshSample]:
    """Points of each body in its own frame, evenly over the area of all."""
    meshes = [_both_sides(surface.geometry) for surface in surfaces]
    last = np.cumsum([len(faces) for _, faces in meshes])
    vertices, faces = joined(meshes)
    together = Mesh(vertices, faces, name="the reference")
    sample = mesh_sample(together, count, seed)
    body = np.searchsorted(last, sample.face, side="right")
    return [
        MeshSample(*(column[body == index] for column in sample))
        for index in range(len(meshes))
    ]


def _both_sides(
    geometry: BodyGeometry,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices [m] and faces of a body; those of a sheet for each of its sides."""
    faces = geometry.faces
    if geometry.is_two_sided:
        faces = np.concatenate([faces, faces[:, ::-1]])
    return geometry.vertices, faces


def _reading(
    surfaces: tuple[SolvedSurface, ...], samples: list[MeshSample]
) -> SurfaceReading:
    """Reading of the points of all bodies from the fragments of all bodies."""
    readings = []
    first = 0
    for surface, sample in zip(surfaces, samples, strict=True):
        body_reading = surface_reading(surface.geometry, sample.position, sample.normal)
        readings.append(body_reading._replace(fragment=body_reading.fragment + first))
        first += len(surface.geometry.fragment_area)
    return SurfaceReading(
        *(np.concatenate(column) for column in zip(*readings, strict=True))
    )


def error_at_points(
    times: PerTime, judged: AtPoints, expected: AtPoints, remarks: tuple[str, ...] = ()
) -> TruthError:
    """Compare a run with a reference that were read at the same points.

    Raises:
        InputError: if they have no point in common.
    """
    readable = np.flatnonzero(~expected.is_lost)
    lost = judged.is_lost[readable]
    common = readable[~lost]
    if not len(common):
        raise InputError(
            "truth_error: the solution and the reference have no surface in common: "
            "compare runs of the same meshes, each in the frame of its body"
        )
    xp = namespace((judged.temperature, expected.temperature))
    span = error_span(expected.temperature[:, readable], _RANGE_QUANTILES)
    difference = judged.temperature[:, common] - expected.temperature[:, common]
    rms = root((difference**2).mean(axis=1))
    # A reference of one temperature has no range: any error is infinitely large then.
    has_range = span > xp.finfo(span.dtype).tiny
    uniform = xp.where(rms > 0, xp.inf, xp.zeros_like(rms))
    percent = xp.where(has_range, 100 * rms / xp.where(has_range, span, 1), uniform)
    return TruthError(
        times=times,
        rms_kelvin=rms,
        rms_percent=percent,
        p99_kelvin=xp.quantile(abs(difference), 0.99, axis=1),
        bias_kelvin=difference.mean(axis=1),
        lost_fraction=xp.full_like(rms, lost.mean()),
        reference_lost_fraction=xp.asarray(expected.is_lost.mean(), rms.dtype),
        remarks=remarks,
    )
