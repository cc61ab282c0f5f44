"""Thermograms as data: pixels of a thermal camera, with their noise."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from jaxthermo.errors import InputError
from jaxthermo.image.camera import AbstractCamera
from jaxthermo.image.render import draw
from jaxthermo.image.view import View, compute_view
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.scene.scene import Scene, SolvedSurface

from .targets import AbstractTarget, CaseError


class FrameTarget(AbstractTarget):
    """Pixels of several views at every saved time.

    r = (model - data) / noise / sqrt(pixels of all views and times)
    """

    times: tuple[float, ...] = eqx.field(static=True)
    views: tuple[View, ...] = eqx.field(static=True)
    data: tuple[Float[Array, "_ _"], ...]
    """Compared pixels of each view, one row per saved time [K or W/(m^2 sr)]."""
    chosen: tuple[Int[Array, " _"], ...]
    """Indices of the compared pixels of each view."""
    noise: float = eqx.field(static=True)
    """Standard deviation of a pixel [K or W/(m^2 sr)]."""
    quantity: str = eqx.field(static=True)
    """"temperature" as shown for an emissivity of 1, or "radiance"."""

    @property
    def pixel_count(self) -> int:
        """Number of compared pixels of all views at all times."""
        return sum(len(indices) for indices in self.chosen) * len(self.times)

    @property
    @override
    def known_sd(self) -> float | None:
        return 1 / math.sqrt(self.pixel_count)

    @override
    def residual(
        self, scene: Scene, solution: ParametricSolution
    ) -> Float[Array, "t r"]:
        parts = [
            self.model_pixels(n, scene, solution) - self.data[n]
            for n in range(len(self.views))
        ]
        # The squares sum to 1 for a model that is wrong by the noise everywhere.
        scale = self.noise * math.sqrt(self.pixel_count)
        return jnp.concatenate(parts, axis=1) / scale

    @override
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        percent, kelvin = 100 * errors, errors * self.noise
        return CaseError(self.times, tuple(percent.tolist()), tuple(kelvin))

    def mask(self, view: int) -> Bool[np.ndarray, "h w"]:
        """Compared pixels of a view."""
        width, height = self.views[view].camera.size
        found = np.zeros(height * width, bool)
        found[np.asarray(self.chosen[view])] = True
        return found.reshape(height, width)

    def model_pixels(
        self, view: int, scene: Scene, solution: ParametricSolution
    ) -> Float[Array, "t p"]:
        """Compared pixels of a view as the model gives them."""
        frames = render_frames(
            self.views[view], scene, solution, self.times, self.quantity
        )
        return frames.reshape(len(frames), -1)[:, self.chosen[view]]

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
            frames = render_frames(view, scene, solution, times, self.quantity)
            # There are no data, and so no mask, of a view that is only proposed.
            chosen = np.flatnonzero(body_mask(view))
            rows.append(frames.reshape(len(frames), -1)[:, chosen])
        return jnp.concatenate(rows, axis=1) / self.noise


def render_frames(
    view: View,
    scene: Scene,
    solution: ParametricSolution,
    times: tuple[float, ...],
    quantity: str,
) -> Float[Array, "t h w"]:
    """Whole frames of a run, as "temperature" [K] or "radiance" [W/(m^2 sr)]."""

    def frame(surface: Float[Array, " s"], time: Float[Array, ""]) -> Any:
        image = draw(view, solution.surfaces, scene.terms, surface, time)
        is_temperature = quantity == "temperature"
        return image.apparent_temperature if is_temperature else image.radiance

    return jax.vmap(frame)(
        solution.surface_temperature,
        jnp.asarray(times, solution.surface_temperature.dtype),
    )


def view_of(
    surfaces: tuple[SolvedSurface, ...], scene: Scene, camera: AbstractCamera
) -> View:
    """View of the bodies; temperatures are smoothed over the voxels."""
    return compute_view(surfaces, scene.terms, camera, True)


def body_mask(view: View) -> Bool[np.ndarray, "h w"]:
    """Pixels that show a body."""
    width, height = view.camera.size
    shown = np.zeros(height * width, bool)
    shown[view.pixel] = True
    return shown.reshape(height, width)


def frame_target(
    times: tuple[float, ...],
    views: tuple[View, ...],
    frames: list[Float[np.ndarray, "_ _ _"]],
    noise: float,
    quantity: str,
    mask: Bool[np.ndarray, "_ _"] | None,
    dtype: Any,
) -> FrameTarget:
    """Make a target of frames.

    Args:
        times: of the frames [s].
        views: of the model.
        frames: of every view, [time, row, column].
        noise: standard deviation of a pixel.
        quantity: "temperature" or "radiance".
        mask: pixels to compare, of all views; those without a body are left out.
        dtype: of the fitted scene.

    Raises:
        InputError: for frames of another size or number, pixels that are not finite,
            or a mask that leaves none.
    """
    data, chosen = [], []
    for n, (view, given) in enumerate(zip(views, frames, strict=True)):
        width, height = view.camera.size
        if given.shape[0] != len(times):
            raise InputError(
                f"view {n}: {given.shape[0]} frames for {len(times)} saved times"
            )
        if given.shape[1:] != (height, width):
            raise InputError(
                f"view {n}: frames of {given.shape[2]} x {given.shape[1]} pixels and a "
                f"camera of {width} x {height}: give the camera the frames' size"
            )
        if mask is not None and mask.shape != (height, width):
            raise InputError(
                f"the mask is {mask.shape[1]} x {mask.shape[0]} pixels and the frames "
                f"{width} x {height}"
            )
        # The background depends on no parameter.
        compared = body_mask(view) if mask is None else mask & body_mask(view)
        if not compared.any():
            raise InputError(
                f"view {n}: no pixel of a body is compared: check the mask"
            )
        bad = ~np.isfinite(given[:, compared])
        if bad.any():
            raise InputError(
                f"view {n}: {int(bad.sum())} compared pixels are not finite: mask "
                "them, or repair the frames"
            )
        data.append(jnp.asarray(given[:, compared], dtype))
        chosen.append(jnp.asarray(np.flatnonzero(compared), jnp.int32))
    return FrameTarget(times, views, tuple(data), tuple(chosen), noise, quantity)
