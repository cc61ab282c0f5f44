"""Diffuse rectangular source (thesis eq. 2), and view factors to polygons.

    E = L integral over the source of cos cos' s / R^2 dA,

with the radiance L, the cosines at both ends and the lit fraction s. The rectangle is
divided into patches. The integral over each is exact, by Lambert's formula, so that no
minimum distance is needed: no surface receives more than pi L. Shadows are those of the
patch centres.
"""

from collections.abc import Callable, Hashable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float
from typing_extensions import override

from ...arrays import HostTime, Scalar, Time, TimeVarying, is_traced
from ...constants import SOLAR_TEMPERATURE, STEFAN_BOLTZMANN
from ...errors import InputError
from ...geometry.vectors import row_dot, unit_vector
from ...raster.views import view_frame
from ...voxels.selection import AbstractSelection
from ..time_varying import check_one_of, check_value, value_at
from .shadows import edges_of_points, lit_samples_from_point
from .source import AbstractSource, Appearance, fixed_or_moving, seen
from .source_motion import Triple


_Vectors = Float[np.ndarray, "s 3"]


def _edge(a: _Vectors, b: _Vectors, normal: _Vectors) -> Float[np.ndarray, " s"]:
    """Angle that an edge spans, times the cosine of its plane to the normal."""
    across = np.cross(a, b)
    size = np.linalg.norm(across, axis=1)
    # Corners that coincide with each other or with the element span no angle.
    angle = np.arctan2(size, row_dot(a, b))
    return angle * row_dot(across, normal) / np.where(size > 0, size, 1.0)


def polygon_view_factor(
    position: Float[np.ndarray, "s 3"],
    normal: Float[np.ndarray, "s 3"],
    corners: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, " s"]:
    """View factor [-] from surface elements to the front of a convex polygon.

    F = 1/(2 pi) sum over the edges a -> b of theta (a x b) . n / |a x b|

    with the corners a, b relative to the element, the angle theta between them and the
    element's normal n; exact at any distance, for the part above its horizon. Corners
    are counter-clockwise seen from the polygon's front [m].

    Source: Lambert, Photometria (1760); Hottel and Sarofim, Radiative Transfer (1967).
    """
    total = np.zeros(len(position))
    leaving = np.zeros_like(position)
    entering = np.zeros_like(position)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a = start - position
        b = end - position
        height_a = row_dot(a, normal)
        height_b = row_dot(b, normal)
        level = height_a == height_b
        t = np.where(level, 0.0, height_a / np.where(level, 1.0, height_a - height_b))
        crossing = a + t[:, None] * (b - a)
        sinks = (height_a > 0) & (height_b <= 0)
        rises = (height_a <= 0) & (height_b > 0)
        # A convex polygon sinks below the horizon at most once, and rises once.
        leaving += np.where(sinks[:, None], crossing, 0.0)
        entering += np.where(rises[:, None], crossing, 0.0)
        first = np.where(rises[:, None], crossing, a)
        last = np.where(sinks[:, None], crossing, b)
        above = (height_a > 0) | (height_b > 0)
        total += np.where(above, _edge(first, last, normal), 0.0)
    total += _edge(leaving, entering, normal)
    # Counter-clockwise from the front is clockwise around the element's normal.
    return np.clip(-total / (2 * np.pi), 0.0, 1.0)


class _GreyRadiance(Module):
    """Radiance of a grey surface: eps sigma T^4 / pi [W/(m^2 sr)]."""

    temperature: Any
    """[K], a number or a function of time."""
    emissivity: Any = 1.0

    def __call__(self, time: Time | HostTime) -> Float[Array, ""]:
        kelvin = value_at(self.temperature, time)
        square = kelvin * kelvin
        return value_at(self.emissivity, time) * (STEFAN_BOLTZMANN / np.pi) * square**2


def _check_emissivity(emissivity: Any) -> None:
    check_value(emissivity, "AreaSource(emissivity)", 0.0)
    if not is_traced(emissivity) and np.max(emissivity) > 1:
        raise InputError(f"AreaSource(emissivity={emissivity!r}): give 0 to 1")


class AreaSource(AbstractSource):
    """Rectangle that radiates diffusely from its front, with shadows.

    E = L integral over the source of cos cos' s / R^2 dA [W/m^2]

    The radiance L is given, or follows from a temperature and an emissivity.

    Raises:
        InputError: for an invalid geometry, or unless one of `radiance` and
            `temperature` is given.
    """

    name = "area_source"
    location_field = "centre"

    centre: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """World position [m], or a function of time [s] that returns it."""
    normal: Triple = eqx.field(static=True, converter=fixed_or_moving)
    """Normal of its front, of any length."""
    size: tuple[float, float] = eqx.field(static=True, converter=fixed_or_moving)
    """Width across `up` and height along `up` [m]."""
    radiance: TimeVarying | None = None
    """L [W/(m^2 sr)], a number or a function of time."""
    temperature: TimeVarying | None = None
    """T [K], a number or a function of time: L = eps sigma T^4 / pi."""
    emissivity: Scalar = 1.0
    """eps [-], a number, used with `temperature`."""
    up: Triple = eqx.field(
        static=True, converter=fixed_or_moving, default=(0.0, 0.0, 1.0)
    )
    """Direction of the height, projected onto the rectangle."""
    patches: int = eqx.field(static=True, default=4)
    """Number of patches along each edge, each with its own shadow map."""
    on: AbstractSelection | None = None
    """Part of the surface that it heats; the rest still casts shadows."""

    def __check_init__(self):
        unit_vector(self.normal, "AreaSource(normal=)")
        unit_vector(self.up, "AreaSource(up=)")
        if np.shape(self.size) != (2,) or not all(0 < s < np.inf for s in self.size):
            raise InputError(
                f"AreaSource(size={self.size!r}): give a width and a height in metres"
            )
        if self.patches < 1:
            raise InputError(f"AreaSource(patches={self.patches}): give 1 or more")
        values = {
            "radiance [W/(m^2 sr)]": self.radiance,
            "temperature [K]": self.temperature,
        }
        check_one_of("AreaSource", values, 0.0)
        if self.temperature is not None:
            _check_emissivity(self.emissivity)

    @property
    @override
    def strength(self) -> Any:
        if self.radiance is not None:
            return self.radiance
        grey = _GreyRadiance(self.temperature, self.emissivity)
        if callable(self.temperature):
            return grey
        return grey(jnp.zeros((), float))

    @property
    @override
    def values(self) -> tuple[Any, ...]:
        return (self.temperature if self.radiance is None else self.radiance,)

    @property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Vectors along its width and its height, normal = width x height [m]."""
        front = unit_vector(self.normal)
        across = np.cross(unit_vector(self.up), front)
        if np.linalg.norm(across) < 1e-6:
            across = view_frame(front)[0]
        width = unit_vector(across)
        return width * self.size[0], np.cross(front, width) * self.size[1]

    def patch_corners(self) -> Float[np.ndarray, "p 4 3"]:
        """Corners of the patches, counter-clockwise seen from the front [m]."""
        width, height = self._edges
        low = np.asarray(self.centre, float) - (width + height) / 2
        edge = np.arange(self.patches)
        step = np.stack(np.meshgrid(edge, edge), -1).reshape(-1, 2)
        turn = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        fraction = (step[:, None] + turn) / self.patches
        return low + fraction[..., :1] * width + fraction[..., 1:] * height

    @override
    def points(self) -> Float[np.ndarray, "p 3"]:
        return self.patch_corners().mean(1)

    @property
    @override
    def spectrum(self) -> Any:
        kelvin: Any = self.temperature
        if kelvin is None:
            return SOLAR_TEMPERATURE
        return kelvin if callable(kelvin) or is_traced(kelvin) else float(kelvin)

    @property
    @override
    def exposure_key(self) -> Hashable:
        return (self.centre, self.normal, self.size, self.up, self.patches)

    @override
    def unshaded(self, position, normal) -> Float[np.ndarray, "p s"]:
        """Integral of cos cos' / R^2 over each patch [sr], at most pi."""
        factors = [
            polygon_view_factor(position, normal, corners)
            for corners in self.patch_corners()
        ]
        return np.pi * np.stack(factors)

    @override
    def lit_samples(self, triangles, position, normal, pitch):
        front = unit_vector(self.normal)
        points = self.points()
        lit = np.zeros((len(points), len(position)), np.uint8)
        # Nothing behind the rectangle is lit.
        ahead = np.flatnonzero((position - points.mean(0)) @ front > 0)
        for number, point in enumerate(points):
            lit[number, ahead] = lit_samples_from_point(
                triangles,
                position=position[ahead],
                normal=normal[ahead],
                eye=point,
                pitch=edges_of_points(pitch, ahead),
            )
        return lit

    @override
    def appearance(self, origin, step) -> Appearance:
        return _rectangle(
            origin, step=step, centre=np.asarray(self.centre, float), edges=self._edges
        )


def _rectangle(
    origin: _Vectors,
    step: _Vectors,
    centre: Float[np.ndarray, "3"],
    edges: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
) -> Appearance:
    """Diffuse rectangle of a given radiance, from the front: width x height."""
    front = np.cross(*edges)
    towards = step @ front
    facing = towards < 0
    depth = (centre - origin) @ front / np.where(facing, towards, -1.0)
    offset = origin + depth[:, None] * step - centre
    within = [np.abs(offset @ edge) <= edge @ edge / 2 for edge in edges]
    return seen(facing & (depth > 0) & within[0] & within[1], 1.0, depth)
