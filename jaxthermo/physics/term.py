"""Mechanisms of heat transfer, as users write them and as they are bound to a scene.

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
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from equinox import Module
from jaxtyping import Bool, Float

from ..structures.structure import AbstractStructure
from ..voxels.selection import AbstractSelection
from .flux_law import Forcing
from .surface import Binding, BodySurface, Omitted, Surface


# Type checkers know a class variable by its name in the module alone.
if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

# Not `Self`, which the type checks of the tests take on decorated classes only.
_Term = TypeVar("_Term", bound="AbstractTerm")


# Snapshots of a run in which a term moves by a function of time.
_SNAPSHOTS = 64


class Scale(NamedTuple):
    """Size of a term, for the Biot number and the heating of a scene."""

    heat_flux: float = 0.0
    """[W/m^2]"""
    heat_rate_density: float = 0.0
    """[W/m^3]"""
    heat_transfer_coefficient: float = 0.0
    """[W/(m^2 K)]"""


class OperatingPoint(NamedTuple):
    """Body and run for which the size of a term is estimated."""

    material: Any
    """Material of the body."""
    kelvin: float
    """Temperature of the body [K]."""
    end: float
    """End of the run [s]."""
    structures: tuple[AbstractStructure, ...]
    """Structures of all bodies of the scene."""


class AbstractTerm(Module):
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
        # Selections of a surface or a volume never change with time.
        constant = AbstractSelection | None
        values = []
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not field.metadata.get("static") and not isinstance(value, constant):
                values.append(value)
        return tuple(values)

    @property
    def temperatures(self) -> dict[str, Any]:
        """Its temperatures by the names of their fields [K], which scenes check."""
        names = ("temperature", "ground")
        values = {name: getattr(self, name, None) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def forcing(self, end: float | int) -> Forcing:
        """Bounds of its effect on temperatures up to `end` [s].

        A term that exchanges heat with something of another temperature must override
        this: the bounds limit explicit steps. Heat that it imposes at any temperature
        is the `imposed_flux` of its law.
        """
        return Forcing()

    def scale(self, point: OperatingPoint) -> Scale:
        """Its size on a body, for dimensionless groups."""
        return Scale()

    @property
    def by_numbers(self: _Term) -> _Term:
        """The term with its numbers in fields that may be traced."""
        return self

    @property
    def chooses_law(self) -> bool:
        """True if its kind of law depends on its numbers, which must then be known."""
        return False

    @property
    def named_bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that it names; none if it acts on all."""
        selection = getattr(self, "on", None)
        return () if selection is None else selection.bodies

    @property
    def moves(self) -> bool:
        """True if the geometry of its action changes with time."""
        return False

    def snapshot_times(self, end: float | int) -> tuple[float, ...]:
        """Times up to `end` [s] at which its geometry is recomputed, if it moves."""
        return tuple(end * k / _SNAPSHOTS for k in range(1, _SNAPSHOTS))

    def at(self: _Term, time: float) -> _Term:
        """The term at a moment [s], with a geometry that does not change."""
        return self


class AbstractSurfaceTerm(AbstractTerm):
    """A mechanism that acts on every piece of surface by itself.

    Implement `name` and `bind`, and `forcing` if it can heat a body. With them the term
    takes part in every solver, in the energy ledger and in the receipt.
    """

    is_dirichlet: ClassVar[bool] = False
    """True if it prescribes the temperature of the surface."""
    from_outside: ClassVar[bool] = False
    """True if it comes from outside all bodies: it does not act in closed cavities."""

    @abc.abstractmethod
    def bind(self, surface: Surface) -> tuple[Binding | Omitted, ...]:
        """Its laws on the surface of a scene, as `Surface.bind` makes them."""

    def acting_fraction(
        self, body: BodySurface
    ) -> Float[np.ndarray, " s"] | Bool[np.ndarray, " s"] | float:
        """Fraction of each fragment of a body that it acts on, where it acts."""
        selection = getattr(self, "on", None)
        # A temperature is prescribed on whole fragments.
        if selection is None or self.is_dirichlet:
            return 1.0
        return body.selected_fraction(selection)


class AbstractExchangeTerm(AbstractSurfaceTerm):
    """Exchange between pieces of surface; its law receives an irradiation."""

    @abc.abstractmethod
    def enclosure(self, surface: Surface) -> tuple[Any, Any]:
        """The exchange between all fragments of the scene.

        The second result is for the receipt: an object with the `error` of the
        exchange and a `note` on it.
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
        """Widest gap over which bodies count as touching [m]; None for a default."""

    @abc.abstractmethod
    def touching(self, bodies: tuple[Any, ...]) -> dict[tuple[int, int], Any]:
        """Pairs i < j of all placed bodies that touch, and where."""

    @abc.abstractmethod
    def connects(self, a: int, b: int) -> bool:
        """True if it acts between these two bodies."""

    @property
    @abc.abstractmethod
    def is_idle(self) -> bool:
        """True if it is known to carry no heat; the surfaces are then insulated."""

    @abc.abstractmethod
    def bind(self, joints: Sequence[Any], ends: tuple[Any, Any]) -> Any:
        """Its conductances between the fragments of bodies that touch.

        Args:
            joints: pairs of bodies, as `Joint`.
            ends: both prepared groups of bodies, which may be the same one.
        """
