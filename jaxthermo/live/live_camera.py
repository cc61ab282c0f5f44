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
from .shown import AbstractShown


# Largest width and height of the frame [pixels]: below it a curve has its place.
_WIDTH, _HEIGHT = 310, 260


class _Recorded(NamedTuple):
    """The last frame of a detector with a lag."""

    time: float
    """[s]"""
    radiance: Any
    """Radiance of the pixels [W/(m^2 sr)]."""
    lagged: Any
    """The same as the detector follows it."""


class LiveCamera:
    """The camera of a config on what is shown, with its band and effects.

    Raises:
        InputError: if it is inside a body or sees none.
    """

    def __init__(self, config: SceneConfig, surfaces: tuple[SolvedSurface, ...]):
        given, triangles = config.camera, [s.geometry.triangles for s in surfaces]
        part = min(1.0, _WIDTH / given.width, _HEIGHT / given.height)
        size = {"width": given.width, "height": given.height}
        smaller = {name: max(1, round(part * n)) for name, n in size.items()}
        camera = given.model_copy(update=smaller)
        self.camera = build_camera(camera, np.concatenate(triangles))
        self._image, self._dtype = config.image, config.dtype
        self._band = build(config.image.band)
        effects = in_order(build(config.image.effects), "image.effects")
        self._effects = _in_larger_pixels(effects, part)
        self._last: _Recorded | None = None

    @property
    def quantity(self) -> str:
        """Quantity that the colours show, in words."""
        return QUANTITIES[self._image.quantity]

    def frame(self, shown: AbstractShown) -> Float[np.ndarray, "h w"]:
        """Draw what is shown now [K]; NaN beside the bodies."""
        with precision(self._dtype):
            image = self._detected(self._reaching(shown), shown.time)
        apparent = self._image.quantity == "apparent"
        values = image.apparent_temperature if apparent else image.temperature
        on_body = np.asarray(image.object_id) >= 0
        return np.where(on_body, np.asarray(values, float), np.nan)

    def _reaching(self, shown: AbstractShown) -> Image:
        """The frame as it reaches the lens."""
        surfaces, terms = at_time(shown.surfaces, shown.terms, shown.time)
        how = self._image.smooth, self._image.occlusion
        view = kept_view(surfaces, terms, self.camera, *how)
        kelvin, received = shown.temperature, shown.irradiance()
        now = jnp.asarray(shown.time, kelvin.dtype)
        before = jnp.asarray(just_before(now), kelvin.dtype)
        saved = kelvin, received, now, before
        return draw(view, surfaces, terms, *saved, self._band, self._effects)

    def _detected(self, reaching: Image, time: float) -> Image:
        """The frame behind the optics, as the detector follows it and reads it out."""
        image = pixels(reaching, self._effects, samples=1)
        radiance: Any = image.radiance
        for lag in self._effects.lag:
            lagged, last = radiance, self._last
            # At a standstill, and after a jump back, the detector has settled.
            if last is not None and time > last.time:
                lagged = lag.after(
                    time - last.time, last.radiance, radiance, last.lagged
                )
            self._last, radiance = _Recorded(time, radiance, lagged), lagged
        return read_out(image.with_radiance(radiance), self._effects, time)


def _in_larger_pixels(effects: Effects, part: float) -> Effects:
    """Effects of a frame reduced to a part of its width, as its spots are."""
    if part == 1.0 or effects.spread == 0:
        return effects
    return effects._replace(blur=(Blur(part * effects.spread),))
