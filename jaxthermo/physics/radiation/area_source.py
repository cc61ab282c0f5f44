"""A flat source near by: the thesis' eq. 2 in full.

E = L integral over the source of cos cos' s / R^2 dA,

with the radiance L and the cosines at both ends. The rectangle is cut into patches. The
integral over each is exact, by Lambert's formula, so that it needs no floor at zero
distance: no surface receives more than pi L. Shadows are those of the patches' middles.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import is_traced
from ...constants import STEFAN_BOLTZMANN
from ...errors import InputError
from ...raster.directions import unit_vector, view_frame
from ..term import Forcing, Surface
from ..time_varying import check_value, largest, value_at
from .source import (
    AbstractSource,
    Triple,
    check_point,
    fixed_or_moving,
    inside_body,
    placed,
)
from .visibility import lit_share_from


# View factor from surface elements to a flat polygon: Lambert's formula.
#
# F = 1/(2 pi) sum over the edges a -> b of theta (a x b) . n / |a x b|
#
# with the corners a, b as seen from the element, the angle theta between them and the
# element's normal n; exact at any distance, for the part above the element's horizon.
# Source: Lambert, Photometria (1760); Hottel and Sarofim, Radiative Transfer (1967).


Vectors = Float[np.ndarray, "s 3"]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def _edge(a: Vectors, b: Vectors, normal: Vectors) -> Float[np.ndarray, " s"]:
    """Of one edge: the angle it spans, times the cosine of its plane to the normal."""
    across = np.cross(a, b)
    size = np.linalg.norm(across, axis=1)
    # Corners that coincide, or are where the element is, span no angle.
    angle = np.arctan2(size, _dot(a, b))
    return angle * _dot(across, normal) / np.where(size > 0, size, 1.0)


def polygon_view_factor(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    corners: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, " s"]:
    """Share of what elements emit that reaches the front of a convex polygon.

    Args:
        position: of the elements [m].
        normal: theirs.
        corners: of the polygon, counter-clockwise seen from its front [m].
    """
    total = np.zeros(len(position))
    leaving, entering = np.zeros_like(position), np.zeros_like(position)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = start - position, end - position
        up, down = _dot(a, normal), _dot(b, normal)
        share = np.where(up == down, 0.0, up / np.where(up == down, 1.0, up - down))
        crossing = a + share[:, None] * (b - a)
        sinks, rises = (up > 0) & (down <= 0), (up <= 0) & (down > 0)
        # A convex polygon dips below the horizon once and comes up again once.
        leaving += np.where(sinks[:, None], crossing, 0.0)
        entering += np.where(rises[:, None], crossing, 0.0)
        first = np.where(rises[:, None], crossing, a)
        last = np.where(sinks[:, None], crossing, b)
        total += np.where((up > 0) | (down > 0), _edge(first, last, normal), 0.0)
    total += _edge(leaving, entering, normal)
    # Seen from its front the corners turn the other way round the element's normal.
    return np.clip(-total / (2 * np.pi), 0.0, 1.0)


class GreyRadiance(eqx.Module):
    """Radiance of a grey surface: eps sigma T^4 / pi [W/(m^2 sr)]."""

    temperature: Any
    """[K], a number or a function of time."""
    emissivity: Any = 1.0

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """At `time` [s]."""
        kelvin = value_at(self.temperature, time)
        square = kelvin * kelvin
        return value_at(self.emissivity, time) * (STEFAN_BOLTZMANN / np.pi) * square**2


def _check_emissivity(emissivity: Any) -> None:
    check_value(emissivity, "AreaSource(emissivity)", 0.0)
    if not is_traced(emissivity) and np.max(emissivity) > 1:
        raise InputError(f"AreaSource(emissivity={emissivity!r}): give 0 to 1")


class AreaSource(AbstractSource):
    """A rectangle that radiates diffusely from its front, with shadows.

    Give its radiance, or a temperature with an emissivity.
    """

    centre: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """World [m]; or a function of time [s] that gives it."""
    normal: Triple = eqx.field(static=True, converter=fixed_or_moving)
    """Out of its front; any length."""
    size: tuple[float, float] = eqx.field(static=True, converter=fixed_or_moving)
    """Width across `up` and height along it [m]."""
    radiance: Any = None
    """L [W/(m^2 sr)], a number or a function of time."""
    temperature: Any = None
    """[K], a number or a function of time: L = eps sigma T^4 / pi."""
    emissivity: Any = 1.0
    """[-], with `temperature`."""
    up: Triple = eqx.field(
        static=True, converter=fixed_or_moving, default=(0.0, 0.0, 1.0)
    )
    """The height runs along its part across the normal; any if there is none."""
    patches: int = eqx.field(static=True, default=4)
    """Along each edge, each with a shadow map of its own."""

    def __check_init__(self):
        check_point(placed(self.centre, 0.0), "AreaSource(centre=)")
        unit_vector(self.normal, "AreaSource(normal=)")
        unit_vector(self.up, "AreaSource(up=)")
        if np.shape(self.size) != (2,) or not all(0 < s < np.inf for s in self.size):
            raise InputError(
                f"AreaSource(size={self.size!r}): give a width and a height in metres"
            )
        if self.patches < 1:
            raise InputError(f"AreaSource(patches={self.patches}): give 1 or more")
        if (self.radiance is None) == (self.temperature is None):
            raise InputError("AreaSource: give either `radiance` or `temperature`")
        if self.radiance is not None:
            check_value(self.radiance, "AreaSource(radiance [W/(m^2 sr)])", 0.0)
        else:
            check_value(self.temperature, "AreaSource(temperature [K])", 0.0)
            _check_emissivity(self.emissivity)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "area_source"

    @property
    def strength(self) -> Any:
        """Its radiance [W/(m^2 sr)]."""
        if self.radiance is not None:
            return self.radiance
        grey = GreyRadiance(self.temperature, self.emissivity)
        if callable(self.temperature):
            return grey
        return grey(jnp.zeros((), float))

    @property
    def values(self) -> tuple[Any, ...]:
        """What drives it."""
        return (self.temperature if self.radiance is None else self.radiance,)

    @property
    def place(self) -> str:
        """Its centre."""
        return "centre"

    @property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Along its width and its height, normal = width x height [m]."""
        front = unit_vector(self.normal)
        across = np.cross(unit_vector(self.up), front)
        if np.linalg.norm(across) < 1e-6:
            across = view_frame(front)[0]
        width = unit_vector(across)
        return width * self.size[0], np.cross(front, width) * self.size[1]

    def corners_of_patches(self) -> Float[np.ndarray, "p 4 3"]:
        """Counter-clockwise seen from the front [m]."""
        width, height = self.edges
        low = np.asarray(self.centre, float) - (width + height) / 2
        step = np.stack(np.meshgrid(*[np.arange(self.patches)] * 2), -1).reshape(-1, 2)
        turn = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        share = (step[:, None] + turn) / self.patches
        return low + share[..., :1] * width + share[..., 1:] * height

    def check_place(self, surface: Surface) -> None:
        """Refuse a source that reaches into a body.

        Raises:
            InputError: if the middle of a patch is inside it.
        """
        if inside_body(surface, self.corners_of_patches().mean(1)).any():
            raise InputError(
                f"AreaSource(centre={self.centre}, size={self.size}): is in part "
                f"inside body {surface.body}; move it out of the body"
            )

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """The integral of cos cos' s / R^2 over its front [sr], at most pi."""
        found = np.zeros(len(position))
        for corners in self.corners_of_patches():
            factor = polygon_view_factor(position, normal, corners)
            seen = np.flatnonzero(factor > 0)
            if len(seen):
                lit = lit_share_from(
                    triangles, position[seen], normal[seen], corners.mean(0), pitch
                )
                found[seen] += np.pi * factor[seen] * lit
        return found

    def forcing(self, end: float | int) -> Forcing:
        """The heat flux right in front of it [W/m^2]."""
        if self.radiance is not None:
            return Forcing(heat_flux=np.pi * largest(self.radiance, end))
        hottest = GreyRadiance(largest(self.temperature, end), self.emissivity)
        return Forcing(heat_flux=np.pi * hottest(jnp.zeros((), float)))
