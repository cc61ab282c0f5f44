"""Files of one frame, those that `image.files` names, and its picture."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image as Pictures
from PIL.Image import Image as Picture

from ..config.loader import to_yaml
from ..config.schema.scene import SceneConfig
from ..config.types.model import build
from ..image.colour.annotate import write_png
from ..image.colour.draw_measurements import draw_marks, draw_measurements, measure
from ..image.colour.frame_values import covered_fraction, shown_temperature
from ..image.colour.picture import coloured, picture
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
"""Ends of the names of files that are not those of their kind."""


class Frame(NamedTuple):
    """A frame with all that its files, pictures and measurements need."""

    config: SceneConfig
    fine: Image
    """With the samples of each pixel."""
    samples: int
    """Samples of each pixel along each axis."""
    pixels: Image
    mask: Float[np.ndarray, "h w"]
    """Fraction of each pixel that bodies cover."""
    scale: tuple[float, float]
    """Ends of the colours [K]."""
    measurements: tuple[AbstractMeasurement, ...]
    readings: dict[str, Reading]

    @classmethod
    def of(
        cls,
        config: SceneConfig,
        image: Image,
        scale: tuple[float, float],
        samples: int,
    ) -> "Frame":
        """Measure an image of so many samples along each axis of a pixel.

        Raises:
            InputError: for temperatures that are not finite.
        """
        how, measurements = config.image, build(config.image.measurements)
        pixels = coarsen(image, samples)
        mask = covered_fraction(pixels)
        readings = measure(
            pixels, measurements=measurements, quantity=how.quantity, mask=mask
        )
        seen = config, image, samples, pixels, mask
        return cls(*seen, scale, measurements, readings)

    @property
    def saturated(self) -> int:
        """Number of pixels whose temperature a centikelvin file cannot hold."""
        if "centikelvin" not in self.config.image.files:
            return 0
        kelvin = shown_temperature(self.pixels, self.config.image.quantity)
        return saturated_pixels(kelvin)

    def picture(self) -> Picture:
        """The frame in false colours with its scale, time and measurements."""
        title = self.config.name or ""
        drawn = picture(self.fine, **self._colours, title=title, gain=self._gain)
        decimals = end_decimals(*self.scale)
        return draw_measurements(drawn, *self._measured, decimals=decimals)

    def tile(self) -> UInt8[np.ndarray, "h w 3"]:
        """The frame in false colours with marks alone, for a sheet of one scale."""
        drawn = Pictures.fromarray(coloured(self.fine, **self._colours))
        draw_marks(drawn, *self._measured)
        return np.asarray(drawn)

    @property
    def _gain(self) -> Gain | None:
        """Curve of the colours of this frame; None for a linear scale."""
        how = self.config.image
        if how.gain == "linear":
            return None
        kelvin = shown_temperature(self.pixels, how.quantity)
        return plateau_gain(kelvin, self.mask >= 1, *self.scale)

    @property
    def _measured(
        self,
    ) -> tuple[Image, tuple[AbstractMeasurement, ...], str, Float[np.ndarray, "h w"]]:
        return self.pixels, self.measurements, self.config.image.quantity, self.mask

    @property
    def _colours(self) -> dict[str, Any]:
        how, (low, high) = self.config.image, self.scale
        style = {"palette": how.palette, "quantity": how.quantity}
        return {"low": low, "high": high, "samples": self.samples, **style}

    def write(self, stem: Path, drawn: Picture | None = None) -> list[Path]:
        """Write all kinds of files that the config asks for.

        Args:
            stem: path of the files, without the end of their names.
            drawn: the picture if it is drawn already.

        Returns:
            The files.
        """
        how, written = self.config.image, list[Path]()
        for kind in how.files:
            path = stem.with_name(stem.name + _ENDINGS.get(kind, f".{kind}"))
            match kind:
                case "exr":
                    header = {"config": to_yaml(self.config)}
                    write_exr(path, image=self.pixels, header=header, mask=self.mask)
                case "png":
                    write_png(path, self.picture() if drawn is None else drawn)
                case "centikelvin":
                    write_centikelvin(path, self.pixels, how.quantity, saturate=True)
                case "tiff":
                    write_tiff(path, self.pixels, how.quantity, *self.scale)
                case "csv":
                    title = self.config.name or ""
                    write_csv(
                        path, image=self.pixels, quantity=how.quantity, title=title
                    )
            written.append(path)
        return written
