"""Interface of a run that a live view shows: a simulation, or a finished run."""

import abc
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from ..physics.radiation.irradiation import Irradiance
from ..physics.term import AbstractTerm
from ..scene.scene import SolvedSurface


class Curves(NamedTuple):
    """Temperatures of points of the surface over the times that are stored."""

    times: Float[np.ndarray, " t"]
    """[s]"""
    kelvin: Float[np.ndarray, "p t"]


class AbstractLiveRun(abc.ABC):
    """Bodies whose surface temperatures change with a time that can be moved."""

    @property
    @abc.abstractmethod
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        """Surfaces of the bodies; where they move, with their motion."""

    @property
    @abc.abstractmethod
    def terms(self) -> tuple[AbstractTerm, ...]:
        """Terms that act on them now."""

    @property
    @abc.abstractmethod
    def time(self) -> float:
        """Time that is shown [s]."""

    @property
    def start(self) -> float:
        """First time [s]."""
        return 0.0

    @property
    @abc.abstractmethod
    def end(self) -> float:
        """Last time [s]."""

    @property
    def finished(self) -> bool:
        """True at the end."""
        return self.time >= self.end

    @property
    @abc.abstractmethod
    def temperature(self) -> Float[np.ndarray, " s"]:
        """Temperature of every fragment now, bodies one after the other [K]."""

    @abc.abstractmethod
    def irradiance(self) -> Irradiance:
        """Radiation that reaches every fragment now [W/m^2]."""

    @abc.abstractmethod
    def advance_to(self, time: float, budget: float) -> None:
        """Move on to a later time [s], at most for `budget` seconds of work.

        The time that it reaches may be up to one step earlier.
        """

    @abc.abstractmethod
    def reset(self) -> None:
        """Go back to the start."""

    @abc.abstractmethod
    def curves(self, weights: csr_array) -> Curves:
        """Temperatures of points so far, from their weights [p, s] of fragments."""
