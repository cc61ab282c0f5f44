"""Sources of radiation: their common interface, sun and point source, motion.

A surface absorbs

    q = a E A,    E = strength(t) X,

with the absorptivity a, the irradiance E and the true area A (thesis eq. 3). The
exposure X is geometry: cosine, distance and shadows. A moving source is evaluated at
fixed positions, one for each snapshot. Its position or direction is any function of
time, such as a table of `source_motion`.
"""

import abc
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Float, UInt8
from typing_extensions import override

from ...arrays import TimeVarying
from ...constants import SOLAR_TEMPERATURE
from ...errors import InputError
from ...geometry.vectors import row_dot, unit_vector, unit_vectors
from ...memo.found import found
from ...memo.once import once
from ...voxels.selection import AbstractSelection
from ..boundary import ImposedFlux
from ..surface import BodySurface, Surface
from ..term import OperatingPoint, Scale
from ..time_varying import check_value, for_jit, is_zero, largest
from .free_lines import free_lines
from .irradiation import AbstractRadiativeTerm, Irradiation
from .shadows import (
    SquareEdge,
    Squares,
    lit_fractions,
    lit_samples_from_point,
    sunlit_samples,
)
from .source_motion import Triple, triple


_Rays = Float[np.ndarray, "p 3"]
Appearance = tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]
"""Radiance for a unit of strength, and depth along the optical axis [m]."""

_SUN_HALF_ANGLE = 0.0046505
"""Apparent radius of the sun, 695 700 km at 149 597 871 km [rad] (IAU 2015 B3)."""

_Source = TypeVar("_Source", bound="AbstractSource")


def seen(hit: np.ndarray, radiance: float, depth: np.ndarray) -> Appearance:
    """Appearance of a source along rays, by the mask of those that hit it."""
    return np.where(hit, radiance, 0.0), np.where(hit, depth, np.inf)


def _distant_disc(step: _Rays, towards: Float[np.ndarray, "3"]) -> Appearance:
    """Sun in a direction, radiance E / (pi sin^2 a) of an irradiance E normal to it."""
    # By the chord: the cosine of so small an angle has lost its digits.
    gap = unit_vectors(step) - towards
    hit = np.linalg.norm(gap, axis=1) <= 2 * math.sin(_SUN_HALF_ANGLE / 2)
    radiance = 1 / (math.pi * math.sin(_SUN_HALF_ANGLE) ** 2)
    return seen(hit, radiance, np.full(len(step), np.inf))


def _sphere(
    origin: _Rays, step: _Rays, centre: Float[np.ndarray, "3"], radius: float
) -> Appearance:
    """Diffuse sphere, radiance I / (pi R^2) of a radiant intensity I."""
    square = row_dot(step, step)
    offset = origin - centre
    half = row_dot(offset, step) / square
    under = half * half - (row_dot(offset, offset) - radius * radius) / square
    depth = -half - np.sqrt(np.maximum(under, 0.0))
    hit = (under >= 0) & (depth > 0)
    return seen(hit, 1 / (math.pi * radius * radius), depth)


def fixed_or_moving(value: Any) -> Any:
    """Three numbers as a tuple; functions, and invalid values, unchanged."""
    try:
        return value if callable(value) else tuple(float(number) for number in value)
    except (TypeError, ValueError):
        return value


class AbstractSource(AbstractRadiativeTerm):
    """Source that irradiates surfaces and is not heated by them."""

    absorbed_by = "absorptivity"
    location_field: ClassVar[str]
    """Name of the field with its position or direction, perhaps a function."""

    @property
    @abc.abstractmethod
    def strength(self) -> Any:
        """Irradiance for a unit of exposure: a number or a function of time."""

    def __check_init__(self):
        field = self.location_field
        value = _value_at(getattr(self, field), 0.0)
        self._check_location(value, f"{type(self).__name__}({field}=)")

    def _check_location(self, value: Any, argument: str) -> None:
        """Raise an InputError that names the argument for an invalid position."""
        try:
            point = np.asarray(value, float)
        except (TypeError, ValueError):
            point = np.zeros(0)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise InputError(
                f"{argument} {value!r}: give three finite numbers, in metres"
            )

    @property
    @override
    def moves(self) -> bool:
        return callable(getattr(self, self.location_field))

    @override
    def snapshot_times(self, end: float | int) -> tuple[float, ...]:
        times = getattr(getattr(self, self.location_field), "snapshots", None)
        return super().snapshot_times(end) if times is None else times

    @override
    def at(self: _Source, time: float) -> _Source:
        if not self.moves:
            return self
        field = self.location_field
        value = _value_at(getattr(self, field), time)
        self._check_location(value, f"{type(self).__name__}({field}=) at {time:g} s:")
        return replace(self, **{field: triple(value)})

    @abc.abstractmethod
    def unshaded(
        self, position: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
    ) -> Float[np.ndarray, "q s"]:
        """Irradiance by each point of the source without obstacles, never negative.

        It is that of surface points [m] with outward unit normals, for a unit of
        strength.
        """

    @abc.abstractmethod
    def lit_samples(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: SquareEdge,
    ) -> UInt8[np.ndarray, "q s"]:
        """Samples of surface points that each point of the source lights, one a bit.

        Args:
            triangles: surfaces that cast shadows, world [m].
            position: surface points [m].
            normal: outward unit normals at the points.
            pitch: edge of the squares that the points represent [m], one or one each.
        """

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: SquareEdge,
    ) -> Float[np.ndarray, " s"]:
        """Irradiance of surface points for a unit of strength, never negative.

        Arguments are those of `lit_samples`.
        """
        lit = self.lit_samples(triangles, position, normal, pitch)
        return (self.unshaded(position, normal) * lit_fractions(lit)).sum(0)

    def lit_squares(
        self, triangles: Float[np.ndarray, "f 3 3"], surfaces: Sequence[Squares]
    ) -> list[UInt8[np.ndarray, "q _"]]:
        """The samples of `lit_samples` on each of some surfaces."""
        lit_samples = self.lit_samples
        return [lit_samples(triangles, *squares) for squares in surfaces]

    def towards(
        self, position: Float[np.ndarray, "s 3"]
    ) -> Float[np.ndarray, "#s 3"] | None:
        """Vectors from points to the source; None where it is too large for one."""
        del position
        return None

    @property
    def exposure_key(self) -> Hashable:
        """Values on which its exposure depends, besides the surfaces; None if unknown.

        The shadows of a source without a key are computed again for every run.
        """
        return None

    def points(self) -> Float[np.ndarray, "p 3"]:
        """Points of the source [m], none of which may be inside a body."""
        return np.zeros((0, 3))

    @property
    def cone(self) -> tuple[Float[np.ndarray, "3"], float] | None:
        """Unit vector to a source at infinity, and its apparent radius [rad].

        None for a source nearby: `appearance` alone says where it is seen.
        """
        return None

    def appearance(
        self, origin: Float[np.ndarray, "p 3"], step: Float[np.ndarray, "p 3"]
    ) -> Appearance:
        """Radiance along rays towards a camera for a unit of strength, and its depth.

        Rays start at `origin` [m] and proceed by `step` [m] per metre of depth; the
        radiance is 0 on rays that miss the source. A source without an extent, as by
        default, is never seen.
        """
        del step
        return np.zeros(len(origin)), np.full(len(origin), np.inf)

    @property
    def spectrum(self) -> Any:
        """Temperature of a black body with its spectrum [K]: that of the sun."""
        return SOLAR_TEMPERATURE

    @override
    def irradiation(self, surface: Surface) -> tuple[Irradiation, ...]:
        if surface.prune and is_zero(self.strength):
            return ()
        law = ImposedFlux(for_jit(self.strength, surface.dtype))
        exposures = self._exposures(surface.bodies)
        irradiation = self._on_all(surface, exposures, law=law, spectrum=self.spectrum)
        return (irradiation,)

    def _exposures(
        self, bodies: tuple[BodySurface, ...]
    ) -> list[Float[np.ndarray, " _"]]:
        self._check_outside(bodies)
        key = self.exposure_key
        by = None if key is None else ("exposure", type(self), key)
        # A method of a module is a new object in each call: one for all bodies.
        towards = self.towards
        unshaded = self.unshaded
        facing = once(lambda body: body.facing(towards(body.position)))

        def search(triangles, viewers: tuple[BodySurface, ...]):
            squares = [
                Squares(body.position, facing(body).normal, body.grid.fragment_edge)
                for body in viewers
            ]
            return self.lit_squares(triangles, squares)

        def shade(body: BodySurface, lit):
            part = facing(body)
            irradiance = unshaded(body.position, part.normal) * lit_fractions(lit)
            return part.fraction * irradiance.sum(0)

        lit_of_bodies = free_lines(
            bodies,
            search,
            by=by,
            task=f"shadows of {self.name} on",
            is_distant=self.cone is not None,
        )
        return [
            found(
                (lit, body.position, body.normal),
                by=by,
                find=partial(shade, body, lit),
            )
            for body, lit in zip(bodies, lit_of_bodies, strict=True)
        ]

    def _check_outside(self, bodies: tuple[BodySurface, ...]) -> None:
        points = self.points()
        if not len(points):
            return
        for body in bodies:
            if body.grid.contains(body.pose.to_body(points)).any():
                field = self.location_field
                raise InputError(
                    f"{type(self).__name__}({field}={getattr(self, field)}): is inside "
                    f"body {body.body} (or a part of it is); move it out of the body"
                )


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
    from_outside = True
    location_field = "direction"

    direction: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """Direction of the rays, of any length, or a function of time [s] for it."""
    irradiance: TimeVarying
    """Irradiance normal to the rays [W/m^2]: a number or a function of time."""
    on: AbstractSelection | None = None
    """Part of the surface that it heats; the rest still casts shadows."""

    def __check_init__(self):
        check_value(self.irradiance, "Sun(irradiance [W/m^2])", 0.0)

    @property
    @override
    def strength(self) -> Any:
        return self.irradiance

    @override
    def _check_location(self, value: Any, argument: str) -> None:
        unit_vector(value, argument)

    @property
    @override
    def exposure_key(self) -> Hashable:
        return self.direction

    @override
    def towards(self, position) -> Float[np.ndarray, "1 3"]:
        return -unit_vector(self.direction)[None]

    @override
    def unshaded(self, position, normal) -> Float[np.ndarray, "1 s"]:
        """Lambert's cosine [-]."""
        return np.maximum(0.0, -normal @ unit_vector(self.direction))[None]

    @override
    def lit_samples(self, triangles, position, normal, pitch):
        (lit,) = self.lit_squares(triangles, [Squares(position, normal, pitch)])
        return lit

    @override
    def lit_squares(self, triangles, surfaces):
        lit = sunlit_samples(triangles, surfaces, self.direction)
        return [samples[None] for samples in lit]

    @property
    @override
    def cone(self) -> tuple[Float[np.ndarray, "3"], float]:
        # A little more than the disc, whose edge is rounded.
        return -unit_vector(self.direction), 1.001 * _SUN_HALF_ANGLE

    @override
    def appearance(self, origin, step) -> Appearance:
        return _distant_disc(step, -unit_vector(self.direction))

    @override
    def scale(self, point: OperatingPoint) -> Scale:
        strength = float(largest(self.irradiance, point.end))
        return Scale(heat_flux=float(point.material.absorptivity) * strength)


def _value_at(value: Any, time: float) -> Any:
    return value(time) if callable(value) else value


class PointSource(AbstractSource):
    """Isotropic point source, with shadows.

    E = I max(0, L . n) s / max(R, R_0)^2 [W/m^2],

    with the unit vector L to the source, the lit fraction s and the distance R. A real
    source closer than R_0 is not a point. (The thesis' eq. 3 omits the distance.)

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
    """Part of the surface that it heats; the rest still casts shadows."""

    def __check_init__(self):
        argument = "PointSource(radiant_intensity [W/sr])"
        check_value(self.radiant_intensity, argument, 0.0)
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

    @property
    @override
    def exposure_key(self) -> Hashable:
        return self.position, self.min_distance

    @override
    def towards(self, position) -> Float[np.ndarray, "s 3"]:
        return np.asarray(self.position, float) - position

    @override
    def unshaded(self, position, normal) -> Float[np.ndarray, "1 s"]:
        """Cosine over the squared distance [1/m^2]."""
        away = np.asarray(self.position, float) - position
        distance = np.linalg.norm(away, axis=1)
        floored = np.maximum(distance, self.min_distance)
        safe_distance = np.where(distance > 0, distance, 1)
        along = row_dot(normal, away) / safe_distance
        return (np.maximum(0.0, along) / (floored * floored))[None]

    @override
    def lit_samples(self, triangles, position, normal, pitch):
        return lit_samples_from_point(
            triangles,
            position=position,
            normal=normal,
            eye=np.asarray(self.position, float),
            pitch=pitch,
        )[None]

    @override
    def appearance(self, origin, step) -> Appearance:
        # But for shadows, a diffuse sphere of this radius irradiates as the law says.
        centre = np.asarray(self.position, float)
        return _sphere(origin, step=step, centre=centre, radius=self.min_distance)
