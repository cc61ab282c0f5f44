"""Thermal images of solutions, and of any moments of a scene, as a camera records them.

    view -> temperatures -> radiance before the lens -> optics -> lag -> noise -> counts

A `Recorder` has a camera with its band and effects, and draws moments. A detector
turns images into frames in the order of time, a `_Recording` in any order. Images are
differentiable in the temperatures of the solution.
"""

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from ..arrays import precision
from ..errors import InputError, require
from ..physics.term import AbstractTerm
from ..scene.scene import SolvedSurface
from .detector.effects import integrate_pixels
from .radiance.band import LONG_WAVE, Band
from .radiance.draw import Moment, draw
from .radiance.effect import (
    AbstractBlur,
    AbstractDetectorEffect,
    AbstractEffect,
    AbstractPathEffect,
    AbstractSurfaceEffect,
    BolometerLag,
    Effects,
)
from .radiance.image import Image, coarsen
from .surface.abstract_camera import AbstractCamera
from .surface.view import View, kept_view


if TYPE_CHECKING:
    from ..integrate.run.abstract_solution import AbstractSolution
else:
    # Checked by `_frames_of`: frames of stored runs need nothing that runs a scene.
    AbstractSolution = Any

# Time constants after which nothing is left of an earlier frame, in float64.
_MEMORY = 36.0


def render(
    solution: AbstractSolution,
    camera: AbstractCamera,
    index: int = -1,
    *,
    smooth: bool = True,
    samples: int = 1,
    occlusion: float | None = None,
    band: Band | None = LONG_WAVE,
    effects: Any = (),
) -> Image:
    """Draw the thermal image of one saved time.

    Args:
        solution: from `simulate`, `steady` or `load_run`.
        camera: position, direction and size of the image.
        index: index of the saved time.
        smooth: interpolate temperatures smoothly over the voxels.
        samples: radiance samples per pixel along each axis.
        occlusion: distance within which surfaces in the image hide the surroundings
            from what others reflect [m], for scenes whose terms do not detect it.
        band: of the detector, 7.5 to 14 um by default; None for the radiance of all
            wavelengths, in which the sun is as bright as it heats.
        effects: of surfaces, air, optics and detector, such as (Atmosphere(290.0),
            DetectorNoise(netd=0.05)).

    Raises:
        InputError: if the camera is inside a body or sees none, or for effects that are
            none.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> copper = jt.materials["copper"]
        >>> body = jt.Body(jt.FullVolume(grid), copper, temperature=350.0)
        >>> warm = jt.steady(jt.Scene((body,), (jt.Convection(10.0, 290.0),)))
        >>> camera = jt.Camera((0.2, -0.2, 0.1), (0.0, 0.0, 0.0), width=32, height=24)
        >>> jt.render(warm, camera).temperature.shape  # rows, columns
        (24, 32)
    """
    frame = _frames_of(
        solution,
        camera=camera,
        band=band,
        effects=effects,
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
    return frame(range(len(solution.times))[index])


def frames(
    solution: AbstractSolution,
    camera: AbstractCamera,
    *,
    smooth: bool = True,
    samples: int = 1,
    occlusion: float | None = None,
    band: Band | None = LONG_WAVE,
    effects: Any = (),
) -> Iterator[Image]:
    """Draw the thermal images of all saved times, one after the other.

    The arguments are those of `render`. With a `BolometerLag` each frame is drawn once,
    while `render` draws all earlier frames that matter anew.

    Raises:
        InputError: as `render`.
    """
    # A mistake raises an error at once, not with the first frame.
    frame = _frames_of(
        solution,
        camera=camera,
        band=band,
        effects=effects,
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
    return map(frame, range(len(solution.times)))


def _frames_of(
    solution: AbstractSolution,
    camera: AbstractCamera,
    band: Band | None,
    effects: Any,
    samples: int,
    smooth: bool,
    occlusion: float | None,
) -> Callable[[int], Image]:
    """Draws frames of a solution by the index of their time."""
    solutions = "a solution of simulate, steady or load_run"
    classes = importlib.import_module("jaxthermo.integrate.run.abstract_solution")
    require(
        solution,
        classes=classes.AbstractSolution,
        argument="render(solution=)",
        give=solutions,
    )
    cameras = "a Camera or an OrthographicCamera"
    require(camera, classes=AbstractCamera, argument="render(camera=)", give=cameras)
    if band is not None:
        bands = "a Band, such as Band((7.5e-6, 14e-6))"
        require(band, classes=Band, argument="render(band=)", give=bands)
    recorder = Recorder(
        camera,
        band=band,
        effects=in_order(effects, "render(effects=)"),
        samples=samples,
        smooth=smooth,
        occlusion=occlusion,
    )
    return recorded_frames(recorder, solution)


def recorded_frames(
    recorder: "Recorder", solution: AbstractSolution
) -> Callable[[int], Image]:
    """Function that draws frames of a solution by the index of their time."""
    times = np.asarray(solution.times)

    def moment(index: int) -> Moment:
        return Moment(
            surfaces=solution.surfaces,
            terms=solution.terms,
            temperature=jnp.asarray(solution.surface_temperature[index]),
            received=solution.irradiance(index),
            time=times[index],
            load_time=solution.load_time(index),
        )

    recording = recorder.recording(moment, times)

    def frame(index: int) -> Image:
        with precision(solution.dtype):
            return recording.frame(index)

    return frame


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
        self._fine_camera = self.camera
        if self.samples != 1:
            self._fine_camera = self.camera.finer(self.samples)
        self._detector = _Detector(self.effects, self.samples)

    def view(
        self,
        surfaces: tuple[SolvedSurface, ...],
        terms: tuple[AbstractTerm, ...],
        time: float = 0.0,
    ) -> View:
        """View of a scene at one time [s], with all samples of each pixel."""
        return kept_view(
            surfaces,
            terms=terms,
            camera=self._fine_camera,
            time=time,
            smooth=self.smooth,
            occlusion=self.occlusion,
        )

    def before_lens(self, moment: Moment) -> Image:
        """Image of a moment before the lens, with all samples of each pixel."""
        view = self.view(moment.surfaces, moment.terms, float(moment.time))
        return draw(view, moment, self.band, self.effects)

    def frame(self, moment: Moment) -> Image:
        """The frame of a moment, with a lag after that of the last call."""
        return self._detector.frame(self.before_lens(moment), float(moment.time))

    def recording(self, moment: Callable[[int], Moment], times: Any) -> "_Recording":
        """Frames of saved times [s], from their moments by index."""
        return _Recording(
            lambda index: self.before_lens(moment(index)),
            times=times,
            effects=self.effects,
            samples=self.samples,
        )


def in_order(effects: Any, argument: str = "effects=") -> Effects:
    """Sort effects into their order.

    Raises:
        InputError: for anything else than a tuple of effects, each kind once.
    """
    if isinstance(effects, Effects):
        return effects
    candidates = tuple(effects) if isinstance(effects, tuple | list) else (effects,)
    for effect in candidates:
        require(
            effect,
            classes=AbstractEffect,
            argument=argument,
            give="a tuple of effects, such as (Blur(0.5),)",
        )
    types = [type(effect) for effect in candidates]
    for effect_type in types:
        if types.count(effect_type) > 1:
            raise InputError(
                f"{argument}: has {effect_type.__name__} twice: give it once"
            )
    ordered = sorted(candidates, key=lambda effect: effect.rank)
    return Effects(
        surface=tuple(e for e in ordered if isinstance(e, AbstractSurfaceEffect)),
        path=tuple(e for e in ordered if isinstance(e, AbstractPathEffect)),
        blur=tuple(e for e in ordered if isinstance(e, AbstractBlur)),
        lag=tuple(e for e in ordered if isinstance(e, BolometerLag)),
        detector=tuple(e for e in ordered if isinstance(e, AbstractDetectorEffect)),
    )


class _Detector:
    """Detector behind a lens, which reads out frames in the order of their times."""

    def __init__(self, effects: Effects, samples: int):
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
        coarse = image if self._samples == 1 else coarsen(image, self._samples)
        if not self._effects.blur:
            return coarse
        blurred = integrate_pixels(image.radiance, self._samples, self._effects.spread)
        return coarse.with_radiance(blurred)

    def follow(self, pixels: Image, time: float) -> Image:
        """Pixels as the detector follows them from those of the last time.

        At a standstill, and after a jump back in time, it has settled.
        """
        for lag in self._effects.lag:
            radiance: Any = pixels.radiance
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
            pixels = pixels.with_radiance(lagged)
        return pixels

    def read_out(self, pixels: Image, time: float) -> Image:
        """Frame of a time [s] with the noise and counts of the detector."""
        for effect in self._effects.detector:
            detected = effect.apply(pixels.radiance, time, pixels.band)
            pixels = pixels.with_radiance(detected)
        return pixels


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
        pixels = self._pixels(index)
        earlier_frames = self._earlier(index) if self._effects.lag else range(0)
        # Where drawing fails, the next frame begins anew.
        self._last = None
        for earlier in earlier_frames:
            self._detector.follow(self._pixels(earlier), self._times[earlier])
        pixels = self._detector.follow(pixels, self._times[index])
        self._last = index
        return self._detector.read_out(pixels, self._times[index])

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
