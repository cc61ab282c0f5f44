"""The picture of a frame, and the files that `image.files` names."""

from datetime import datetime
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np
from PIL import Image as Pictures
from PIL.Image import Image as Picture

from ..choices import Palette, Quantity
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..image.colour.annotate import write_png
from ..image.colour.draw_measurements import draw_marks, draw_measurements, measure
from ..image.colour.frame_values import covered_fraction, shown_temperature
from ..image.colour.picture import ColouredFrame, coloured, picture
from ..image.colour.ticks import end_decimals
from ..image.detector.gain import Gain, plateau_gain
from ..image.files.exr import write_exr
from ..image.files.raster_files import (
    saturated_pixels,
    write_centikelvin,
    write_csv,
    write_tiff,
)
from ..image.measurements import AbstractMeasurement, Reading
from ..image.radiance.image import Image, coarsen


_ENDINGS = {"centikelvin": "_centikelvin.png"}
"""Endings of file names that differ from the name of their kind."""


def start_of(config: SceneConfig) -> datetime | None:
    """Date and time at 0 s of a scene outdoors; None for any other."""
    return None if config.outdoors is None else config.outdoors.moment


class _Colours(TypedDict):
    """Colours of a frame, as `picture` and `coloured` take them."""

    low: float
    high: float
    samples: int
    palette: Palette
    quantity: Quantity


class Frame(NamedTuple):
    """A frame with everything that its files, pictures and measurements need."""

    config: SceneConfig
    config_text: str
    """The config as YAML, for the header of EXR files."""
    fine: Image
    """Image with all samples of each pixel."""
    samples: int
    """Samples of each pixel along each axis."""
    pixels: Image
    scale: tuple[float, float]
    """Ends of the colours [K]."""
    measurements: tuple[AbstractMeasurement, ...]
    readings: dict[str, Reading]

    @classmethod
    def of(
        cls,
        config: SceneConfig,
        config_text: str,
        image: Image,
        scale: tuple[float, float],
        samples: int,
    ) -> "Frame":
        """Measure an image with `samples` samples along each axis of a pixel.

        Raises:
            InputError: for temperatures that are not finite.
        """
        measurements = build(config.image.measurements)
        pixels = coarsen(image, samples)
        readings = measure(pixels, measurements, config.image.quantity)
        return cls(
            config=config,
            config_text=config_text,
            fine=image,
            samples=samples,
            pixels=pixels,
            scale=scale,
            measurements=measurements,
            readings=readings,
        )

    @property
    def saturated(self) -> int:
        """Number of pixels whose temperature a centikelvin file cannot hold."""
        if "centikelvin" not in self.config.image.files:
            return 0
        kelvin = shown_temperature(self.pixels, self.config.image.quantity)
        return saturated_pixels(kelvin)

    @property
    def _colours(self) -> _Colours:
        settings = self.config.image
        low, high = self.scale
        return _Colours(
            low=low,
            high=high,
            samples=self.samples,
            palette=settings.palette,
            quantity=settings.quantity,
        )

    def picture(self) -> Picture:
        """The frame in false colours with its scale, time and measurements."""
        settings = self.config.image
        drawn = picture(
            self.fine,
            **self._colours,
            title=self.config.name or "",
            gain=self._gain,
            start=start_of(self.config),
        )
        return draw_measurements(
            drawn,
            self.pixels,
            measurements=self.measurements,
            quantity=settings.quantity,
            decimals=end_decimals(*self.scale),
        )

    def tile(self) -> ColouredFrame:
        """The frame in false colours with marks alone, for a sheet of one scale."""
        frame = coloured(self.fine, **self._colours)
        drawn = Pictures.fromarray(frame.colours)
        draw_marks(
            drawn,
            self.pixels,
            measurements=self.measurements,
            quantity=self.config.image.quantity,
        )
        return frame._replace(colours=np.asarray(drawn))

    @property
    def _gain(self) -> Gain | None:
        """Curve of the colours of this frame; None for a linear scale."""
        settings = self.config.image
        if settings.gain == "linear":
            return None
        kelvin = shown_temperature(self.pixels, settings.quantity)
        filled = covered_fraction(self.pixels) >= 1
        return plateau_gain(kelvin, filled, *self.scale)

    def write(self, stem: Path, drawn: Picture | None = None) -> list[Path]:
        """Write the files that the config names.

        Args:
            stem: path of the files, without the ending of their names.
            drawn: the picture if it has been drawn already.

        Returns:
            The files.
        """
        settings = self.config.image
        written: list[Path] = []
        for file_kind in settings.files:
            ending = _ENDINGS.get(file_kind, f".{file_kind}")
            path = stem.with_name(stem.name + ending)
            match file_kind:
                case "exr":
                    write_exr(path, self.pixels, {"config": self.config_text})
                case "png":
                    write_png(path, self.picture() if drawn is None else drawn)
                case "centikelvin":
                    write_centikelvin(
                        path, self.pixels, settings.quantity, saturate=True
                    )
                case "tiff":
                    low, high = self.scale
                    write_tiff(
                        path,
                        self.pixels,
                        quantity=settings.quantity,
                        low=low,
                        high=high,
                    )
                case "csv":
                    title = self.config.name or ""
                    write_csv(
                        path, image=self.pixels, quantity=settings.quantity, title=title
                    )
            written.append(path)
        return written
