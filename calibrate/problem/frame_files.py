"""Measured frames from files: as a camera before the scene shows them, and masks.

Counts lose the air and the window that their files state. Temperatures of objects are
turned back to those that are shown for an emissivity of 1. The emissivity and the
reflection that a camera was set to are compared with those of the scene.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from jaxthermo.config.types.model import build
from jaxthermo.errors import InputError, located
from jaxthermo.image.files.exr import read_channel, read_exr
from jaxthermo.image.files.thermogram_files import (
    has_counts,
    read_counts,
    read_temperatures,
)
from jaxthermo.image.radiance.thermography import measured_radiance, object_temperature
from jaxthermo.physics.radiation.emission import Surroundings
from jaxthermo.physics.term import AbstractTerm
from jaxthermo.scene.scene import SolvedSurface
from jaxthermo.temperatures import temperature_limits

from ..config.frame_names import REFLECTED
from ..config.schema import FramesOfCase, MeasuredFrames
from .frame_data import Masks
from .frame_quantity import FrameQuantity


_CHANNELS = {
    "temperature": ("apparent_temperature_K", "apparent_temperature"),
    "radiance": ("radiance",),
}
"""Channels of an EXR file by compared quantity; the first one in the file counts."""
_SAME_EMISSIVITY = 0.005
"""Difference of emissivities that are rounded to two digits."""
_SAME_TEMPERATURE = 0.5
"""Difference of reflected temperatures that are the same [K]."""


class _StatedReflection(NamedTuple):
    """Emissivity below 1 that a camera was set to, and the reflection with it."""

    path: Path
    emissivity: float
    reflected_temperature: float
    """[K]"""


class _ReadFrames(NamedTuple):
    """Frames of the views of one case."""

    frames: list[Float[np.ndarray, "_ _ _"]]
    """Frames of each view, [time, row, column] [K or W/(m^2 sr)]."""
    masks: Masks
    stated: list[_StatedReflection]
    """Settings that the files state."""


def read_measured(
    name: str,
    settings: MeasuredFrames,
    frame_quantity: FrameQuantity,
    *,
    allow_extreme_temperatures: bool = False,
) -> _ReadFrames:
    """Read the frames and masks of a case, whose pixels are not checked.

    Args:
        name: of the case.
        settings: of the reference.
        frame_quantity: of the frames.
        allow_extreme_temperatures: accept those below 150 K and above 6000 K in
            settings of cameras, and correct such pixels.

    Raises:
        InputError: for files that cannot be read, or frames of several sizes.
    """
    views = sorted((f for f in settings.frames if f.case == name), key=lambda f: f.view)
    if not views:
        raise InputError(f"reference: frames: there are none for the case {name}")
    reader = _Reader(settings, frame_quantity, allow_extreme_temperatures)
    return _ReadFrames(
        frames=[reader.frames(view) for view in views],
        masks=[_read_mask(view.mask or settings.mask) for view in views],
        stated=reader.stated,
    )


def check_stated(
    stated: list[_StatedReflection],
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    settings: MeasuredFrames,
    fitted: tuple[str, ...],
) -> None:
    """Refuse a reflection that a camera was set to and the scene does not have.

    Args:
        stated: settings of the files.
        surfaces: of the bodies, with their emissivities.
        terms: of the scene.
        settings: of the reference, which may state the reflected temperature.
        fitted: names of the parameters.

    Raises:
        InputError: naming the file, the setting and what to give.
    """
    words = {word for name in fitted for word in name.split(".")}
    emissivities = np.concatenate(
        [np.atleast_1d(np.asarray(s.emissivity, float)) for s in surfaces]
    )
    is_known = settings.reflected_temperature is not None or REFLECTED in fitted
    around = _surroundings(terms)
    for path, emissivity, reflected in stated:
        distance = np.abs(emissivities - emissivity).min()
        if "emissivity" not in words and distance > _SAME_EMISSIVITY:
            ends = sorted({f"{emissivities.min():.3g}", f"{emissivities.max():.3g}"})
            raise InputError(
                f"{path}: the camera was set to an emissivity of {emissivity:.3g}, and "
                f"surfaces of the scene have {' to '.join(ends)}: change the material, "
                "or set `camera_settings: {emissivity: 1}` in `reference` to leave it "
                "to the scene"
            )
        is_same = any(abs(kelvin - reflected) <= _SAME_TEMPERATURE for kelvin in around)
        if not is_known and not is_same:
            scene_text = " to ".join(f"{kelvin:.6g} K" for kelvin in around)
            raise InputError(
                f"{path}: the camera was set to a reflected temperature of "
                f"{reflected:.6g} K, and surfaces of the scene reflect "
                f"{scene_text or 'what its terms send'}: give the right one as "
                "`reflected_temperature` in `reference`, or `camera_settings: "
                "{emissivity: 1}` to leave it to the scene"
            )


def _surroundings(terms: tuple[AbstractTerm, ...]) -> list[float]:
    """Temperatures of black surroundings that are one number each [K]."""
    around = [term for term in terms if isinstance(term, Surroundings)]
    values = [term.temperature for term in around if term.ground is None]
    return [float(value) for value in values if isinstance(value, int | float)]


class _Reader:
    """Reads the frames of one reference, and collects what their files state."""

    def __init__(
        self,
        settings: MeasuredFrames,
        frame_quantity: FrameQuantity,
        allow_extreme_temperatures: bool,
    ):
        self._settings = settings
        self._frame_quantity = frame_quantity
        self._allow_extreme_temperatures = allow_extreme_temperatures
        self.stated: list[_StatedReflection] = []

    def frames(self, view: FramesOfCase) -> Float[np.ndarray, "t h w"]:
        frames = [frame for path in view.files for frame in self._frames_in(path)]
        # Frames of one view are stacked, and compared with one camera.
        if len({frame.shape for frame in frames}) > 1:
            raise InputError(f"{view.case}, view {view.view}: frames of several sizes")
        return np.stack(frames).astype(float)

    def _frames_in(self, path: Path) -> list[Float[np.ndarray, "_ _"]]:
        settings = self._settings
        channels = _CHANNELS[settings.quantity]
        if settings.quantity == "radiance":
            if path.suffix.lower() != ".exr":
                raise InputError(f"{path}: radiance is read from EXR files alone")
            return [read_channel(path, *channels)]
        unit = settings.linear_unit
        if unit is None or has_counts(path, unit):
            return self._from_counts(path)
        if settings.camera_settings is not None:
            raise InputError(
                f"{path}: holds temperatures, and `camera_settings` are for counts: "
                "leave them out, or give `corrected_for`"
            )
        frames = read_temperatures(path, unit, channels)
        return [self._uncorrected(kelvin) for kelvin in frames]

    def _from_counts(self, path: Path) -> list[Float[np.ndarray, "_ _"]]:
        """Temperatures for emissivity 1, behind the air and window of the camera."""
        settings = self._settings
        if settings.corrected_for is not None:
            raise InputError(
                f"{path}: holds counts, which are never corrected: leave out "
                "`corrected_for`, or give the temperatures that were exported"
            )
        changes = {}
        if settings.camera_settings is not None:
            changes = settings.camera_settings.model_dump(exclude_none=True)
        thermograms = [
            thermogram._replace(**changes)
            for thermogram in read_counts(path, build(settings.flir))
        ]
        self.stated += [
            _StatedReflection(
                path=path,
                emissivity=thermogram.emissivity,
                reflected_temperature=thermogram.reflected_temperature,
            )
            for thermogram in thermograms
            if thermogram.emissivity < 1
        ]
        with located(str(path)):
            return [
                thermogram.object_temperature(
                    emissivity=1.0,
                    allow_extreme_temperatures=self._allow_extreme_temperatures,
                )
                for thermogram in thermograms
            ]

    def _uncorrected(
        self, kelvin: Float[np.ndarray, "h w"]
    ) -> Float[np.ndarray, "h w"]:
        """Temperatures as shown for an emissivity of 1, of those of objects."""
        correction = self._settings.corrected_for
        if correction is None:
            return kelvin
        band = self._frame_quantity.band
        # Others stay as they are, to be refused where they are compared.
        limits = temperature_limits(self._allow_extreme_temperatures)
        valid = (kelvin > 0) & np.isfinite(kelvin) & ~limits.exceeded(kelvin)
        radiance = measured_radiance(
            kelvin[valid],
            correction.emissivity,
            correction.reflected_temperature,
            band=band,
            allow_extreme_temperatures=True,
        )
        apparent_temperature = kelvin.copy()
        if valid.any():
            apparent_temperature[valid] = object_temperature(radiance, band=band)
        return apparent_temperature


def _read_mask(path: Path | None) -> Bool[np.ndarray, "_ _"] | None:
    if path is None:
        return None
    match path.suffix.lower():
        case ".exr":
            channels, _ = read_exr(path)
            values: Any = np.stack([*channels.values()])
            return (np.isfinite(values) & (values != 0)).all(axis=0)
        case ".npy":
            return _read_array_mask(path)
    try:
        with Image.open(path) as picture:
            # Every pixel that is not black is compared.
            return np.asarray(picture.convert("L")) > 0
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: no mask: give a PNG, NPY or EXR file") from error


def _read_array_mask(path: Path) -> Bool[np.ndarray, "_ _"]:
    try:
        values = np.load(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: is no array that `numpy.save` wrote") from error
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        raise InputError(f"{path}: a mask has rows and columns of numbers")
    return np.isfinite(values) & (values != 0)
