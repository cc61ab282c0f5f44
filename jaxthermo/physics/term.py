"""What a mechanism at the surface is, before and after it meets a body.

A term is what the user writes. Bound to a body it keeps only the arrays it needs and
gives a heat rate per fragment; a term that can do nothing there binds to `LeftOut`
with the reason, and no trace of it is in the compiled program.
"""

import abc
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ..array_types import Scalar
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
    conductivity: Float[Array, "*s"]
    """Of the node under each fragment [W/(m K)]; one number for one material."""
    emissivity: Float[Array, "*s"]
    absorptivity: Float[Array, "*s"]
    scene_triangles: Float[np.ndarray, "f 3 3"]
    """Every body's triangles, world [m]: what may cast a shadow."""
    dtype: Any

    def chosen(self, on: AbstractSelection | None) -> Int[np.ndarray, " m"] | None:
        """Fragments that `on` selects; None for all of them."""
        if on is None:
            return None
        if on.body != self.body:
            return np.zeros(0, np.int64)
        return np.flatnonzero(on.chooses(self.own_position, self.own_normal))


class LeftOut(NamedTuple):
    """Why a term has no part in the program."""

    why: str


class Drive(NamedTuple):
    """What bounds the temperatures that a term can bring about."""

    temperature: Any = 0.0
    """The highest temperature it drives a body towards [K]; 0 for none."""
    heat_flux: Any = 0.0
    """The highest heat flux it imposes whatever the temperature [W/m^2]."""


class AbstractBoundTerm(eqx.Module):
    """A term on one body: heat rates of `fragments` (all of them if None)."""

    fragments: eqx.AbstractVar[Int[Array, " m"] | None]

    @abc.abstractmethod
    def heat_rate(
        self, time: Float[Array, ""], theta: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """Heat into each fragment [W] at temperatures `theta` above the reference."""

    @abc.abstractmethod
    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, "*m"]:
        """Largest -d(heat rate)/dT of each fragment below `hottest` [K] up to `end`.

        It adds to a node's conductances in the stable explicit step [W/K].
        """


class AbstractTerm(eqx.Module):
    """A mechanism as the user writes it."""

    @abc.abstractmethod
    def bind(self, surface: Surface, reference: Scalar) -> AbstractBoundTerm | LeftOut:
        """This term on one body whose state counts from `reference` [K]."""

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
