"""A finished run, shown at any time between its first and last saved one."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array
from typing_extensions import override

from ..errors import InputError
from ..integrate.run.abstract_solution import StoredSolution
from ..physics.radiation.irradiation import Irradiance
from ..physics.term import AbstractTerm
from ..scene.scene import SolvedSurface
from .live_run import AbstractLiveRun, Curves


class Playback(AbstractLiveRun):
    """Saved temperatures, linear in time between saved times.

    Raises:
        InputError: for a run with less than two saved times, in which nothing moves.
    """

    def __init__(self, stored: StoredSolution):
        self._stored = stored
        self.times: Float[np.ndarray, " t"] = np.asarray(stored.times, float)
        if len(self.times) < 2:
            raise InputError(
                "play: the run saved one time only; simulate it with more, such as "
                "--set 'time={end: 10 min, save_every: 10 s}'"
            )
        self._kelvin = np.asarray(stored.surface_temperature)
        self._time = float(self.times[0])

    @property
    @override
    def surfaces(self) -> tuple[SolvedSurface, ...]:
        return self._stored.surfaces

    @property
    @override
    def terms(self) -> tuple[AbstractTerm, ...]:
        return self._stored.terms

    @property
    @override
    def start(self) -> float:
        return float(self.times[0])

    @property
    @override
    def end(self) -> float:
        return float(self.times[-1])

    @property
    @override
    def time(self) -> float:
        return self._time

    @property
    @override
    def temperature(self) -> Float[np.ndarray, " s"]:
        return self._between(self._kelvin)

    @override
    def irradiance(self) -> Irradiance:
        irradiances = self._stored.irradiances
        assert irradiances is not None
        return Irradiance(*(self._between(np.asarray(rows)) for rows in irradiances))

    @override
    def advance_to(self, time: float, budget: float = 0.0) -> None:
        del budget
        self.seek(time)

    @override
    def reset(self) -> None:
        self.seek(self.start)

    def seek(self, time: float) -> None:
        """Show a time [s], or the nearest one that the run has."""
        self._time = min(max(time, self.start), self.end)

    @override
    def curves(self, weights: csr_array) -> Curves:
        return Curves(self.times, weights @ self._kelvin.T)

    def _between(self, rows: np.ndarray) -> np.ndarray:
        upper = int(np.searchsorted(self.times, self._time).clip(1, len(rows) - 1))
        first, last = self.times[upper - 1 : upper + 1]
        fraction = np.asarray((self._time - first) / (last - first), rows.dtype)
        return rows[upper - 1] + fraction * (rows[upper] - rows[upper - 1])
