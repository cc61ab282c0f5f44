"""Frames that a camera records of a scene: from radiance at the lens to pixels.

    moment of a scene -> image before the lens -> optics -> lag -> noise -> counts

A `Recorder` has a camera with its band and effects, and draws moments. A detector
turns images into frames in the order of time, a `_Recording` in any order.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...physics.radiation.irradiation import Irradiance
from ...physics.term import AbstractTerm
from ...scene.scene import SolvedSurface
from ..radiance.band import Band
from ..radiance.draw import draw
from ..radiance.effect import Effects
from ..radiance.image import Image, coarsen
from ..radiance.radiometry import Values
from ..surface.camera import AbstractCamera
from ..surface.view import View, at_time, kept_view
from .effects import integrate_pixels


# Time constants after which nothing is left of an earlier frame, in float64.
_MEMORY = 36.0


class Moment(NamedTuple):
    """State of a scene at one time, as far as a camera sees it."""

    surfaces: tuple[SolvedSurface, ...]
    """Surfaces of the bodies, with their motion."""
    terms: tuple[AbstractTerm, ...]
    """Terms of the scene, for sky, ground and sources."""
    temperature: Values
    """Temperature of every fragment [K]."""
    received: Irradiance
    """Radiation that reaches every fragment [W/m^2]."""
    time: Any
    """Time of the frame [s]."""
    load_time: Any
    """Time of the values of sky, ground and sources [s]."""


class _Detector:
    """Detector behind a lens, which reads out frames in the order of their times."""

    def __init__(self, effects: Effects, samples: int = 1):
        """Make a detector; images have `samples` points along each axis of a pixel."""
        self._effects = effects
        self._samples = samples
        self._time: float | None = None
        self._radiance: Any = None
        self._lagged: Any = None

    def frame(self, image: Image, time: float) -> Image:
        """The frame of a time [s], from the image before the lens."""
        return self.read_out(self.follow(self.pixels(image), time), time)

    def pixels(self, image: Image) -> Image:
        """Pixels behind the optics."""
        coarse = coarsen(image, self._samples)
        if self._effects.spread == 0:
            return coarse
        blurred = integrate_pixels(image.radiance, self._samples, self._effects.spread)
        return coarse.with_radiance(blurred)

    def follow(self, pixels: Image, time: float) -> Image:
        """Pixels as the detector follows them from those of the last time.

        At a standstill, and after a jump back in time, it has settled.
        """
        radiance: Any = pixels.radiance
        for lag in self._effects.lag:
            lagged = radiance
            if self._time is not None and time > self._time:
                lagged = lag.after(
                    time - self._time,
                    start=self._radiance,
                    end=radiance,
                    lagged=self._lagged,
                )
            self._time = time
            self._radiance = radiance
            self._lagged = lagged
        return self.lagging(pixels)

    def lagging(self, pixels: Image) -> Image:
        """Pixels with the radiance at which the detector is."""
        return pixels.with_radiance(self._lagged) if self._effects.lag else pixels

    def read_out(self, pixels: Image, time: float) -> Image:
        """Frame of a time [s] with the noise and counts of the detector."""
        radiance: Any = pixels.radiance
        for effect in self._effects.detector:
            radiance = effect.apply(radiance, time, pixels.band)
        return pixels.with_radiance(radiance)


class _Recording:
    """Frames of saved times, in any order.

    With a lag a frame depends on earlier ones: frames in order are drawn once each.
    """

    def __init__(
        self,
        before_lens: Callable[[int], Image],
        times: Any,
        effects: Effects,
        samples: int = 1,
    ):
        """Make a recording.

        Args:
            before_lens: draws the image of a saved time before the lens, with `samples`
                points along each axis of a pixel.
            times: saved times [s].
            effects: of the camera.
            samples: along each axis.
        """
        self._before_lens = before_lens
        self._effects = effects
        # By numpy: on the host, also while temperatures are traced.
        self._times: list[float] = np.asarray(times).tolist()
        self._detector = _Detector(effects, samples)
        self._samples = samples
        self._last: int | None = None

    def frame(self, index: int) -> Image:
        """The frame of a saved time."""
        time = self._times[index]
        pixels = self._pixels(index)
        if not self._effects.lag:
            return self._detector.read_out(pixels, time)
        if self._last != index:
            earlier_frames = self._earlier(index)
            # Where drawing fails, the next frame begins anew.
            self._last = None
            for earlier in earlier_frames:
                self._detector.follow(self._pixels(earlier), self._times[earlier])
            self._detector.follow(pixels, time)
            self._last = index
        return self._detector.read_out(self._detector.lagging(pixels), time)

    def _pixels(self, index: int) -> Image:
        return self._detector.pixels(self._before_lens(index))

    def _earlier(self, index: int) -> range:
        """Frames that the detector has to follow before the one of `index`."""
        if self._last is not None and self._last < index:
            return range(self._last + 1, index)
        self._detector = _Detector(self._effects, self._samples)
        memory = _MEMORY * max(lag.time_constant for lag in self._effects.lag)
        first = index
        while first > 0 and self._times[index] - self._times[first] < memory:
            first -= 1
        return range(first, index)


@dataclass
class Recorder:
    """Camera with its band and effects, which draws frames; fields as of `render`."""

    camera: AbstractCamera
    band: Band | None
    effects: Effects
    samples: int = 1
    smooth: bool = True
    occlusion: float | None = None

    def __post_init__(self) -> None:
        self._fine_camera = self.camera.finer(self.samples)
        self._detector = _Detector(self.effects, self.samples)

    def view(
        self,
        surfaces: tuple[SolvedSurface, ...],
        terms: tuple[AbstractTerm, ...],
    ) -> View:
        """View of a scene at one time, with all samples of each pixel."""
        return kept_view(
            surfaces,
            terms=terms,
            camera=self._fine_camera,
            smooth=self.smooth,
            occlusion=self.occlusion,
        )

    def before_lens(self, moment: Moment) -> Image:
        """Image of a moment before the lens, with all samples of each pixel."""
        surfaces, terms = at_time(moment.surfaces, moment.terms, float(moment.time))
        dtype = moment.temperature.dtype
        return draw(
            self.view(surfaces, terms),
            surfaces=surfaces,
            terms=terms,
            temperature=moment.temperature,
            received=moment.received,
            time=jnp.asarray(moment.time, dtype),
            load_time=jnp.asarray(moment.load_time, dtype),
            band=self.band,
            effects=self.effects,
        )

    def frame(self, moment: Moment) -> Image:
        """The frame of a moment, with a lag after that of the last call."""
        return self._detector.frame(self.before_lens(moment), float(moment.time))

    def recording(self, moment: Callable[[int], Moment], times: Any) -> _Recording:
        """Frames of saved times [s], from their moments by index."""
        return _Recording(
            lambda index: self.before_lens(moment(index)),
            times=times,
            effects=self.effects,
            samples=self.samples,
        )
