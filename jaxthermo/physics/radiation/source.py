"""Sources of radiation: Lambert's law at the surface, and the sun (thesis eq. 3).

Each gives an irradiance of strength times exposure, and the surface absorbs

    q = a E A,    E = strength(t) X,

with the absorptivity a and the true area A. The exposure X is geometry: the cosine, the
distance and the shadows. Where a source moves, it is frozen moment by moment.
"""

import abc
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from ...arrays import Scalar
from ...errors import InputError
from ...raster.directions import unit_vector
from ..boundary import ImposedFlux
from ..term import AbstractSurfaceTerm, Binding, Forcing, Omitted, Surface, binding
from ..time_varying import check_value, for_jit, is_zero, largest
from .visibility import lit_share, lit_share_from


Triple = tuple[float, float, float]


def fixed_or_moving(value: Any) -> Any:
    """Three numbers as a tuple; functions, and what the checks will refuse, as is."""
    try:
        return value if callable(value) else tuple(float(number) for number in value)
    except (TypeError, ValueError):
        return value


Own = TypeVar("Own", bound="AbstractSource")


class AbstractSource(AbstractSurfaceTerm):
    """Something that shines on surfaces and is not warmed by them."""

    @property
    @abc.abstractmethod
    def strength(self) -> Any:
        """The irradiance for each unit of exposure; a number or a function of time."""

    @property
    @abc.abstractmethod
    def place(self) -> str:
        """Which of its fields says where it is, and may be a function of time."""

    def check_given(self, value: Any, what: str) -> None:
        """Refuse what is no place.

        Raises:
            InputError: naming `what`.
        """
        check_point(value, what)

    @property
    def moves(self) -> bool:
        """Whether its place is a function of time."""
        return callable(getattr(self, self.place))

    def at(self: Own, time: float) -> Own:
        """The source as it stands at `time` [s]."""
        if not self.moves:
            return self
        value = placed(getattr(self, self.place), time)
        self.check_given(value, f"{type(self).__name__}({self.place}=) at {time:g} s:")
        return replace(self, **{self.place: triple(value)})

    @abc.abstractmethod
    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Irradiance of surface points for each unit of strength, never negative.

        Args:
            triangles: everything that casts shadows, world [m].
            position: the points [m].
            normal: outward at them.
            pitch: edge of the squares that the points stand for [m].
        """

    @abc.abstractmethod
    def check_place(self, surface: Surface) -> None:
        """Refuse a source that stands where none can.

        Raises:
            InputError: if it is inside this body.
        """

    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """The free fragments that the source sees; one that moves must be frozen."""
        del reference
        if surface.prune and is_zero(self.strength):
            return Omitted("it is switched off at all times")
        if surface.prune and is_zero(surface.absorptivity):
            return Omitted("the surface has absorptivity 0")
        acts = surface.acted_on(None)
        if isinstance(acts, Omitted):
            return acts
        self.check_place(surface)
        exposure = self.exposure(
            surface.scene_triangles, surface.position, surface.normal, surface.pitch
        )
        lit = acts & (exposure > 0)
        if surface.prune and not lit.any():
            return Omitted("no surface of this body sees it")
        share = surface.absorptivity * exposure.astype(surface.dtype)
        law = ImposedFlux(for_jit(self.strength, surface.dtype))
        return (binding(share * surface.area, law, lit),)


class Sun(AbstractSource):
    """Parallel rays with shadows: X = max(0, -d . n) s, lit share s."""

    direction: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """The way the rays travel, any length; or a function of time [s] that gives it."""
    irradiance: Any
    """E on a surface that faces the rays [W/m^2]; a number or a function of time."""

    def __check_init__(self):
        self.check_given(placed(self.direction, 0.0), "Sun(direction=)")
        check_value(self.irradiance, "Sun(irradiance [W/m^2])", 0.0)

    @property
    def name(self) -> str:
        """In the ledger."""
        return "sun"

    @property
    def strength(self) -> Any:
        """Its irradiance [W/m^2]."""
        return self.irradiance

    @property
    def values(self) -> tuple[Any, ...]:
        """Its irradiance."""
        return (self.irradiance,)

    @property
    def place(self) -> str:
        """Its direction."""
        return "direction"

    def check_given(self, value: Any, what: str) -> None:
        """Refuse what is no direction."""
        unit_vector(value, what)

    def check_place(self, surface: Surface) -> None:
        """It is nowhere."""

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Lambert's cosine times the lit share of surface points: 0 to 1."""
        cosine = np.maximum(0.0, -normal @ unit_vector(self.direction))
        return cosine * lit_share(triangles, position, normal, self.direction, pitch)

    def forcing(self, end: float | int) -> Forcing:
        """An imposed heat flux [W/m^2]."""
        return Forcing(heat_flux=largest(self.irradiance, end))


def placed(value: Any, time: float) -> Any:
    """A place or direction at `time` [s], whether it is one or a function of time."""
    return value(time) if callable(value) else value


def triple(value: Any) -> Triple:
    """Three numbers that are known to be such."""
    x, y, z = (float(number) for number in np.asarray(value, float))
    return x, y, z


def check_point(value: Any, what: str) -> None:
    """Refuse what is no point in space.

    Raises:
        InputError: naming `what`.
    """
    try:
        point = np.asarray(value, float)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"{what} {value!r}: give three finite numbers, in metres")


def inside_body(
    surface: Surface, points: Float[np.ndarray, "p 3"]
) -> Bool[np.ndarray, " p"]:
    """Which world points [m] lie in a solid voxel of a body."""
    grid = surface.grid
    cells = np.floor(grid.lattice.to_cells(surface.pose.unplace(points))).astype(int)
    within = ((cells >= 0) & (cells < grid.lattice.shape)).all(1)
    found = np.zeros(len(points), bool)
    found[within] = grid.solid[tuple(cells[within].T)]
    return found


# A small source near by: irradiance I cos / R^2, with the shadows of one point.
#
# E = I max(0, L . n) s / max(R, R_0)^2: radiant intensity I [W/sr], the unit vector L
# to the source, lit share s, distance R, and the least distance R_0 from which on a
# real source is no point any more. The thesis' eq. 3 leaves the distance out.


class PointSource(AbstractSource):
    """Rays from one point, the same in all directions, with shadows."""

    position: Triple | Callable[[float], Any] = eqx.field(
        static=True, converter=fixed_or_moving
    )
    """World [m]; or a function of time [s] that gives it."""
    radiant_intensity: Any
    """I [W/sr], the power over 4 pi; a number or a function of time."""
    min_distance: float = eqx.field(static=True, default=0.01)
    """R_0 [m]: nearer surfaces get what there is at this distance."""

    def __check_init__(self):
        check_point(placed(self.position, 0.0), "PointSource(position=)")
        what = "PointSource(radiant_intensity [W/sr])"
        check_value(self.radiant_intensity, what, 0.0)
        if not (np.isfinite(self.min_distance) and self.min_distance > 0):
            raise InputError(
                f"PointSource(min_distance={self.min_distance!r}): "
                "give a positive length in metres"
            )

    @property
    def name(self) -> str:
        """In the ledger."""
        return "point_source"

    @property
    def strength(self) -> Any:
        """Its radiant intensity [W/sr]."""
        return self.radiant_intensity

    @property
    def values(self) -> tuple[Any, ...]:
        """Its radiant intensity."""
        return (self.radiant_intensity,)

    @property
    def place(self) -> str:
        """Its position."""
        return "position"

    def check_place(self, surface: Surface) -> None:
        """Refuse a source inside a body.

        Raises:
            InputError: if it is.
        """
        if inside_body(surface, np.asarray(self.position, float)[None]).any():
            raise InputError(
                f"PointSource(position={self.position}): is inside body "
                f"{surface.body}; move it out of the body"
            )

    def exposure(
        self,
        triangles: Float[np.ndarray, "f 3 3"],
        position: Float[np.ndarray, "s 3"],
        normal: Float[np.ndarray, "s 3"],
        pitch: float,
    ) -> Float[np.ndarray, " s"]:
        """Cosine times lit share over the square of the distance [1/m^2]."""
        eye = np.asarray(self.position, float)
        away = eye - position
        distance = np.linalg.norm(away, axis=1)
        floored = np.maximum(distance, self.min_distance)
        along = np.einsum("ij,ij->i", normal, away) / np.where(
            distance > 0, distance, 1
        )
        found = np.maximum(0.0, along) / (floored * floored)
        faces = np.flatnonzero(found > 0)
        found[faces] *= lit_share_from(
            triangles, position[faces], normal[faces], eye, pitch
        )
        return found

    def forcing(self, end: float | int) -> Forcing:
        """The heat flux at the least distance [W/m^2]."""
        most = largest(self.radiant_intensity, end)
        return Forcing(heat_flux=most / (self.min_distance * self.min_distance))
