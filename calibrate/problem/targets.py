"""Data that runs are compared with: surfaces of full-volume runs, and thermograms.

A target turns surface temperatures into residuals whose squares sum to about 1 where
model and data differ by one unit: 1 % error, or one standard deviation of pixel noise.
"""

import abc
import math
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from jaxthermo.accuracy.surface_error import AnySolution, error_span
from jaxthermo.errors import InputError
from jaxthermo.image.pose.derivative import LinearizedView, blank_view, linearize_view
from jaxthermo.image.pose.pose import moved_camera
from jaxthermo.image.surface.view import View, compute_view
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.scene.scene import Scene, SolvedSurface

from ..config.fit_record import CaseErrors
from .clusters import view_clusters
from .frame_quantity import FrameQuantity
from .frame_values import AS_GIVEN, FrameValues


_MAX_LOST = 0.01
"""Fraction of the compared pixels without a body in a pose that is refused."""


class CaseError(NamedTuple):
    """Root mean square error of one case at each saved time."""

    times: tuple[float, ...]
    """[s]"""
    percent: tuple[float, ...]
    """Percent of the reference's temperature range, or of the pixel noise."""
    kelvin: tuple[float, ...]
    """In kelvin, or in the unit of the frames."""

    @property
    def worst(self) -> float:
        """Error of the case: the largest over the times [%]."""
        return max(self.percent)

    def as_json(self) -> CaseErrors:
        """Values for `fit.json`."""
        return {
            "times_s": list(self.times),
            "rms_percent": list(self.percent),
            "rms_kelvin": list(self.kelvin),
            "worst_percent": self.worst,
        }


class AbstractTarget(eqx.Module):
    """Data of one case."""

    times: eqx.AbstractVar[tuple[float, ...]]

    @property
    def camera_count(self) -> int:
        """Number of cameras whose frames are compared."""
        return 0

    def views_at(
        self, poses: Float[np.ndarray, "v 6"], dtype: Any
    ) -> tuple[LinearizedView, ...]:
        """Views of the cameras near poses."""
        del poses, dtype
        return ()

    @property
    def edges(self) -> tuple[int, ...]:
        """Edges of squares of an image, from a pixel to a whole view; none if none."""
        return ()

    def clusters(
        self, edge: int | None = None, through_time: bool = True
    ) -> Int[np.ndarray, " r"] | None:
        """Numbers of the squares of an image that residuals belong to, times first.

        None where there is no image. See `view_clusters` for the arguments.
        """
        del edge, through_time
        return None

    @property
    @abc.abstractmethod
    def known_sd(self) -> float | None:
        """Standard deviation of a residual due to noise; None if it is not known."""

    @abc.abstractmethod
    def residual(
        self,
        scene: Scene,
        solution: ParametricSolution,
        values: FrameValues = AS_GIVEN,
    ) -> Float[Array, "t r"]:
        """Residuals of a run, one row per saved time."""

    @abc.abstractmethod
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        """Error in percent and kelvin of the root sum of squared residuals."""


class SurfaceTarget(AbstractTarget):
    """Surface temperatures of a reference run: a residual norm of 1 is an error of 1 %.

        r_ts = 100 sqrt(a_s / sum a) (T_ts - T_ref,ts) / span_t / sqrt(times),

    whose squares sum to the mean over the times of the squared error in percent.
    """

    times: tuple[float, ...] = eqx.field(static=True)
    reference: Float[Array, "t s"]
    """[K]"""
    scale: Float[Array, "t s"]
    """[1/K]"""

    @property
    @override
    def known_sd(self) -> float | None:
        # What remains after a fit is the model's error and no noise.
        return None

    @override
    def residual(
        self,
        scene: Scene,
        solution: ParametricSolution,
        values: FrameValues = AS_GIVEN,
    ) -> Float[Array, "t r"]:
        # The scene's terms only matter to cameras.
        del scene, values
        return (solution.surface_temperature - self.reference) * self.scale

    @override
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        span = np.asarray(error_span(jnp.asarray(np.asarray(self.reference))), float)
        return CaseError(
            times=self.times,
            percent=tuple(errors.tolist()),
            kelvin=tuple(errors * span / 100),
        )


def surface_target(
    reference: AnySolution,
    dtype: Any,
    unknown: Bool[np.ndarray, " s"] | None = None,
) -> SurfaceTarget:
    """Make a target of a reference that is saved at times after 0.

    Fragments where it is `unknown` are not compared.
    """
    surface = np.asarray(reference.surface_temperature, float)
    times = tuple(float(t) for t in np.asarray(reference.times))
    if not np.isfinite(surface).all():
        raise InputError("the reference holds temperatures that are not finite")
    # Errors are relative to the range of the surface temperatures.
    if not (np.ptp(surface, axis=1) > 0).any():
        raise InputError(
            "the reference's surface has one temperature at every saved time: there is "
            "nothing to fit; give a case that heats it unevenly"
        )
    area = np.concatenate([s.geometry.fragment_area for s in reference.surfaces])
    if unknown is not None:
        area = np.where(unknown, 0, area)
    span = np.asarray(error_span(jnp.asarray(surface)), float)
    scale = 100 * np.sqrt(area / area.sum())[None] / span[:, None]
    # The sum of squares is then the mean over the times.
    scale = scale / np.sqrt(len(times))
    return SurfaceTarget(
        times=times,
        reference=jnp.asarray(surface, dtype),
        scale=jnp.asarray(scale, dtype),
    )


class FrameTarget(AbstractTarget):
    """Pixels of several views at every saved time.

    r = (model - data) / noise / sqrt(pixels of all views and times)
    """

    times: tuple[float, ...] = eqx.field(static=True)
    views: tuple[View, ...] = eqx.field(static=True)
    data: tuple[Float[Array, "_ _"], ...]
    """Compared pixels of each view, one row per saved time [K or W/(m^2 sr)]."""
    indices: tuple[Int[Array, " _"], ...]
    """Indices of the compared pixels of each view."""
    noise: float = eqx.field(static=True)
    """Standard deviation of a pixel [K or W/(m^2 sr)]."""
    frame_quantity: FrameQuantity = eqx.field(static=True)
    """Quantity of the frames, in a band."""
    surfaces: tuple[SolvedSurface, ...] = ()
    """Surfaces of the bodies, where the poses of cameras are fitted."""
    room: tuple[int, ...] = eqx.field(static=True, default=())
    """Room for weights of fragments in each view, in all poses."""

    @property
    @override
    def camera_count(self) -> int:
        return len(self.views)

    def without_moves(
        self, poses: Float[np.ndarray, "v 6"], terms: tuple[AbstractTerm, ...]
    ) -> "FrameTarget":
        """Target whose cameras stay in these poses."""
        moved = tuple(
            compute_view(self.surfaces, terms, moved_camera(v.camera, p), keep=False)
            for v, p in zip(self.views, poses, strict=True)
        )
        return replace(self, views=moved, surfaces=(), room=())

    @override
    def views_at(
        self, poses: Float[np.ndarray, "v 6"], dtype: Any
    ) -> tuple[LinearizedView, ...]:
        views = []
        for view, pose, pixels, room in zip(
            self.views, poses, self.indices, self.room, strict=True
        ):
            try:
                near = linearize_view(
                    self.surfaces,
                    camera=view.camera,
                    pose=pose,
                    pixels=np.asarray(pixels),
                    size=room,
                    dtype=dtype,
                )
                is_far = float(np.mean(near.seen)) < 1 - _MAX_LOST
            except (InputError, OverflowError):
                near = None
                is_far = True
            if near is None or is_far:
                # Residuals that are not finite: the trial is refused.
                near = blank_view(len(pixels), size=room, pose=pose, dtype=dtype)
            views.append(near)
        return tuple(views)

    @property
    def pixel_count(self) -> int:
        """Number of compared pixels of all views at all times."""
        return sum(len(indices) for indices in self.indices) * len(self.times)

    @property
    @override
    def known_sd(self) -> float | None:
        return 1 / math.sqrt(self.pixel_count)

    @property
    @override
    def edges(self) -> tuple[int, ...]:
        longest = max(max(view.camera.size) for view in self.views)
        return tuple(2**power for power in range((longest - 1).bit_length() + 1))

    @override
    def clusters(
        self, edge: int | None = None, through_time: bool = True
    ) -> Int[np.ndarray, " r"] | None:
        return view_clusters(
            self.indices,
            widths=[view.camera.width for view in self.views],
            times=len(self.times),
            edge=edge,
            through_time=through_time,
        )

    def pixel_words(self, row: int) -> str:
        """View, row, column and time of a residual, by its number."""
        counts = [len(indices) for indices in self.indices]
        time, number = divmod(row, sum(counts))
        view = int(np.searchsorted(np.cumsum(counts), number, side="right"))
        pixel = int(self.indices[view][number - sum(counts[:view])])
        y, x = divmod(pixel, self.views[view].camera.width)
        return f"view {view}, row {y}, column {x}, at {self.times[time]:g} s"

    @override
    def residual(
        self,
        scene: Scene,
        solution: ParametricSolution,
        values: FrameValues = AS_GIVEN,
    ) -> Float[Array, "t r"]:
        rows = []
        for n, data in enumerate(self.data):
            model = self.model_pixels(n, scene=scene, solution=solution, values=values)
            away = model - data
            # A pixel that the body has left is not compared.
            rows.append(away * values.views[n].seen[None] if values.views else away)
        # The squares sum to 1 for a model that is wrong by the noise everywhere.
        scale = self.noise * math.sqrt(self.pixel_count)
        return jnp.concatenate(rows, axis=1) / scale

    @override
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        return CaseError(
            times=self.times,
            percent=tuple((100 * errors).tolist()),
            kelvin=tuple(errors * self.noise),
        )

    def mask(self, view: int) -> Bool[np.ndarray, "h w"]:
        """Compared pixels of a view."""
        return _mask(self.views[view], np.asarray(self.indices[view]))

    def model_pixels(
        self,
        view: int,
        scene: Scene,
        solution: ParametricSolution,
        values: FrameValues = AS_GIVEN,
    ) -> Float[Array, "t p"]:
        """Compared pixels of a view as the model gives them."""
        frame_quantity = self.frame_quantity
        if values.reflected is not None:
            frame_quantity = frame_quantity._replace(reflected=values.reflected)
        seen = self.views[view]
        if values.views:
            assert values.poses is not None
            seen = values.views[view].at(values.poses[view], seen.camera)
        frames = frame_quantity.frames(seen, scene, solution=solution, times=self.times)
        pixels = frames.reshape(len(frames), -1)
        return pixels if values.views else pixels[:, self.indices[view]]

    def measure(
        self,
        views: tuple[View, ...],
        scene: Scene,
        solution: ParametricSolution,
        times: tuple[float, ...],
    ) -> Float[Array, "t r"]:
        """Pixels of bodies in any views [standard deviations of the noise]."""
        rows = []
        for view in views:
            frames = self.frame_quantity.frames(
                view, scene, solution=solution, times=times
            )
            # There are no data, and so no mask, of a view that is only proposed.
            rows.append(frames[:, body_mask(view)])
        return jnp.concatenate(rows, axis=1) / self.noise


def body_mask(view: View) -> Bool[np.ndarray, "h w"]:
    """Pixels that show a body, and no source of radiation before it."""
    mask = _mask(view, view.pixel)
    for source in view.background.sources:
        mask.reshape(-1)[source.pixel] = False
    return mask


def _mask(view: View, pixels: Any) -> Bool[np.ndarray, "h w"]:
    width, height = view.camera.size
    mask = np.zeros(height * width, bool)
    mask[pixels] = True
    return mask.reshape(height, width)
