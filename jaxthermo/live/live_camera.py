"""The frame of a scene's own camera, as its detector sees it, in a small size."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..arrays import precision
from ..config.camera_framing import build_recorder, camera_on
from ..config.schema.scene import SceneConfig
from ..image.colour.frame_values import QUANTITIES
from ..image.detector.effects import Blur
from ..image.radiance.draw import Moment
from ..image.radiance.effect import Effects
from ..physics.time_varying import just_before
from ..scene.scene import SolvedSurface
from .live_run import AbstractLiveRun


# Largest width and height of the frame [pixels], which leave room for a curve below.
_WIDTH = 310
_HEIGHT = 260


class LiveCamera:
    """The camera of a config on what is shown, with its band and effects.

    Raises:
        InputError: if it is inside a body or sees none.
    """

    def __init__(self, config: SceneConfig, surfaces: tuple[SolvedSurface, ...]):
        scene_camera = config.camera
        shrink = min(1.0, _WIDTH / scene_camera.width, _HEIGHT / scene_camera.height)
        width = max(1, round(shrink * scene_camera.width))
        height = max(1, round(shrink * scene_camera.height))
        full_size_camera = camera_on(scene_camera, surfaces)
        self.camera = replace(full_size_camera, width=width, height=height)
        self._quantity = config.image.quantity
        self._dtype = config.dtype
        recorder = build_recorder(self.camera, config.image)
        effects = _in_larger_pixels(recorder.effects, shrink)
        self._recorder = replace(recorder, samples=1, effects=effects)

    @property
    def quantity(self) -> str:
        """Quantity that the colours show, in words."""
        return QUANTITIES[self._quantity]

    def frame(self, run: AbstractLiveRun) -> Float[np.ndarray, "h w"]:
        """Draw the current frame [K]; NaN where it shows no body."""
        with precision(self._dtype):
            kelvin = run.temperature
            moment = Moment(
                surfaces=run.surfaces,
                terms=run.terms,
                temperature=kelvin,
                received=run.irradiance(),
                time=run.time,
                load_time=just_before(np.asarray(run.time), kelvin.dtype),
            )
            image = self._recorder.frame(moment)
        apparent = self._quantity == "apparent"
        values = image.apparent_temperature if apparent else image.temperature
        on_body = np.asarray(image.object_id) >= 0
        return np.where(on_body, np.asarray(values, float), np.nan)


def _in_larger_pixels(effects: Effects, shrink: float) -> Effects:
    """Effects of a frame of reduced width, whose spots shrink likewise."""
    if shrink == 1.0 or effects.spread == 0:
        return effects
    return effects._replace(blur=(Blur(shrink * effects.spread),))
