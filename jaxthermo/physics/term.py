"""What a mechanism at the surface is, before and after it meets a body.

A term is what the user writes. Bound to a body it is a share of every surface fragment
and a law, the heat flux into a unit of share; a term that can do nothing there binds to
`Omitted` with the reason, and no trace of it is in the compiled program.
"""

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..arrays import Scalar, is_traced
from ..errors import InputError
from ..geometry.pose import Pose
from ..network.network import precise_sum
from ..voxels.grid import VoxelGrid
from ..voxels.selection import AbstractSelection


Values = Array | np.ndarray
"""Of numpy wherever nothing is traced: it compiles nothing."""


class TemperatureRange(NamedTuple):
    """Temperatures of surfaces, air and surroundings, and times, that a run gets to."""

    lowest: float
    highest: float
    end: float | int


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of one body where the scene has put it, as terms see it."""

    body: int
    grid: VoxelGrid
    """In the body's own frame, which `Side` and `Region` refer to."""
    pose: Pose
    position: Float[np.ndarray, "s 3"]
    """World [m]."""
    normal: Float[np.ndarray, "s 3"]
    """World, outward."""
    area: Float[np.ndarray, " s"]
    """True area [m^2], as far as nothing touches it."""
    exposed_fraction: Float[np.ndarray, " s"]
    """Share of each fragment that nothing touches."""
    natural: Bool[np.ndarray, " s"]
    """Fragments that no term holds at a temperature, and nothing covers."""
    half_cell: Float[Values, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    emissivity: Float[Values, "*s"]
    absorptivity: Float[Values, "*s"]
    scene_triangles: Float[np.ndarray, "f 3 3"]
    """Every body's triangles, world [m]: what may cast a shadow."""
    dtype: Any
    temperature_range: TemperatureRange | None = None
    """What the run can get to, if that is known."""
    prune: bool = True
    """Whether terms that do nothing are left out: they are, but for comparison."""

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

    def chosen(self, on: AbstractSelection | None) -> Bool[np.ndarray, " s"]:
        """Fragments that `on` selects; all of them for None.

        Raises:
            InputError: if it is meant for this body and selects none of it.
        """
        if on is None:
            return np.ones(len(self.own_position), bool)
        if on.body != self.body:
            return np.zeros(len(self.own_position), bool)
        chosen = on.chooses(self.own_position, self.own_normal)
        if not chosen.any():
            raise InputError(
                f"on={on!r} selects no surface of body {self.body}: check its corners "
                "or its normal, which are in the body's own frame, in metres"
            )
        return chosen

    def acted_on(
        self, on: AbstractSelection | None
    ) -> "Bool[np.ndarray, ' s'] | Omitted":
        """The free fragments that `on` selects."""
        chosen = self.chosen(on)
        if self.prune and not chosen.any():
            return Omitted("`on` is on another body")
        if self.prune and not (chosen & self.natural).any():
            return Omitted("all of its surface is held at a temperature")
        return chosen & self.natural


class Omitted(NamedTuple):
    """Why a term has no part in the program."""

    reason: str


class Forcing(NamedTuple):
    """What bounds the temperatures that a term can bring about."""

    temperature: Any = 0.0
    """The highest temperature it drives a body towards [K]; 0 for none."""
    heat_flux: Any = 0.0
    """The highest heat flux it imposes whatever the temperature [W/m^2]."""


class LinearLaw(NamedTuple):
    """A heat flux w d(t) - s theta, with s constant."""

    weight: Any
    """w, a number or one a place."""
    forcing: Any
    """d, a number or a function of time that gives one."""
    slope: Any = None
    """s [W/(m^2 K)], a number or one a place; None for 0."""


class AbstractFluxLaw(eqx.Module):
    """A heat flux into a surface of a given temperature."""

    @abc.abstractmethod
    def flux(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """Into a unit of share, at surface temperatures above the reference."""

    @abc.abstractmethod
    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """-d flux / d theta, never negative."""

    @abc.abstractmethod
    def max_slope(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """The largest slope below `hottest` [K] up to `end` [s]."""

    @property
    @abc.abstractmethod
    def is_linear(self) -> bool:
        """Whether the slope does not depend on the temperature."""

    def linear(self) -> LinearLaw | None:
        """Its parts, where it is linear with a constant slope."""
        return None

    def coarsened(self, mean: Callable[[Array], Array]) -> "AbstractFluxLaw":
        """The law on places that several of these make up.

        A law that holds arrays with a value a place overrides this.

        Args:
            mean: from values a place, on the last axis, to those of the new places.
        """
        del mean
        return self

    def max_flux(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """A bound of |flux| at temperatures and times within `reach`.

        With `curvature` it says how many steps the balance at a surface needs; a law
        that knows neither gets all there are.
        """
        del reach
        return math.inf

    def curvature(self, reach: TemperatureRange) -> float | Float[Array, ""]:
        """A bound of |d2 flux / dT2| there."""
        del reach
        return math.inf

    @property
    def is_dissipative(self) -> bool:
        """Whether `supersolution` bounds the surface's temperature."""
        return False

    def supersolution(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """A temperature above the reference at which it sheds what others push in.

        Newton's method started there or above cannot overshoot. Of laws that shed.

        Args:
            time: [s].
            pushed: heat rate that others impose, for each unit of share.
        """
        del time
        return jnp.full_like(pushed, -jnp.inf)


class BoundTerm(eqx.Module):
    """A law on the places of one body's surface: fragments, or nodes' parts of it."""

    effective_area: Float[Values, " m"]
    """Area times what of the law's flux each place takes; 0 where it does not act."""
    total_effective_area: Float[Values, "*b"]
    """Sum over the places; of a term on the places of several bodies, one a body."""
    law: AbstractFluxLaw

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Heat into each place [W] at surface temperatures above the reference."""
        return jnp.asarray(self.effective_area) * self.law.flux(time, theta)

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """-d heat rate / d theta [W/K]."""
        return jnp.asarray(self.effective_area) * self.law.slope(time, theta)


class Binding(NamedTuple):
    """A term bound to the fragments of a body."""

    term: BoundTerm
    acts: Bool[np.ndarray, " s"]
    """Where its share may be other than 0; known even where the share is traced."""
    notes: tuple[str, ...] = ()
    """What whoever reads the result should know of it, for the receipt."""


def bound(effective_area: Float[Values, " m"], law: AbstractFluxLaw) -> BoundTerm:
    """A law with what of it each place takes."""
    if is_traced(effective_area):
        return BoundTerm(effective_area, precise_sum(jnp.asarray(effective_area)), law)
    host = np.asarray(effective_area)
    return BoundTerm(host, np.asarray(host.sum(dtype=float), host.dtype), law)


def binding(
    effective_area: Float[Values, "*s"],
    law: AbstractFluxLaw,
    acts: Bool[np.ndarray, " s"],
) -> Binding:
    """A law on the fragments where it acts."""
    own = np if not is_traced(effective_area) else jnp
    return Binding(
        bound(own.where(acts, effective_area, own.zeros_like(effective_area)), law),
        acts,
    )


class AbstractTerm(eqx.Module):
    """A mechanism as the user writes it."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Of the mechanism, as in the energy ledger."""

    @property
    @abc.abstractmethod
    def values(self) -> tuple[Any, ...]:
        """Those of its values that may be functions of time."""

    @abc.abstractmethod
    def forcing(self, end: float | int) -> Forcing:
        """The most this term does to a body up to `end` [s]."""

    @property
    def named_bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that it names; none if it acts on all."""
        chosen = getattr(self, "on", None)
        return () if chosen is None else (chosen.body,)

    @property
    def moves(self) -> bool:
        """Whether where it acts changes with time, as of a source that travels."""
        return False

    def at(self, time: float) -> "AbstractTerm":
        """This term as it stands at a moment [s]."""
        del time
        return self


class AbstractSurfaceTerm(AbstractTerm):
    """A mechanism at the surface of each body for itself."""

    @abc.abstractmethod
    def bind(
        self, surface: Surface, reference: Scalar
    ) -> tuple[Binding, ...] | Omitted:
        """This term on the fragments of a body whose state counts from `reference`."""

    @property
    def is_dirichlet(self) -> bool:
        """Whether it holds the surface at a temperature, where no other term acts."""
        return False
