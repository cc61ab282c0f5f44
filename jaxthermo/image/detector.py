"""Frames as a detector gives them: from what reaches the lens to pixels of a camera."""

from collections.abc import Callable
from typing import Any

from .effects.effect import Effects
from .effects.optics import integrate_pixels
from .image import Image, coarsen


# Time constants after which nothing is left of an earlier frame, in float64.
_MEMORY = 36.0


def detect(
    reaching: Callable[[int], Image],
    times: Any,
    index: int,
    effects: Effects,
    samples: int = 1,
) -> Image:
    """Frame of a saved time, as the detector gives it.

    Args:
        reaching: draws the frame of a saved time as it reaches the lens, with `samples`
            points along each axis of a pixel.
        times: saved times [s].
        index: of the frame.
        effects: of the camera.
        samples: along each axis.
    """
    image = pixels(reaching(index), effects, samples)
    radiance: Any = image.radiance
    time = float(times[index])
    for lag in effects.lag:
        first = index
        while first > 0 and time - times[first] < _MEMORY * lag.time_constant:
            first -= 1
        before = pixels(reaching(first), effects, samples).radiance
        lagged = before
        for k in range(first + 1, index + 1):
            here = image if k == index else pixels(reaching(k), effects, samples)
            interval = float(times[k]) - float(times[k - 1])
            lagged = lag.after(interval, before, here.radiance, lagged)
            before = here.radiance
        radiance = lagged
    for effect in effects.detector:
        radiance = effect.apply(radiance, time, image.band)
    return image.with_radiance(radiance)


def pixels(image: Image, effects: Effects, samples: int) -> Image:
    """Frame of pixels behind the optics, from one of samples before them."""
    coarse = coarsen(image, samples)
    if effects.spread == 0:
        return coarse
    blurred = integrate_pixels(image.radiance, samples, effects.spread)
    return coarse.with_radiance(blurred)
