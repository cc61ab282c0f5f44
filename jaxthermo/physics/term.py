"""Mechanisms of heat transfer: what a user writes, and what it becomes when bound.

A term is bound once, to the surface of the whole scene. Each binding is an effective
area of every surface fragment and a law, the heat flux into a unit of that area. Where
a term cannot act it is `Omitted` with the reason, and the compiled program has no trace
of it. The four kinds of term, by what they exchange heat with:

| kind | acts on | example |
|---|---|---|
| `AbstractSurfaceTerm` | every piece of surface by itself | `Convection` |
| `AbstractExchangeTerm` | pieces of surface that see each other | `RadiativeExchange` |
| `AbstractVolumeTerm` | the inside of bodies | `HeatSource` |
| `AbstractPairTerm` | two bodies that touch | `Contact` |
"""

import abc
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..arrays import Scalar, is_traced
from ..errors import InputError
from ..geometry.mesh import Pose
from ..voxels.grid import VoxelGrid
from ..voxels.selection import AbstractSelection
from .flux_law import AbstractFluxLaw, Forcing, Values


# Type checkers know a class variable by its name in the module alone.
if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

# Not `Self`, which the type checks of the tests take on decorated classes only.
_Term = TypeVar("_Term", bound="AbstractTerm")


class Omitted(NamedTuple):
    """The reason why a term does not act on a body; on any of them if none is named."""

    reason: str
    body: int | None = None


class Scale(NamedTuple):
    """Size of a term, for the Biot number and the heating of a scene."""

    heat_flux: float = 0.0
    """[W/m^2]"""
    heat_transfer_coefficient: float = 0.0
    """[W/(m^2 K)]"""


class Binding(NamedTuple):
    """A law on the surface of the scene."""

    effective_area: Float[Values, " s"]
    """As in `BoundTerm`, per fragment."""
    acts: Bool[np.ndarray, " s"]
    """False where the effective area is 0; known even where the area is traced."""
    law: AbstractFluxLaw
    notes: tuple[tuple[int, str], ...] = ()
    """Remarks on the validity of the law, by body, for the receipt."""


@dataclass(frozen=True, eq=False)
class BodySurface:
    """The surface fragments of one body at its present pose."""

    body: int
    """Number of the body in the scene."""
    grid: VoxelGrid
    """In the body's own frame, which `Side` and `Region` refer to."""
    pose: Pose
    position: Float[np.ndarray, "s 3"]
    """World [m]."""
    normal: Float[np.ndarray, "s 3"]
    """World, outward."""
    area: Float[np.ndarray, " s"]
    """True area that nothing touches [m^2]."""
    exposed_fraction: Float[np.ndarray, " s"]
    """Fraction of each fragment that nothing touches [-]."""
    natural: Bool[np.ndarray, " s"]
    """Fragments with a natural boundary: exposed, no temperature prescribed."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    emissivity: Float[Values, "*#s"]
    absorptivity: Float[Values, "*#s"]
    scene_triangles: Float[np.ndarray, "f 3 3"]
    """Triangles of every body, world [m]: what may cast a shadow."""
    dtype: Any
    enclosed: Bool[np.ndarray, " s"] | None = None
    """Fragments in a closed cavity, which nothing from outside reaches, if any."""
    prune: bool = True
    """False to keep terms that have no effect, for tests."""

    @property
    def pitch(self) -> float:
        """Edge of a voxel [m]."""
        return self.grid.pitch

    @property
    def own_position(self) -> Float[np.ndarray, "s 3"]:
        """In the body's own frame [m]."""
        return self.grid.fragment_position

    @property
    def own_normal(self) -> Float[np.ndarray, "s 3"]:
        """In the body's own frame, outward."""
        return self.grid.fragment_normal

    def omitted(self, reason: str) -> Omitted:
        """An omission on this body."""
        return Omitted(reason, self.body)

    def selected(self, on: AbstractSelection | None) -> Bool[np.ndarray, " s"]:
        """Fragments that `on` selects; all of them for None.

        Raises:
            InputError: if it names this body and selects none of its surface.
        """
        if on is None:
            return np.ones(len(self.own_position), bool)
        own = on.on_body(self.body)
        if own is None:
            return np.zeros(len(self.own_position), bool)
        chosen = own.select(self.own_position, self.own_normal)
        if not chosen.any():
            raise InputError(
                f"on={own!r} selects no surface of body {self.body}: check its corners "
                "or its normal, which are in the body's own frame, in metres"
            )
        return chosen

    def exposed(
        self, on: AbstractSelection | None = None
    ) -> Bool[np.ndarray, " s"] | Omitted:
        """Selected fragments that have a natural boundary."""
        # The reasons are those of the receipt, in the order that a user would check.
        chosen = self.selected(on)
        if self.prune and not chosen.any():
            return self.omitted("`on` is on another body")
        if self.prune and not (chosen & self.natural).any():
            closed = "" if self.enclosed is None else " or lies in a closed cavity"
            return self.omitted(f"all of its surface is held at a temperature{closed}")
        return chosen & self.natural


Cover = tuple[Float[Values, " _"], Bool[np.ndarray, " _"]]
# Effective area of the fragments of one body, and where it may be other than 0.


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a scene: the fragments of all bodies, one body after the other."""

    bodies: tuple[BodySurface, ...]
    references: tuple[Scalar, ...]
    """Temperature from which the state of each body counts [K]."""
    temperatures: Forcing | None = None
    """Bounds of all temperatures up to `end`; None if they are not known."""
    end: float | int = 0.0
    """End of the run [s]."""

    @property
    def dtype(self) -> Any:
        """Type of the state."""
        return self.bodies[0].dtype

    @property
    def prune(self) -> bool:
        """False to keep terms that have no effect, for tests."""
        return self.bodies[0].prune

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of fragments of each body."""
        return tuple(len(body.area) for body in self.bodies)

    @cached_property
    def body(self) -> Int[np.ndarray, " s"]:
        """Number of the body of each fragment."""
        return np.repeat(np.arange(len(self.bodies)), self.counts)

    @cached_property
    def outside(self) -> "Surface":
        """The surface without closed cavities, for terms from outside."""
        if all(body.enclosed is None for body in self.bodies):
            return self
        bodies = tuple(
            body
            if body.enclosed is None
            else dataclasses.replace(body, natural=body.natural & ~body.enclosed)
            for body in self.bodies
        )
        return dataclasses.replace(self, bodies=bodies)

    @property
    def reference(self) -> Float[Values, "*#s"]:
        """Reference temperature per fragment [K]; one number if all are equal."""
        return spread(self.references, self.counts, self.dtype)

    def apart(self, values: Any) -> list[Any]:
        """Values of each body's fragments, which are on the last axis."""
        # Traced values, such as a fitted emissivity, stay on the device.
        ends = np.cumsum(self.counts)[:-1]
        own: Any = jnp if is_traced(values) else np
        return own.split(values, ends, axis=-1)

    def bind(
        self,
        law: AbstractFluxLaw,
        covers: Sequence[Cover | Omitted] | None = None,
        on: AbstractSelection | None = None,
        notes: tuple[tuple[int, str], ...] = (),
    ) -> tuple[Binding | Omitted, ...]:
        """A law bound to the fragments where it acts, and the bodies without it.

        Args:
            law: for all bodies.
            covers: effective area of each body's fragments, and where they act; None
                for the exposed area that `on` selects.
            on: a selection of the surface; None for all of it.
            notes: on the validity of the law, by body.
        """
        if covers is None:
            found = [(body, body.exposed(on)) for body in self.bodies]
            covers = [e if isinstance(e, Omitted) else (b.area, e) for b, e in found]
        omitted = [cover for cover in covers if isinstance(cover, Omitted)]
        # Several snapshots need the same bindings, whether they act or not.
        if self.prune and len(omitted) == len(self.bodies):
            return tuple(omitted)
        # Bodies without the term have no area: one law and one array for the scene.
        areas, acts = [], []
        for body, cover in zip(self.bodies, covers, strict=True):
            nowhere = np.zeros(len(body.area), bool)
            area, where = (body.area, nowhere) if isinstance(cover, Omitted) else cover
            own: Any = jnp if is_traced(area) else np
            areas.append(own.where(where, area, own.zeros_like(area)))
            acts.append(where)
        binding = Binding(
            concatenated(areas), np.concatenate(acts), law.above(self.reference), notes
        )
        return (binding, *omitted)


def spread(values: Sequence[Any], counts: Sequence[int], dtype: Any) -> Any:
    """Values of bodies at each of their cells; one number where all are equal."""
    # One number where bodies count from one temperature: no array for the time loop.
    same = not is_traced(values) and len({float(value) for value in values}) == 1
    if same or len(values) == 1:
        return jnp.asarray(values[0], dtype)
    pairs = zip(values, counts, strict=True)
    return jnp.concatenate([jnp.full(n, jnp.asarray(v, dtype)) for v, n in pairs])


def concatenated(values: Sequence[Any], axis: int = -1) -> Any:
    """Arrays one after the other, on the host where none is traced."""
    if len(values) == 1:
        return values[0]
    return (jnp if is_traced(values) else np).concatenate(values, axis)


class AbstractTerm(eqx.Module):
    """A mechanism of heat transfer in a scene.

    Do not derive from this class, but from one of the four kinds of term.
    """

    name: AbstractClassVar[str]
    """Name of the mechanism in the energy ledger and in the receipt."""
    is_convective: ClassVar[bool] = False
    """True for convection, whose h adds to a surface's heat transfer coefficient."""

    @property
    def values(self) -> tuple[Any, ...]:
        """Its values that may be functions of time: all fields that are traced."""
        given = (
            getattr(self, field.name)
            for field in dataclasses.fields(self)
            if not field.metadata.get("static")
        )
        # Selections of a surface or a volume never change with time.
        where = AbstractSelection
        return tuple(v for v in given if v is not None and not isinstance(v, where))

    @property
    def temperatures(self) -> dict[str, Any]:
        """Its temperatures by the names of their fields [K], which scenes check."""
        names = ("temperature", "ground")
        given = {name: getattr(self, name, None) for name in names}
        return {name: value for name, value in given.items() if value is not None}

    def forcing(self, end: float | int) -> Forcing:
        """Bounds of its effect on temperatures up to `end` [s].

        A term that heats bodies must override this: the bounds limit explicit steps.
        """
        return Forcing()

    def scale(self, material: Any, kelvin: float, end: float) -> Scale:
        """Its size on a body, for dimensionless groups.

        Args:
            material: of the body.
            kelvin: its temperature [K].
            end: of the run [s].
        """
        return Scale()

    @property
    def named_bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that it names; none if it acts on all."""
        chosen = getattr(self, "on", None)
        return () if chosen is None else chosen.bodies

    @property
    def moves(self) -> bool:
        """True if the geometry of its action changes with time."""
        return False

    def at(self: _Term, time: float) -> _Term:
        """The term at a moment [s], with a geometry that does not change."""
        return self


class AbstractSurfaceTerm(AbstractTerm):
    """A mechanism that acts on every piece of surface by itself.

    Implement `name` and `bind`, and `forcing` if it can heat a body. With them the term
    takes part in every solver, in the energy ledger and in the receipt.
    """

    is_dirichlet: ClassVar[bool] = False
    """True if it prescribes the temperature of the surface, as no other term."""
    from_outside: ClassVar[bool] = False
    """True if it comes from outside all bodies: it does not act in closed cavities."""

    @abc.abstractmethod
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        """Its laws on the surface of a scene, as `Surface.bind` makes them."""


class AbstractExchangeTerm(AbstractSurfaceTerm):
    """Exchange between pieces of surface; its law receives an irradiation."""

    @abc.abstractmethod
    def enclosure(self, surface: Surface) -> tuple[Any, Any]:
        """The exchange between all fragments of the scene.

        With it comes what the receipt says of its accuracy: the `note` of an object
        with an `error`.
        """


class AbstractVolumeTerm(AbstractTerm):
    """A mechanism that releases heat inside bodies."""

    @abc.abstractmethod
    def bind(self, structure: Any, body: int) -> Any:
        """The nodes of one body that it heats, as a `VolumeBinding`, or `Omitted`."""


class AbstractPairTerm(AbstractTerm):
    """A mechanism that carries heat between two bodies that touch."""

    @property
    @abc.abstractmethod
    def max_gap(self) -> float | None:
        """Widest gap that counts as contact [m]; None for a voxel of the finer body."""

    @abc.abstractmethod
    def connects(self, a: int, b: int) -> bool:
        """True if it acts between these two bodies."""

    @property
    @abc.abstractmethod
    def is_idle(self) -> bool:
        """True if it is known to carry no heat; the surfaces are then insulated."""

    @abc.abstractmethod
    def bind(self, pairs: Any, ends: tuple[Any, Any], entry: int, size: int) -> Any:
        """Its conductances between the fragments of two bodies that touch.

        Args:
            pairs: the touching fragments, `ContactPairs`.
            ends: the prepared bodies.
            entry: number in the energy ledger.
            size: length of the arrays, at least the number of pairs.
        """
