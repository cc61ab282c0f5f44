"""Kinds of effects between a surface and the signal of a camera, in their order.

    surface -> path -> optics -> bolometer -> noise -> counts

An image is made with a tuple of effects; what is not in it costs nothing.
"""

import abc
import math
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Float

from ...arrays import is_traced, static_numbers
from ...errors import InputError
from ..surface.view import View
from .band import Band, Values


class AbstractEffect(Module):
    """An effect on the radiance that a camera measures."""

    rank: ClassVar[int]
    """Effects of lower rank act first, whatever their order in the tuple."""


def check_range(
    effect: AbstractEffect, name: str, low: int, high: int, unit: str = ""
) -> None:
    """Refuse a number of an effect beyond its range; None and traced ones pass.

    Raises:
        InputError: for less than `low` or more than `high`.
    """
    value = getattr(effect, name)
    if value is None or is_traced(value):
        return
    try:
        numbers = np.asarray(value, float)
    except (TypeError, ValueError):
        numbers = np.full((), np.nan)
    if not ((numbers >= low) & (numbers <= high)).all():
        raise InputError(
            f"{type(effect).__name__}({name}={value!r}): give {low} to {high}{unit}"
        )


class _AbstractViewEffect(AbstractEffect):
    """An effect at the surface points of a view."""

    @abc.abstractmethod
    def prepared(self, view: View, xp: Any) -> Any:
        """Arrays of a view that hold for all its frames, of numpy or JAX (`xp`)."""


class Horizon(NamedTuple):
    """Black radiances of sky and ground [W/(m^2 sr)]."""

    sky: Any
    ground: Any


class PixelRadiation(NamedTuple):
    """Radiation at the surface points of p pixels, with q sources."""

    black: Float[Values, " p"]
    """Radiance of a black surface of their temperature [W/(m^2 sr)]."""
    emissivity: Float[Values, " p"]
    """Emissivity towards the camera [-]."""
    absorptivity: Float[Values, " p"]
    """Absorptivity of radiation of sources, as seen from the camera [-]."""
    thermal: Float[Values, " p"]
    """Thermal irradiance H [W/m^2]."""
    sources: Float[Values, "q p"]
    """Irradiance E of sources [W/m^2]."""
    diffuse: float = 1.0
    """Fraction of the reflected radiation that leaves in all directions alike [-]."""
    mirrored: Any = 0.0
    """Radiance by reflection around the mirror direction [W/(m^2 sr)]."""

    @property
    def radiance(self) -> Float[Values, " p"]:
        """Radiance towards the camera [W/(m^2 sr)]."""
        reflected = (1 - self.emissivity) * self.thermal
        reflected = reflected + (1 - self.absorptivity) * self.sources.sum(0)
        return (
            self.emissivity * self.black
            + reflected * (self.diffuse / math.pi)
            + self.mirrored
        )


class AbstractSurfaceEffect(_AbstractViewEffect):
    """An effect on the radiation that leaves a surface towards the camera."""

    @abc.abstractmethod
    def apply(
        self, radiation: PixelRadiation, prepared: Any, horizon: Horizon
    ) -> PixelRadiation:
        """The radiation with this effect."""


class AbstractPathEffect(_AbstractViewEffect):
    """An effect of what lies between the surface and the camera."""

    @abc.abstractmethod
    def apply(
        self, radiance: Float[Values, " p"], prepared: Any, band: Band | None
    ) -> Float[Values, " p"]:
        """Radiance at the camera [W/(m^2 sr)]."""


class AbstractBlur(AbstractEffect):
    """An effect of the optics: a point becomes a Gaussian spot."""

    rank = 20

    @property
    @abc.abstractmethod
    def spread(self) -> float:
        """Standard deviation of the spot [pixels]."""


class BolometerLag(AbstractEffect):
    """Lag of a bolometer, which follows the radiance L with a time constant.

        tau dy/dt = L - y,

    with L linear between saved times and y = L at the first of them: frames of motion
    are smeared where they are saved as often as a camera reads out.
    """

    rank = 30

    time_constant: float = static_numbers(0.01)
    """tau [s], 7 to 15 ms of uncooled cameras."""

    def __check_init__(self):
        if not 0 < self.time_constant <= 1e6:
            raise InputError(
                f"BolometerLag(time_constant={self.time_constant!r}): give seconds, "
                "more than 0"
            )

    def after(self, interval: float, start: Any, end: Any, lagged: Any) -> Any:
        """Lagged radiance at the end of an interval [s] from `start` to `end`."""
        slope = (end - start) * (self.time_constant / interval)
        decay = math.exp(-interval / self.time_constant)
        return end - slope + (lagged - start + slope) * decay


class AbstractDetectorEffect(AbstractEffect):
    """An effect of the detector on a frame of pixels."""

    @abc.abstractmethod
    def apply(
        self, radiance: Float[Values, "h w"], time: float, band: Band | None
    ) -> Float[Values, "h w"]:
        """Radiance as detected in the frame of a time [s], in W/(m^2 sr)."""


class Effects(NamedTuple):
    """Effects by their kind, each in order."""

    surface: tuple[AbstractSurfaceEffect, ...] = ()
    path: tuple[AbstractPathEffect, ...] = ()
    blur: tuple[AbstractBlur, ...] = ()
    lag: tuple[BolometerLag, ...] = ()
    detector: tuple[AbstractDetectorEffect, ...] = ()

    @property
    def spread(self) -> float:
        """Standard deviation of the spot of all optics [pixels]."""
        return float(np.sqrt(sum(blur.spread**2 for blur in self.blur)))


NO_EFFECTS = Effects()


def prepared_for(effect: _AbstractViewEffect, view: View, dtype: Any) -> Any:
    """Arrays of an effect in a view, in the type of its pixels, computed once."""

    def prepare(xp: Any) -> Any:
        arrays = effect.prepared(view, xp)
        return jax.tree.map(lambda array: array.astype(dtype), arrays)

    if is_traced(effect):
        return prepare(jnp)
    leaves, structure = jax.tree.flatten(effect)
    values = tuple(np.asarray(leaf, float).tobytes() for leaf in leaves)
    return view.once((structure, values, np.dtype(dtype)), lambda: prepare(np))
