"""Sources of radiation: their common interface, the sun and a point source.

A surface absorbs

    q = a E A,    E = strength(t) X,

with the absorptivity a, the irradiance E and the true area A (thesis eq. 3). The
exposure X is geometry: cosine, distance and shadows. A moving source is evaluated at
fixed positions, one for each snapshot.
"""

import abc
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from ...arrays import TimeVarying
from ...errors import InputError
from ...raster.views import unit_vector
from ..boundary import ImposedFlux
from ..term import (
    AbstractSurfaceTerm,
    Binding,
    BodySurface,
    Cover,
    Forcing,
    Omitted,
    Scale,
    Surface,
)
from ..time_varying import check_value, for_jit, is_zero, largest
from .visibility import lit_fraction, lit_fraction_from_point


Triple = tuple[float, float, float]
_Source = TypeVar("_Source", bound="AbstractSource")


def fixed_or_moving(value: Any) -> Any:
    """Three numbers as a tuple; functions, and invalid values, unchanged."""
    try:
        return value if callable(value) else tuple(float(number) for number in value)
    except (TypeError, ValueError):
        return value


class AbstractSource(AbstractSurfaceTerm):
    """Source that irradiates surfaces and is not heated by them."""

    location_field: eqx.AbstractClassVar[str]
    """Name of the field with its position or direction, perhaps a function."""

    @property
    @abc.abstractmethod
    def strength(self) -> Any:
        """Irradiance for a unit of exposure: a number or a function of time."""

    def check_location_value(self, value: Any, what: str) -> None:
        """Raise an InputError that names `what` for an invalid position."""
        check_point(value, what)

    @property
    @override
    def moves(self) -> bool:
        return callable(getattr(self, self.location_field))

    @override
    def at(self: _Source, time: float) -> _Source:
        if not self.moves:
            return self
        field = self.location_field
        value = location_at(getattr(self, field), time)
        what = f"{type(self).__name__}({field}=) at {time:g} s:"
        self.check_location_value(value, what)
        return replace(self, **{field: triple(value)})

    @abc.abstractmethod
    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Irradiance of surface points for a unit of strength, never negative.

        Args:
            triangles: all surfaces that cast shadows, world [m].
            position: surface points [m].
            normal: outward unit normals at the points.
            pitch: edge of the squares that the points represent [m].
        """

    @abc.abstractmethod
    def check_location(self, surface: BodySurface) -> None:
        """Raise an InputError if the source is inside this body."""

    @override
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        if surface.prune and is_zero(self.strength):
            return (Omitted("it is switched off at all times"),)
        law = ImposedFlux(for_jit(self.strength, surface.dtype))
        return surface.bind(law, [self._lit(body) for body in surface.bodies])

    def _lit(self, body: BodySurface) -> Cover | Omitted:
        """Absorbing area of a body that the source sees, times the exposure."""
        if body.prune and is_zero(body.absorptivity):
            return body.omitted("the surface has absorptivity 0")
        exposed = body.exposed()
        if isinstance(exposed, Omitted):
            return exposed
        self.check_location(body)
        exposure = self.exposure(
            body.scene_triangles, body.position, body.normal, body.pitch
        )
        # Fragments in shadow are left out of the binding, so that they cost nothing.
        lit = exposed & (exposure > 0)
        if body.prune and not lit.any():
            return body.omitted("no surface of this body sees it")
        absorbed = body.absorptivity * exposure.astype(body.dtype)
        return absorbed * body.area, lit


class Sun(AbstractSource):
    """Parallel rays from one direction d, with shadows.

    E = irradiance max(0, -d . n) s [W/m^2], with the lit fraction s of each fragment.

    Raises:
        InputError: for a direction of length 0, or a negative irradiance.

    Example:
        >>> import jaxthermo as jt
        >>> low = jt.Sun(direction=(-1.0, 0.0, -0.2), irradiance=800.0)
        >>> shaded = jt.Sun((0.0, 0.0, -1.0), irradiance=jt.Until(800.0, 90.0))
    """

    name = "sun"
    location_field = "direction"

    direction: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """Direction of the rays, of any length, or a function of time [s] for it."""
    irradiance: TimeVarying
    """Irradiance normal to the rays [W/m^2]: a number or a function of time."""

    def __check_init__(self):
        self.check_location_value(location_at(self.direction, 0.0), "Sun(direction=)")
        check_value(self.irradiance, "Sun(irradiance [W/m^2])", 0.0)

    @property
    @override
    def strength(self) -> Any:
        return self.irradiance

    @override
    def check_location_value(self, value: Any, what: str) -> None:
        unit_vector(value, what)

    @override
    def check_location(self, surface: BodySurface) -> None:
        """Accept any scene: parallel rays have no position."""

    @override
    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Lambert's cosine times the lit fraction of surface points [-]."""
        cosine = np.maximum(0.0, -normal @ unit_vector(self.direction))
        return cosine * lit_fraction(triangles, position, normal, self.direction, pitch)

    @override
    def forcing(self, end: float | int) -> Forcing:
        return Forcing(heat_flux=largest(self.irradiance, end))

    @override
    def scale(self, material: Any, kelvin: float, end: float) -> Scale:
        strength = float(largest(self.irradiance, end))
        return Scale(heat_flux=float(material.absorptivity) * strength)


def location_at(value: Any, time: float) -> Any:
    """Position or direction at `time` [s], given as numbers or a function of time."""
    return value(time) if callable(value) else value


def triple(value: Any) -> Triple:
    """Three numbers as a tuple of floats, for values already checked."""
    x, y, z = (float(number) for number in np.asarray(value, float))
    return x, y, z


def check_point(value: Any, what: str) -> None:
    """Raise an InputError that names `what` unless `value` is a point in space."""
    try:
        point = np.asarray(value, float)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"{what} {value!r}: give three finite numbers, in metres")


def inside_body(
    surface: BodySurface, points: Float[np.ndarray, "p 3"]
) -> Bool[np.ndarray, " p"]:
    """True for each world point [m] inside a solid voxel of a body."""
    grid = surface.grid
    cells = np.floor(grid.lattice.to_cells(surface.pose.to_body(points))).astype(int)
    within = ((cells >= 0) & (cells < grid.lattice.shape)).all(1)
    found = np.zeros(len(points), bool)
    found[within] = grid.solid[tuple(cells[within].T)]
    return found


class PointSource(AbstractSource):
    """Isotropic point source, with shadows.

    E = I max(0, L . n) s / max(R, R_0)^2 [W/m^2],

    with the unit vector L to the source, the lit fraction s and the distance R. Below
    R_0 a real source is no point any more. (The thesis' eq. 3 omits the distance.)

    Raises:
        InputError: for an invalid position, or values that are not positive.
    """

    name = "point_source"
    location_field = "position"

    position: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """World position [m], or a function of time [s] that returns it."""
    radiant_intensity: TimeVarying
    """I [W/sr], power over 4 pi: a number or a function of time."""
    min_distance: float = eqx.field(static=True, default=0.01)
    """R_0 [m]: closer surfaces receive the irradiance at this distance."""

    def __check_init__(self):
        check_point(location_at(self.position, 0.0), "PointSource(position=)")
        what = "PointSource(radiant_intensity [W/sr])"
        check_value(self.radiant_intensity, what, 0.0)
        if not (np.isfinite(self.min_distance) and self.min_distance > 0):
            raise InputError(
                f"PointSource(min_distance={self.min_distance!r}): "
                "give a positive length in metres"
            )

    @property
    @override
    def strength(self) -> Any:
        return self.radiant_intensity

    @override
    def check_location(self, surface: BodySurface) -> None:
        if inside_body(surface, np.asarray(self.position, float)[None]).any():
            raise InputError(
                f"PointSource(position={self.position}): is inside body "
                f"{surface.body}; move it out of the body"
            )

    @override
    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Cosine times lit fraction over the squared distance [1/m^2]."""
        origin = np.asarray(self.position, float)
        away = origin - position
        distance = np.linalg.norm(away, axis=1)
        floored = np.maximum(distance, self.min_distance)
        along = np.einsum("ij,ij->i", normal, away) / np.where(
            distance > 0, distance, 1
        )
        found = np.maximum(0.0, along) / (floored * floored)
        facing = np.flatnonzero(found > 0)
        found[facing] *= lit_fraction_from_point(
            triangles, position[facing], normal[facing], origin, pitch
        )
        return found

    @override
    def forcing(self, end: float | int) -> Forcing:
        highest = largest(self.radiant_intensity, end)
        return Forcing(heat_flux=highest / (self.min_distance * self.min_distance))
