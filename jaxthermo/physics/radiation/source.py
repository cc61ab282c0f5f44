"""Sources of radiation: their common interface, sun and point source, motion.

A surface absorbs

    q = a E A,    E = strength(t) X,

with the absorptivity a, the irradiance E and the true area A (thesis eq. 3). The
exposure X is geometry: cosine, distance and shadows. A moving source is evaluated at
fixed positions, one for each snapshot. Its position or direction is any function of
time; the tables are constant before the first and after the last time.
"""

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ...arrays import Numbers, Points, TimeVarying
from ...errors import InputError
from ...raster.views import unit_vector
from ...voxels.selection import AbstractSelection
from ..boundary import ImposedFlux
from ..flux_law import Forcing
from ..term import (
    AbstractSurfaceTerm,
    Binding,
    BodySurface,
    Cover,
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

    location_field: ClassVar[str]
    """Name of the field with its position or direction, perhaps a function."""

    @property
    @abc.abstractmethod
    def strength(self) -> Any:
        """Irradiance for a unit of exposure: a number or a function of time."""

    @property
    @abc.abstractmethod
    def on(self) -> AbstractSelection | None:
        """Part of the surface that it heats; None for all that it shines on."""

    def __check_init__(self):
        field = self.location_field
        value = _value_at(getattr(self, field), 0.0)
        self._check_location(value, f"{type(self).__name__}({field}=)")

    def _check_location(self, value: Any, what: str) -> None:
        """Raise an InputError that names `what` for an invalid position."""
        try:
            point = np.asarray(value, float)
        except (TypeError, ValueError):
            point = np.zeros(0)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise InputError(f"{what} {value!r}: give three finite numbers, in metres")

    @property
    @override
    def moves(self) -> bool:
        return callable(getattr(self, self.location_field))

    @override
    def at(self: _Source, time: float) -> _Source:
        if not self.moves:
            return self
        field = self.location_field
        value = _value_at(getattr(self, field), time)
        self._check_location(value, f"{type(self).__name__}({field}=) at {time:g} s:")
        return replace(self, **{field: _triple(value)})

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

    def points(self) -> Float[np.ndarray, "p 3"]:
        """Points of the source [m], none of which may be inside a body."""
        return np.zeros((0, 3))

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
        exposed = body.exposed(self.on)
        if isinstance(exposed, Omitted):
            return exposed
        if body.grid.contains(body.pose.to_body(self.points())).any():
            field = self.location_field
            raise InputError(
                f"{type(self).__name__}({field}={getattr(self, field)}): is inside "
                f"body {body.body} (or a part of it is); move it out of the body"
            )
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
    on: AbstractSelection | None = None
    """Part of the surface that it heats; the rest casts shadows still."""

    def __check_init__(self):
        check_value(self.irradiance, "Sun(irradiance [W/m^2])", 0.0)

    @property
    @override
    def strength(self) -> Any:
        return self.irradiance

    @override
    def _check_location(self, value: Any, what: str) -> None:
        unit_vector(value, what)

    @override
    def exposure(self, triangles, position, normal, pitch) -> Float[np.ndarray, " s"]:
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


def _value_at(value: Any, time: float) -> Any:
    return value(time) if callable(value) else value


def _triple(value: Any) -> Triple:
    x, y, z = (float(number) for number in np.asarray(value, float))
    return x, y, z


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
    on: AbstractSelection | None = None
    """Part of the surface that it heats; the rest casts shadows still."""

    def __check_init__(self):
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
    def points(self) -> Float[np.ndarray, "p 3"]:
        return np.asarray(self.position, float)[None]

    @override
    def exposure(self, triangles, position, normal, pitch) -> Float[np.ndarray, " s"]:
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


# Unit vectors with a shorter sum count as opposite: no unique arc connects them.
_OPPOSITE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class PointTable:
    """Points at given times, joined by straight lines at constant speeds.

    Raises:
        InputError: unless the times increase and each has a finite point.
    """

    times: Numbers
    """Times [s], increasing."""
    points: Points
    """World positions [m], one for each time."""

    def __post_init__(self):
        _make_plain(self, "points")

    def __call__(self, time: float) -> Triple:
        """Point at `time` [s]."""
        first, second, t = _between(self.times, self.points, time)
        return _triple((1 - t) * first + t * second)


@dataclass(frozen=True)
class DirectionTable:
    """Directions at given times, joined by the shorter arcs at constant rates.

    Raises:
        InputError: unless the times increase and each has a direction that is not
            opposite to the previous one.
    """

    times: Numbers
    """Times [s], increasing."""
    directions: Points
    """Directions of any length, one for each time."""

    def __post_init__(self):
        _make_plain(self, "directions")
        units = [unit_vector(d, "DirectionTable(directions=)") for d in self.directions]
        for i, (a, b) in enumerate(pairwise(units), 1):
            if np.linalg.norm(a + b) < _OPPOSITE_TOLERANCE:
                raise InputError(
                    f"DirectionTable: direction {i} is opposite to the one before; "
                    "give one between them"
                )

    def __call__(self, time: float) -> Triple:
        """Unit vector at `time` [s]."""
        *ends, t = _between(self.times, self.directions, time)
        first, second = (unit_vector(end) for end in ends)
        across = float(np.linalg.norm(np.cross(first, second)))
        angle = math.atan2(across, float(first @ second))
        if angle == 0:
            return _triple(first)
        # Spherical interpolation: the angular velocity is constant.
        turned = math.sin((1 - t) * angle) * first
        return _triple(unit_vector(turned + math.sin(t * angle) * second))


def _between(
    times: Any, rows: Any, time: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Rows before and after `time` [s], and the fraction of the interval passed [-]."""
    last = len(times) - 1
    position = float(np.interp(time, times, np.arange(last + 1.0)))
    before = int(position)
    first, second = rows[before], rows[min(before + 1, last)]
    return np.asarray(first), np.asarray(second), position - before


def _make_plain(table: Any, field: str) -> None:
    """Convert the fields to tuples, which can be compared and hashed."""
    name = type(table).__name__
    try:
        times = np.asarray(table.times, float)
        rows = np.asarray(getattr(table, field), float)
    except (TypeError, ValueError):
        times = rows = np.zeros(0)
    if times.ndim != 1 or not len(times) or rows.shape != (len(times), 3):
        raise InputError(f"{name}: give times, and three numbers for each of them")
    if not (np.isfinite(times).all() and np.isfinite(rows).all()):
        raise InputError(f"{name}: give finite numbers")
    if (np.diff(times) <= 0).any():
        raise InputError(f"{name}: the times must increase")
    object.__setattr__(table, "times", tuple(times.tolist()))
    object.__setattr__(table, field, tuple(_triple(row) for row in rows))
