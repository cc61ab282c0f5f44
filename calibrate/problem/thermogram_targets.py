"""Frames of a thermal camera as data: pixels against pixels, with their noise."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxthermo.errors import InputError
from jaxthermo.image.camera import AbstractCamera
from jaxthermo.image.render import draw
from jaxthermo.image.view import View, look
from jaxthermo.integrate.run.parametric_run import Answer
from jaxthermo.scene.scene import Scene
from jaxthermo.scene.solved_surface import SolvedSurface

from .targets import AbstractTarget


class FrameTarget(AbstractTarget):
    """Pixels of several views at every saved time.

    r = (model - data) / noise / sqrt(pixels of all views and times)
    """

    times: tuple[float, ...] = eqx.field(static=True)
    views: tuple[View, ...] = eqx.field(static=True)
    data: tuple[Float[Array, "_ _"], ...]
    """Of the pixels of each view that count [K or W/(m^2 sr)]."""
    chosen: tuple[Int[Array, " _"], ...]
    """Those pixels, by number."""
    noise: float = eqx.field(static=True)
    quantity: str = eqx.field(static=True)
    """"temperature", which a camera shows for an emissivity of 1, or "radiance"."""

    @property
    def pixels(self) -> int:
        """Of all views at all times."""
        return sum(len(numbers) for numbers in self.chosen) * len(self.times)

    @property
    def known_sd(self) -> float | None:
        """Of one pixel's misfit."""
        return 1 / math.sqrt(self.pixels)

    @property
    def moments(self) -> tuple[float, ...]:
        """As the frames are."""
        return self.times

    def misfit(self, scene: Scene, answer: Answer) -> Float[Array, "t r"]:
        """Of every pixel that counts."""
        parts = [
            (self.pixels_of(n, scene, answer) - self.data[n])
            for n in range(len(self.views))
        ]
        scale = self.noise * math.sqrt(self.pixels)
        return jnp.concatenate(parts, axis=1) / scale

    def counts(self, view: int) -> Bool[np.ndarray, "h w"]:
        """Which pixels of a view count.

        Args:
            view: its number.
        """
        width, height = self.views[view].camera.size
        found = np.zeros(height * width, bool)
        found[np.asarray(self.chosen[view])] = True
        return found.reshape(height, width)

    def pixels_of(self, view: int, scene: Scene, answer: Answer) -> Float[Array, "t p"]:
        """What the model shows of a view.

        Args:
            view: its number.
            scene: that was run.
            answer: of the run.
        """
        found = frames_of(self.views[view], scene, answer, self.times, self.quantity)
        return found.reshape(len(found), -1)[:, self.chosen[view]]


def seen_in(
    views: tuple[View, ...],
    target: FrameTarget,
    scene: Scene,
    answer: Answer,
    times: tuple[float, ...],
) -> Float[Array, "t r"]:
    """Pixels of bodies in some views, in a target's quantity and noise.

    Args:
        views: of the bodies.
        target: whose camera it is.
        scene: that was run.
        answer: of the run.
        times: that were saved [s].
    """
    rows = []
    for view in views:
        found = frames_of(view, scene, answer, times, target.quantity)
        chosen = np.flatnonzero(shown_bodies(view))
        rows.append(found.reshape(len(found), -1)[:, chosen])
    return jnp.concatenate(rows, axis=1) / target.noise


def frames_of(
    view: View,
    scene: Scene,
    answer: Answer,
    times: tuple[float, ...],
    quantity: str,
) -> Float[Array, "t h w"]:
    """Whole frames of a run.

    Args:
        view: of its bodies.
        scene: that was run.
        answer: of the run.
        times: that were saved [s].
        quantity: "temperature" or "radiance".
    """

    def one(surface: Float[Array, " s"], time: Float[Array, ""]) -> Any:
        image = draw(view, answer.surfaces, scene.terms, surface, time)
        shown = quantity == "temperature"
        return image.apparent_temperature if shown else image.radiance

    at = jnp.asarray(times, answer.surface.dtype)
    return jax.vmap(one)(answer.surface, at)


def see(
    surfaces: tuple[SolvedSurface, ...], scene: Scene, camera: AbstractCamera
) -> View:
    """What a camera sees of bodies; temperatures are smoothed over the voxels.

    Args:
        surfaces: of the bodies.
        scene: that they are of.
        camera: where from.
    """
    return look(surfaces, scene.terms, camera, True)


def shown_bodies(view: View) -> Bool[np.ndarray, "h w"]:
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
    masks: list[Bool[np.ndarray, "_ _"]],
    dtype: Any,
) -> FrameTarget:
    """Data for a fit.

    Args:
        times: of the frames [s].
        views: of the model.
        frames: of every view.
        noise: standard deviation of a pixel.
        quantity: that the frames show.
        masks: pixels of every view that may count; those without a body do not.
        dtype: of the fitted scene.

    Raises:
        InputError: for frames of another size or number, not finite ones, or if no
            pixel counts.
    """
    data, chosen = [], []
    for n, (view, given, mask) in enumerate(zip(views, frames, masks, strict=True)):
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
        counts = mask & shown_bodies(view)
        if not counts.any():
            raise InputError(f"view {n}: no pixel of a body counts: look at the mask")
        bad = ~np.isfinite(given[:, counts])
        if bad.any():
            raise InputError(
                f"view {n}: {int(bad.sum())} pixels that count are not finite: mask "
                "them, or repair the frames"
            )
        data.append(jnp.asarray(given[:, counts], dtype))
        chosen.append(jnp.asarray(np.flatnonzero(counts), jnp.int32))
    return FrameTarget(times, views, tuple(data), tuple(chosen), noise, quantity)
