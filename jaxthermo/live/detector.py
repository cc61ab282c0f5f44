"""The frame of a scene's own camera, as its detector sees it, in a small size."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..arrays import precision
from ..config.camera_framing import build_camera
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..image.render import draw
from ..image.view import at_time, kept_view
from ..integrate.stepper import just_before
from ..scene.scene import SolvedSurface
from .shown import AbstractShown


# Longest edge of the frame [pixels].
_LONGEST = 330


class Detector:
    """The camera of a config on what is shown.

    Raises:
        InputError: if it is inside a body or sees none.
    """

    def __init__(self, config: SceneConfig, surfaces: tuple[SolvedSurface, ...]):
        given, triangles = config.camera, [s.geometry.triangles for s in surfaces]
        part = min(1.0, _LONGEST / max(given.width, given.height))
        size = {"width": given.width, "height": given.height}
        smaller = {name: max(1, round(part * n)) for name, n in size.items()}
        camera = given.model_copy(update=smaller)
        self.camera = build_camera(camera, np.concatenate(triangles))
        self._image, self._dtype = config.image, config.dtype
        self._band = build(config.image.band)

    @property
    def quantity(self) -> str:
        """Quantity that the colours show, in words."""
        apparent = self._image.quantity == "apparent"
        return "apparent temperature" if apparent else "surface temperature"

    def frame(self, shown: AbstractShown) -> Float[np.ndarray, "h w"]:
        """Draw what is shown now [K]; NaN beside the bodies."""
        with precision(self._dtype):
            surfaces, terms = at_time(shown.surfaces, shown.terms, shown.time)
            how = self._image.smooth, self._image.occlusion
            view = kept_view(surfaces, terms, self.camera, *how)
            kelvin, received = shown.temperature, shown.irradiance()
            now = jnp.asarray(shown.time, kelvin.dtype)
            image = draw(
                *(view, surfaces, terms, kelvin, received, now),
                jnp.asarray(just_before(now), kelvin.dtype),
                self._band,
            )
        apparent = self._image.quantity == "apparent"
        values = image.apparent_temperature if apparent else image.temperature
        on_body = np.asarray(image.object_id) >= 0
        return np.where(on_body, np.asarray(values, float), np.nan)
