"""The frame of a scene's own camera, as its detector sees it, in a small size."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import precision
from ..config.camera_framing import build_camera
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..image.detector import pixels, read_out
from ..image.draw import draw
from ..image.effects.effect import Effects, in_order
from ..image.effects.optics import Blur
from ..image.frame_values import QUANTITIES
from ..image.image import Image
from ..image.view import at_time, kept_view
from ..physics.time_varying import just_before
from ..scene.scene import SolvedSurface
from .live_run import AbstractLiveRun


# Largest width and height of the frame [pixels], which leave room for a curve below.
_WIDTH = 310
_HEIGHT = 260


class _Recorded(NamedTuple):
    """The last frame of a detector with a lag."""

    time: float
    """[s]"""
    radiance: Any
    """Radiance of the pixels [W/(m^2 sr)]."""
    lagged: Any
    """Radiance that the lagging detector reads [W/(m^2 sr)]."""


class LiveCamera:
    """The camera of a config on what is shown, with its band and effects.

    Raises:
        InputError: if it is inside a body or sees none.
    """

    def __init__(self, config: SceneConfig, surfaces: tuple[SolvedSurface, ...]):
        camera_config = config.camera
        triangles = [s.geometry.triangles for s in surfaces]
        shrink = min(1.0, _WIDTH / camera_config.width, _HEIGHT / camera_config.height)
        size = {"width": camera_config.width, "height": camera_config.height}
        smaller = {name: max(1, round(shrink * n)) for name, n in size.items()}
        camera = camera_config.model_copy(update=smaller)
        self.camera = build_camera(camera, np.concatenate(triangles))
        self._image = config.image
        self._dtype = config.dtype
        self._band = build(config.image.band)
        effects = in_order(build(config.image.effects), "image.effects")
        self._effects = _in_larger_pixels(effects, shrink)
        self._last: _Recorded | None = None

    @property
    def quantity(self) -> str:
        """Quantity that the colours show, in words."""
        return QUANTITIES[self._image.quantity]

    def frame(self, run: AbstractLiveRun) -> Float[np.ndarray, "h w"]:
        """Draw the current frame [K]; NaN where it shows no body."""
        with precision(self._dtype):
            image = self._detected(self._reaching(run), run.time)
        apparent = self._image.quantity == "apparent"
        values = image.apparent_temperature if apparent else image.temperature
        on_body = np.asarray(image.object_id) >= 0
        return np.where(on_body, np.asarray(values, float), np.nan)

    def _reaching(self, run: AbstractLiveRun) -> Image:
        """The frame as it reaches the lens."""
        surfaces, terms = at_time(run.surfaces, run.terms, run.time)
        view = kept_view(
            surfaces,
            terms=terms,
            camera=self.camera,
            smooth=self._image.smooth,
            occlusion=self._image.occlusion,
        )
        kelvin = run.temperature
        now = jnp.asarray(run.time, kelvin.dtype)
        return draw(
            view,
            surfaces=surfaces,
            terms=terms,
            temperature=kelvin,
            received=run.irradiance(),
            time=now,
            load_time=jnp.asarray(just_before(now), kelvin.dtype),
            band=self._band,
            effects=self._effects,
        )

    def _detected(self, reaching: Image, time: float) -> Image:
        """The frame behind the optics, as the detector follows it and reads it out."""
        image = pixels(reaching, self._effects, samples=1)
        radiance: Any = image.radiance
        for lag in self._effects.lag:
            lagged = radiance
            last = self._last
            # At a standstill, and after a jump back, the detector has settled.
            if last is not None and time > last.time:
                lagged = lag.after(
                    time - last.time, last.radiance, radiance, last.lagged
                )
            self._last = _Recorded(time, radiance, lagged)
            radiance = lagged
        return read_out(image.with_radiance(radiance), self._effects, time)


def _in_larger_pixels(effects: Effects, shrink: float) -> Effects:
    """Effects of a frame of reduced width, whose spots shrink likewise."""
    if shrink == 1.0 or effects.spread == 0:
        return effects
    return effects._replace(blur=(Blur(shrink * effects.spread),))
