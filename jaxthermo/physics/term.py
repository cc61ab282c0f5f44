"""What a mechanism at the surface is, before and after it meets a body.

A term is what the user writes. Bound to a body it is a share of every surface fragment
and a law, the heat flux into a unit of share; a term that can do nothing there binds to
`LeftOut` with the reason, and no trace of it is in the compiled program.
"""

import abc
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..array_types import Scalar
from ..network.network import precise_sum
from ..voxels.select import AbstractSelection


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of one body where the scene has put it, as terms see it."""

    body: int
    pitch: float
    position: Float[np.ndarray, "s 3"]
    """World [m]."""
    normal: Float[np.ndarray, "s 3"]
    """World, outward."""
    area: Float[Array, " s"]
    """True area [m^2]."""
    own_position: Float[np.ndarray, "s 3"]
    """In the body's own frame [m], which `Side` and `Region` refer to."""
    own_normal: Float[np.ndarray, "s 3"]
    free: Bool[np.ndarray, " s"]
    """Fragments that no term holds at a temperature."""
    half_cell: Float[Array, " s"]
    """Conductance from each fragment to its node, k A / distance [W/K]."""
    emissivity: Float[Array, "*s"]
    absorptivity: Float[Array, "*s"]
    scene_triangles: Float[np.ndarray, "f 3 3"]
    """Every body's triangles, world [m]: what may cast a shadow."""
    dtype: Any

    def chosen(self, on: AbstractSelection | None) -> Bool[np.ndarray, " s"]:
        """Fragments that `on` selects; all of them for None."""
        if on is None:
            return np.ones(len(self.own_position), bool)
        if on.body != self.body:
            return np.zeros(len(self.own_position), bool)
        return on.chooses(self.own_position, self.own_normal)

    def acted_on(
        self, on: AbstractSelection | None
    ) -> "Bool[np.ndarray, ' s'] | LeftOut":
        """The free fragments that `on` selects."""
        chosen = self.chosen(on)
        if not chosen.any():
            return LeftOut("`on` selects no fragment of this body")
        if not (chosen & self.free).any():
            return LeftOut("all of its surface is held at a temperature")
        return chosen & self.free


class LeftOut(NamedTuple):
    """Why a term has no part in the program."""

    why: str


class Drive(NamedTuple):
    """What bounds the temperatures that a term can bring about."""

    temperature: Any = 0.0
    """The highest temperature it drives a body towards [K]; 0 for none."""
    heat_flux: Any = 0.0
    """The highest heat flux it imposes whatever the temperature [W/m^2]."""


class AbstractLaw(eqx.Module):
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
    def steepest(self, hottest: Float[Array, ""], end: float) -> Float[Array, ""]:
        """The largest slope below `hottest` [K] up to `end` [s]."""

    @property
    @abc.abstractmethod
    def is_linear(self) -> bool:
        """Whether the slope does not depend on the temperature."""

    def hot_side(
        self, time: Float[Array, ""], pushed: Float[Array, " m"]
    ) -> Float[Array, "*#m"]:
        """A temperature above the reference at which it sheds what others push in.

        Newton's method started there or above cannot overshoot. Linear laws need none.

        Args:
            time: [s].
            pushed: heat rate that others impose, for each unit of share.
        """
        del time
        return jnp.full_like(pushed, -jnp.inf)


class BoundTerm(eqx.Module):
    """A law on the places of one body's surface: fragments, or nodes' parts of it."""

    share: Float[Array, " m"]
    """Area times what of the law's flux each place takes; 0 where it does not act."""
    total_share: Float[Array, ""]
    law: AbstractLaw

    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Heat into each place [W] at surface temperatures above the reference."""
        return self.share * self.law.flux(time, theta)

    def slope(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """-d heat rate / d theta [W/K]."""
        return self.share * self.law.slope(time, theta)


class Binding(NamedTuple):
    """A term bound to the fragments of a body."""

    term: BoundTerm
    acts: Bool[np.ndarray, " s"]
    """Where its share may be other than 0; known even where the share is traced."""


def bound(share: Float[Array, " m"], law: AbstractLaw) -> BoundTerm:
    """A law with what of it each place takes."""
    return BoundTerm(share, precise_sum(share), law)


def binding(
    share: Float[Array, "*s"], law: AbstractLaw, acts: Bool[np.ndarray, " s"]
) -> Binding:
    """A law on the fragments where it acts."""
    return Binding(bound(jnp.where(acts, share, 0), law), acts)


class AbstractTerm(eqx.Module):
    """A mechanism as the user writes it."""

    @abc.abstractmethod
    def bind(self, surface: Surface, reference: Scalar) -> Binding | LeftOut:
        """This term on the fragments of a body whose state counts from `reference`."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Of the mechanism, as in the energy ledger."""

    @property
    @abc.abstractmethod
    def values(self) -> tuple[Any, ...]:
        """Those of its values that may be functions of time."""

    @abc.abstractmethod
    def drive(self, end: float | int) -> Drive:
        """The most this term does to a body up to `end` [s]."""

    def holds(self, surface: Surface) -> Bool[np.ndarray, " s"] | None:
        """The fragments it holds at a temperature, where no other term matters."""
        del surface
        return None
