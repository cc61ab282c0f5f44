"""The thermal image of one time: radiance, temperatures and geometry of each pixel."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ...shown import html_of
from .band import Band, Values, apparent_temperature


class Image(eqx.Module):
    """Thermal frame; its background is the sky and the ground at infinite depth.

    A source is drawn as a black surface of its radiance.
    """

    time: Float[Array, ""]
    """Time [s]."""
    temperature: Float[Values, "h w"]
    """True surface temperature; that of sky or ground in the background [K]."""
    radiance: Float[Values, "h w"]
    """Radiance at the detector, averaged over the pixel, total or within the band
    [W/(m^2 sr)]."""
    emissivity: Float[Values, "h w"]
    """Emissivity towards the camera [-]; 1 in the background and of a source."""
    depth: Float[Values, "h w"]
    """Depth along the optical axis [m]; inf in the background."""
    object_id: Int[Values, "h w"]
    """Number of the body; -1 in the background and of a source."""
    normal: Float[Values, "h w 3"]
    """Outward normal in the world; 0 in the background and of a source."""
    part_id: Int[Values, "h w"] | None = None
    """Number of the part within its body; -1 in the background and where a body has
    none. None if no body has parts."""
    part_names: tuple[tuple[str, ...], ...] = eqx.field(static=True, default=())
    """Names of the parts of every body."""
    body_names: tuple[str, ...] = eqx.field(static=True, default=())
    """Name of every body, by its number in `object_id`; empty for one without."""
    band: Band | None = eqx.field(static=True, default=None)
    """Band of the detector; None for all wavelengths."""
    coverage: Float[Values, "h w"] | None = None
    """Fraction of each pixel that bodies cover [-]; None of one sample a pixel."""

    def _repr_html_(self) -> str:
        return html_of(self)

    @property
    def apparent_temperature(self) -> Float[Values, "h w"]:
        """Temperature that a camera set to emissivity 1 shows [K]."""
        return apparent_temperature(self.radiance, self.band)

    def with_radiance(self, radiance: Any) -> "Image":
        """The same frame with other radiances [W/(m^2 sr)]."""
        return dataclasses.replace(self, radiance=radiance)


def coarsen(image: Image, samples: int) -> Image:
    """Reduce an image by the factor `samples` along both axes."""
    # A detector integrates radiance over its pixel. The mean of depths or body numbers
    # over an edge would be meaningless: these are of one sample near the middle.
    if samples == 1:
        return image
    middle = slice(samples // 2, None, samples)
    names = ("temperature", "emissivity", "depth", "object_id", "normal", "part_id")
    sampled = {name: getattr(image, name) for name in names}
    picked = {
        name: None if values is None else values[middle, middle]
        for name, values in sampled.items()
    }
    picked["radiance"] = block_means(image.radiance, samples)
    on_body = (image.object_id >= 0).astype(image.radiance.dtype)
    picked["coverage"] = block_means(on_body, samples)
    return dataclasses.replace(image, **picked)


def block_means(values: Values, samples: int) -> Values:
    """Means over blocks of `samples` rows and columns."""
    height, width = values.shape
    rows = values.reshape(height // samples, samples, width)
    # Rows first: sums of whole rows are fast.
    summed = rows.sum(axis=1).reshape(height // samples, width // samples, samples)
    if not isinstance(summed, np.ndarray):
        return summed.mean(axis=-1) / samples
    first = summed[..., 0]
    for k in range(1, samples):
        first = first + summed[..., k]
    return (first / samples**2).astype(values.dtype, copy=False)
