"""Poses of cameras from whole frames: where a fit of them may start.

A fit compares pixels away from outlines, whose temperatures change slowly: it finds the
pose to a fraction of a pixel, from some pixels away. Here the outlines count, which are
seen from far: the pose minimizes the squares of model minus data, both blurred over
ever fewer pixels,

    sum_p [G_s * (T(pose) - T_data)]_p^2 + pull,

whose derivative follows from differences of rendered frames. Temperatures of the model
may be off by a part of the contrast between body and background: a blurred outline does
not move with them. The last part of a pixel follows without them, see `outlines`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from jaxthermo.errors import InputError
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.radiance.band import black_radiance
from jaxthermo.image.radiance.draw import Moment
from jaxthermo.image.surface.abstract_camera import AbstractCamera
from jaxthermo.image.surface.view import View, compute_view
from jaxthermo.image.surface.visible import world_meshes
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.scene.scene import Scene, SolvedSurface

from .frame_quantity import FrameQuantity
from .outlines import Outlines, fit_outlines


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
    """A run whose frames are drawn on the host."""

    frame_quantity: FrameQuantity
    moments: tuple[Moment, ...]
    """States at the saved times, in arrays of numpy."""

    @classmethod
    def of(
        cls,
        frame_quantity: FrameQuantity,
        scene: Scene,
        solution: ParametricSolution,
        times: tuple[float, ...],
    ) -> "ShownRun":
        """Read what frames need of a run."""
        kelvin = solution.surface_temperature
        moments = []
        for surface, time in zip(kelvin, jnp.asarray(times, kelvin.dtype), strict=True):
            moment = frame_quantity.moment(scene, solution, surface=surface, time=time)
            on_host = jax.tree.map(np.asarray, (moment.temperature, moment.received))
            temperature, received = on_host
            moments.append(moment._replace(temperature=temperature, received=received))
        return cls(frame_quantity, tuple(moments))

    @property
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        """Surfaces of the bodies."""
        return self.moments[0].surfaces

    @property
    def terms(self) -> tuple[AbstractTerm, ...]:
        """Terms of the scene."""
        return self.moments[0].terms

    def frame(self, view: View, time: int) -> Float[np.ndarray, "h w"]:
        """Frame of a saved time."""
        return np.asarray(self.frame_quantity.frame(view, self.moments[time]), float)


class Limits(NamedTuple):
    """Numbers of a camera's pose that are fitted, and their bounds."""

    numbers: Int[np.ndarray, " n"]
    lower: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]


class Aligned(NamedTuple):
    """Pose that the outlines give, and how well they determine it."""

    pose: Float[np.ndarray, "6"]
    numbers: Int[np.ndarray, " n"]
    """Indices of the fitted numbers of the pose."""
    whiten: Float[np.ndarray, "n n"] | None = None
    """Deviations of these from the pose to independent ones of standard deviation 1;
    None where the outlines were not found to a part of a pixel."""
    effect: float = 1.0
    """Squares that the data sum to over independent ones, which these then weigh."""


def align(
    run: ShownRun,
    camera: AbstractCamera,
    frames: Float[np.ndarray, "t h w"],
    mask: Bool[np.ndarray, "h w"] | None,
    start: Float[np.ndarray, "6"],
    limits: Limits,
) -> Aligned:
    """Find the pose of a camera by the saved time of the largest contrast.

    From a start that is some pixels off, with temperatures that are off by a part of
    the contrast.

    Raises:
        InputError: if the camera sees no body as it is given, or nothing is compared.
    """
    compared = np.asarray(np.isfinite(frames).all(axis=0))
    compared = compared if mask is None else compared & mask
    if not compared.any():
        raise InputError("no pixel of the frames is compared: check the mask")
    time = int(np.argmax([frame[compared].std() for frame in frames]))
    # Pixels that are not compared still have to be temperatures.
    data = np.where(compared, frames[time], frames[time][compared].mean())
    pose = start.copy()
    unit = _pixel_sizes(run, camera)[limits.numbers]

    def difference(coarse: _Coarse, q: np.ndarray) -> np.ndarray:
        moved = pose.copy()
        moved[limits.numbers] = q * unit
        return coarse.difference(run, time, moved)

    edge = 1e-3 * (limits.upper - limits.lower)
    lower = (limits.lower + edge) / unit
    upper = (limits.upper - edge) / unit
    first = np.clip(pose[limits.numbers] / unit, lower, upper)
    q = first
    for blur in _BLURS:
        coarse = _Coarse.of(camera, data=data, compared=compared, blur=blur)

        def pulled(q: np.ndarray, coarse: _Coarse = coarse) -> np.ndarray:
            return np.append(difference(coarse, q), _PULL * (q - first))

        q = _search(pulled, start=q, bounds=(lower, upper))
    pose[limits.numbers] = q * unit
    outlines = _sharpen(
        run,
        camera=camera,
        data=data,
        compared=compared,
        pose=pose,
        limits=limits,
        unit=unit,
    )
    if outlines is None:
        return Aligned(pose, limits.numbers)
    pose[limits.numbers] = outlines.numbers
    return Aligned(pose, limits.numbers, np.linalg.cholesky(outlines.information).T)


def _sharpen(
    run: ShownRun,
    camera: AbstractCamera,
    data: Float[np.ndarray, "h w"],
    compared: Bool[np.ndarray, "h w"],
    pose: Float[np.ndarray, "6"],
    limits: Limits,
    unit: Float[np.ndarray, " n"],
) -> Outlines | None:
    """Pose to a small part of a pixel by outlines; None if they do not give one."""
    # Pixels of a source that is before a body show neither body nor background.
    view = compute_view(
        run.surfaces, terms=run.terms, camera=moved_camera(camera, pose), keep=False
    )
    hidden = np.zeros(data.size, bool)
    for source in view.background.sources:
        hidden[source.pixel] = True
    radiance = data
    if run.frame_quantity.quantity == "temperature":
        radiance = np.asarray(black_radiance(data, run.frame_quantity.band))
    outlines = fit_outlines(
        world_meshes(run.surfaces),
        camera=camera,
        radiance=radiance,
        compared=compared & ~hidden.reshape(data.shape),
        pose=pose,
        numbers=limits.numbers,
        unit=unit,
    )
    if outlines is None:
        return None
    inside = (outlines.numbers > limits.lower) & (outlines.numbers < limits.upper)
    return outlines if inside.all() else None


class _Coarse(NamedTuple):
    """Data of a round, in as few pixels as its blur needs."""

    camera: AbstractCamera
    data: Float[np.ndarray, "h w"]
    compared: Float[np.ndarray, "h w"]
    blur: float
    scale: float

    @classmethod
    def of(
        cls, camera: AbstractCamera, data: np.ndarray, compared: np.ndarray, blur: float
    ) -> "_Coarse":
        factor = 1
        while (
            blur / factor >= 2 * _MIN_BLUR
            and camera.width % (2 * factor) == 0
            and camera.height % (2 * factor) == 0
        ):
            factor *= 2
        height = camera.height // factor
        width = camera.width // factor

        def means(image: np.ndarray) -> np.ndarray:
            return image.reshape(height, factor, width, factor).mean(axis=(1, 3))

        weight = means(compared.astype(float))
        mean = means(data) / np.maximum(weight, 1e-9)
        scale = data[compared].std() * np.sqrt(weight.sum())
        small = replace(camera, width=width, height=height)
        # A block that is cut by the mask is not compared.
        complete = (weight == 1).astype(float)
        return cls(
            camera=small,
            data=mean,
            compared=complete,
            blur=blur / factor,
            scale=max(float(scale), 1e-12),
        )

    def difference(self, run: ShownRun, time: int, pose: np.ndarray) -> np.ndarray:
        """Blurred model minus data, whose squares have the mean 1 for no model."""
        moved = moved_camera(self.camera, pose)
        try:
            view = compute_view(run.surfaces, run.terms, moved, keep=False)
        except InputError:
            # A trial that sees no body is refused.
            return np.ones(self.data.size)
        away = (run.frame(view, time) - self.data) * self.compared
        return (gaussian_filter(away, self.blur) / self.scale).ravel()


def _pixel_sizes(run: ShownRun, camera: AbstractCamera) -> Float[np.ndarray, "6"]:
    """Change of each number of a pose that moves the image by about a pixel."""
    view = compute_view(run.surfaces, (), camera)
    depth = float(np.median(view.depth))
    middle = np.array([0, 1]) + camera.width * (camera.height // 2)
    origin, step = camera.rays(middle)
    first, second = origin + depth * step
    pixel = np.linalg.norm(second - first)
    # A move along the view, and a turn about it, act by the size of the body.
    lengths = np.array([1.0, 1.0, 4.0])
    return np.concatenate([lengths * pixel / depth, lengths * pixel])


_Residual = Callable[[np.ndarray], np.ndarray]
_Bounds = tuple[np.ndarray, np.ndarray]


def _differences(residual: _Residual, q: np.ndarray) -> Float[np.ndarray, "r n"]:
    """Slopes of residuals, per pixel."""
    steps = _STEP * np.eye(len(q))
    columns = [residual(q + step) - residual(q - step) for step in steps]
    return np.stack(columns, axis=1) / (2 * _STEP)


def _search(residual: _Residual, start: np.ndarray, bounds: _Bounds) -> np.ndarray:
    # scipy's stub names the methods of differences only.
    jacobian: Any = partial(_differences, residual)
    fitted = least_squares(
        residual,
        start,
        jac=jacobian,
        bounds=bounds,
        xtol=1e-3,
        ftol=1e-3,
        max_nfev=_MAX_EVALUATIONS,
    )
    return fitted.x
