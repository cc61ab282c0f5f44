"""Frames as a detector gives them: from what reaches the lens to pixels of a camera."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .effects.effect import Effects
from .effects.optics import integrate_pixels
from .image import Image, coarsen


# Time constants after which nothing is left of an earlier frame, in float64.
_MEMORY = 36.0


class _Recorded(NamedTuple):
    """The last frame of a detector with a lag."""

    index: int
    radiance: Any
    """Radiance of the pixels [W/(m^2 sr)]."""
    lagged: Any
    """Radiance that the lagging detector reads [W/(m^2 sr)]."""


class Detector:
    """Detector that reads out the frames of saved times, in any order.

    It remembers the last one, so that with a lag frames in order are drawn once each.
    """

    def __init__(
        self,
        reaching: Callable[[int], Image],
        times: Any,
        effects: Effects,
        samples: int = 1,
    ):
        """Make a detector.

        Args:
            reaching: draws the frame of a saved time as it reaches the lens, with
                `samples` points along each axis of a pixel.
            times: saved times [s].
            effects: of the camera.
            samples: along each axis.
        """
        self._reaching = reaching
        self._effects = effects
        self._samples = samples
        # By numpy: on the host, also while temperatures are traced.
        self._times = np.asarray(times).tolist()
        self._last: _Recorded | None = None

    def frame(self, index: int) -> Image:
        """The frame of a saved time."""
        image = self._pixels(index)
        radiance: Any = image.radiance
        for lag in self._effects.lag:
            state = self._start(index, radiance, lag.time_constant)
            for k in range(state.index + 1, index + 1):
                new = radiance if k == index else self._pixels(k).radiance
                interval = self._times[k] - self._times[k - 1]
                lagged = lag.after(interval, state.radiance, new, state.lagged)
                state = _Recorded(k, new, lagged)
            self._last = state
            radiance = state.lagged
        followed = image.with_radiance(radiance)
        return read_out(followed, self._effects, self._times[index])

    def _start(self, index: int, radiance: Any, time_constant: float) -> _Recorded:
        """A frame before which nothing influences the one of `index`."""
        if self._last is not None and self._last.index <= index:
            return self._last
        first = index
        now = self._times[index]
        memory = _MEMORY * time_constant
        while first > 0 and now - self._times[first] < memory:
            first -= 1
        settled = radiance if first == index else self._pixels(first).radiance
        return _Recorded(first, settled, settled)

    def _pixels(self, index: int) -> Image:
        return pixels(self._reaching(index), self._effects, self._samples)


def pixels(image: Image, effects: Effects, samples: int) -> Image:
    """Frame of pixels behind the optics, from one of samples before them."""
    coarse = coarsen(image, samples)
    if effects.spread == 0:
        return coarse
    blurred = integrate_pixels(image.radiance, samples, effects.spread)
    return coarse.with_radiance(blurred)


def read_out(image: Image, effects: Effects, time: float) -> Image:
    """Frame of a time [s] with the noise and counts of its detector."""
    radiance: Any = image.radiance
    for effect in effects.detector:
        radiance = effect.apply(radiance, time, image.band)
    return image.with_radiance(radiance)
