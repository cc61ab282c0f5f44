"""Poses of cameras from whole frames: where a fit of them may start.

A fit compares pixels away from outlines, whose temperatures change slowly: it finds the
pose to a fraction of a pixel, from some pixels away. Here the outlines count, which are
seen from far: the pose minimizes the squares of model minus data, both blurred over
ever fewer pixels,

    sum_p [G_s * (T(pose) - T_data)]_p^2 + pull,

whose derivative follows from differences of rendered frames. Temperatures of the model
may be off by a part of the contrast between body and background: a blurred outline does
not move with them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.image.band import Band
from jaxthermo.image.camera import AbstractCamera
from jaxthermo.image.pose import moved_camera
from jaxthermo.image.view import View, compute_view
from jaxthermo.integrate.run.parametric_run import ParametricRun, ParametricSolution
from jaxthermo.physics.radiation.irradiation import Irradiance
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.scene.scene import Scene, SolvedSurface

from ..config.frame_names import is_of_camera, pose_numbers
from .frame_source import CaseFrames
from .parameters import ParameterSet
from .targets import frame_at, received_at


_BLURS = (16.0, 8.0, 4.0, 2.0)
"""Standard deviation of the blur in each round [pixels]."""
_MIN_BLUR = 2.0
"""Blur in pixels of the frame that is rendered: it has fewer, if it may."""
_PULL = 1e-4
"""Weight of a change of the pose by a pixel, in the frames' standard deviation: it
decides where an outline does not, between turning a camera and moving it aside."""
_STEP = 0.5
"""Step of differences [pixels]."""
_MAX_EVALUATIONS = 12
"""Number of derivatives in a round."""


class ShownRun(NamedTuple):
    """A run of which frames are drawn on the host."""

    surfaces: tuple[SolvedSurface, ...]
    terms: tuple[AbstractTerm, ...]
    times: Float[Array, " t"]
    temperature: Float[np.ndarray, "t s"]
    """Of the fragments [K]."""
    received: tuple[Irradiance, ...]
    """Radiation that reaches them, at each time."""
    quantity: str
    band: Band | None

    @classmethod
    def of(
        cls,
        scene: Scene,
        solution: ParametricSolution,
        times: tuple[float, ...],
        quantity: str,
        band: Band | None,
        reflected: Any,
    ) -> "ShownRun":
        """Read what frames need of a run."""
        surface = solution.surface_temperature
        at = jnp.asarray(times, surface.dtype)
        rows = [received_at(solution, s, t, reflected) for s, t in zip(surface, at, strict=True)]
        hosted = tuple(Irradiance(*map(np.asarray, row)) for row in rows)
        shown = np.asarray(surface), hosted
        return cls(solution.surfaces, scene.terms, at, *shown, quantity, band)

    def frame(self, view: View, time: int) -> Float[np.ndarray, "h w"]:
        """Frame of a saved time."""
        given = self.temperature[time], self.received[time], self.times[time]
        bodies = view, self.surfaces, self.terms
        drawn = frame_at(*bodies, *given, self.quantity, self.band)
        return np.asarray(drawn, float)


class Aligned(NamedTuple):
    """Pose that the outlines give, and what is left of the difference."""

    pose: Float[np.ndarray, "6"]
    rms: float
    """Of the blurred frames' difference, over the data's standard deviation."""


class Limits(NamedTuple):
    """Numbers of a camera's pose that are fitted, and their bounds."""

    numbers: Int[np.ndarray, " n"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]


def align(
    run: ShownRun,
    camera: AbstractCamera,
    frames: Float[np.ndarray, "t h w"],
    mask: Bool[np.ndarray, "h w"] | None,
    start: Float[np.ndarray, "6"],
    limits: Limits,
) -> Aligned:
    """Find the pose of a camera by the saved time of the largest contrast.

    Raises:
        InputError: if the camera sees no body in the pose where it starts.
    """
    known = np.asarray(np.isfinite(frames).all(axis=0))
    known = known if mask is None else known & mask
    if not known.any():
        raise InputError("no pixel of the frames is compared: check the mask")
    time = int(np.argmax([frame[known].std() for frame in frames]))
    data = np.where(known, frames[time], 0.0)
    pose, unit = start.copy(), _pixel_sizes(run, camera)[limits.numbers]
    rms = 0.0
    for blur in _BLURS:
        coarse = _Coarse.of(camera, data, known, blur)

        def residual(q: np.ndarray, coarse: _Coarse = coarse) -> np.ndarray:
            moved = pose.copy()
            moved[limits.numbers] = q * unit
            away = coarse.difference(run, time, moved)
            pull = _PULL * (q - start[limits.numbers] / unit)
            return np.concatenate([away, pull])

        found = _solve(residual, pose[limits.numbers] / unit, limits, unit)
        pose[limits.numbers] = found * unit
        rms = float(np.linalg.norm(residual(found)))
    return Aligned(pose, rms)


class _Coarse(NamedTuple):
    """Data of a round, in as few pixels as its blur needs."""

    camera: AbstractCamera
    data: Float[np.ndarray, "h w"]
    known: Float[np.ndarray, "h w"]
    blur: float
    scale: float

    @classmethod
    def of(
        cls, camera: AbstractCamera, data: np.ndarray, known: np.ndarray, blur: float
    ) -> "_Coarse":
        factor = 1
        while (
            blur / factor >= 2 * _MIN_BLUR
            and camera.width % (2 * factor) == 0
            and camera.height % (2 * factor) == 0
        ):
            factor *= 2
        height, width = camera.height // factor, camera.width // factor
        means = lambda a: a.reshape(height, factor, width, factor).mean(axis=(1, 3))
        weight = means(known.astype(float))
        mean = means(data) / np.maximum(weight, 1e-9)
        scale = data[known].std() * np.sqrt(weight.sum())
        small = replace(camera, width=width, height=height)
        # A block that is cut by the mask is not compared.
        whole = (weight == 1).astype(float)
        return cls(small, mean, whole, blur / factor, max(float(scale), 1e-12))

    def difference(self, run: ShownRun, time: int, pose: np.ndarray) -> np.ndarray:
        """Blurred model minus data, whose squares have the mean 1 for no model."""
        moved = moved_camera(self.camera, pose)
        try:
            view = compute_view(run.surfaces, run.terms, moved, keep=False)
        except InputError:
            # A trial that sees no body is refused.
            return np.ones(self.data.size)
        away = (run.frame(view, time) - self.data) * self.known
        return (gaussian_filter(away, self.blur) / self.scale).ravel()


def _pixel_sizes(run: ShownRun, camera: AbstractCamera) -> Float[np.ndarray, "6"]:
    """Change of each number of a pose that moves the image by about a pixel."""
    view = compute_view(run.surfaces, (), camera)
    depth = float(np.median(view.depth))
    middle = np.array([0, 1]) + camera.width * (camera.height // 2)
    origin, step = camera.rays(middle)
    pixel = np.linalg.norm((origin + depth * step)[1] - (origin + depth * step)[0])
    # A move along the view, and a turn about it, act by the size of the body.
    lengths = np.array([1.0, 1.0, 4.0])
    return np.concatenate([lengths * pixel / depth, lengths * pixel])


def _solve(
    residual: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    limits: Limits,
    unit: np.ndarray,
) -> np.ndarray:
    def jacobian(q: np.ndarray) -> np.ndarray:
        base = residual(q)
        # Inwards, so that no bound is crossed.
        signs = np.where(q + _STEP < limits.upper / unit, _STEP, -_STEP)
        steps = np.diag(signs)
        rows = [residual(q + step) - base for step in steps]
        return np.stack(rows, axis=1) / signs

    margin = 1e-3 * (limits.upper - limits.lower)
    bounds = (limits.lower + margin) / unit, (limits.upper - margin) / unit
    inside = np.clip(start, *bounds)
    return least_squares(
        residual, inside, jacobian, bounds, xtol=1e-3, ftol=1e-4,
        max_nfev=_MAX_EVALUATIONS,
    ).x  # fmt: skip


def align_cameras(
    found: CaseFrames, scene: Scene, run: ParametricRun, parameters: ParameterSet
) -> dict[int, Aligned]:
    """Poses of the cameras that are fitted, by their numbers, at the start values."""
    with precision(scene.dtype):
        z = np.zeros(parameters.size, scene.dtype)
        poses = np.asarray(parameters.poses(z, len(found.views)), float)
        warm = parameters.insert(scene, z)
        solution = run(warm, run.step_table(warm))
        reflected = parameters.frame_values(z).reflected
        if reflected is None:
            reflected = found.settings.reflected_temperature
        quantity = found.settings.quantity
        shown = warm, solution, found.times, quantity, found.band, reflected
        drawn, aligned = ShownRun.of(*shown), {}
        for number, (view, frames) in enumerate(
            zip(found.views, found.frames, strict=True)
        ):
            limits = _limits(parameters, number)
            if limits is None:
                continue
            mask = found.masks[number] if number < len(found.masks) else None
            given = drawn, view.camera, frames, mask, poses[number], limits
            aligned[number] = align(*given)
    return aligned


def _limits(parameters: ParameterSet, camera: int) -> Limits | None:
    """Fitted numbers of a camera's pose; None without any."""
    rows = []
    for p in parameters.parameters:
        if is_of_camera(p.name) and pose_numbers(p.name)[0] == camera:
            rows += [(n, p.lower, p.upper) for n in pose_numbers(p.name)[1]]
    if not rows:
        return None
    numbers, lower, upper = np.array(rows).T
    return Limits(numbers.astype(int), lower, upper)


def started_at(parameters: ParameterSet, aligned: dict[int, Aligned]) -> ParameterSet:
    """Parameters whose poses of cameras start where they were aligned."""
    made = []
    for p in parameters.parameters:
        if is_of_camera(p.name) and pose_numbers(p.name)[0] in aligned:
            camera, numbers = pose_numbers(p.name)
            start = tuple(float(aligned[camera].pose[n]) for n in numbers)
            p = replace(p, start=start)
        made.append(p)
    return ParameterSet(tuple(made))
