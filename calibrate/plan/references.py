"""References of a plan: runs in ever finer voxels, with their errors and their times.

The error of a reference is taken as the larger of Richardson's estimate and its
difference from the run in voxels twice as large, which is its error if errors fall with
the first order. Errors in the position of a surface do; a higher order that three runs
show may be chance.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from jaxthermo.accuracy.discretization_error import (
    DiscretizationError,
    discretization_error,
)
from jaxthermo.accuracy.error_records import ReferenceErrors
from jaxthermo.accuracy.truth_error import TruthPoints, truth_points
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution

from ..config.schema import RefinedReference
from ..problem.reference import COARSENING, RunCost, refined_run
from .candidate import Candidate
from .predict import Size, expected_nodes
from .tolerance import Tolerance


POINTS = 4000
"""Points on the meshes at which temperatures are compared."""

SETTINGS = RefinedReference.model_validate(
    {
        "refinement": 1.0,
        "structure": {"kind": "aggregate", "factor": 2},
        "points": POINTS,
    }
)
"""Runs of blocks, which are as accurate as their voxels with an eighth of the nodes."""

_FIRST_VOXELS = 24_000
"""Voxels of the first reference; two coarser runs show its error."""

_MOST_NODES = 3e6
"""Nodes of the finest reference."""

_CONVERGED = 2000
"""Steps of a run whose error in time is controlled, for predictions."""

_RUNS = 3
"""Runs that an error follows from."""

_ORDER = 1.0
"""Order at which errors of references are expected to fall."""

_LOG_TIMES = np.log([5.0, 2e-6])
"""Logarithms of the times that a run takes, whatever its size, and over
nodes^(4/3) [s]."""
_TIME_SPREAD = 1.0
"""Standard deviation of those logarithms [-]."""
_TIME_NOISE = 0.3
"""Relative standard deviation of a measured time [-]."""


class Expected(NamedTuple):
    """Size and time of a reference before it is run."""

    refinement: float
    nodes: int
    seconds: float


class Reference(NamedTuple):
    """A run of finer voxels that candidates are compared with."""

    refinement: float
    points: TruthPoints
    """Its temperatures at points of the meshes."""
    own_error: ReferenceErrors
    """Richardson's estimate of its error, as of `DiscretizationError`."""
    percent: float
    """Error that it is taken to have, over its range [%]."""
    kelvin: float
    """Error that it is taken to have [K]."""
    excess: float
    """That error over the tolerance [-]."""
    cost: RunCost
    coarser: tuple[tuple[Candidate, float], ...]
    """Blocks from which its error follows, and their errors over the tolerance [-]."""

    @property
    def allowed(self) -> float:
        """Largest difference of a candidate from it, over the tolerance [-].

        A candidate is off by at most the sum of its difference and the reference's
        error. The root of the sum of their squares would not do: blocks and voxels of
        both are off in the same direction.
        """
        return max(0.0, 1.0 - self.excess)


class _Run(NamedTuple):
    refinement: float
    solution: StoredSolution
    cost: RunCost


class References:
    """The runs of a plan from coarse to fine, of which the finest is its reference."""

    def __init__(
        self,
        scene: SceneConfig,
        pitches: tuple[float, ...],
        tolerance: Tolerance,
        size: Size,
    ):
        """Nothing is run yet.

        Args:
            scene: config of the scene's file.
            pitches: of its bodies [m].
            tolerance: that errors are compared with.
            size: of the bodies.
        """
        self._scene = scene
        self._pitches = pitches
        self._tolerance = tolerance
        self.size = size
        self._runs: list[_Run] = []
        self._times: list[tuple[int, float]] = []
        self.latest: Reference | None = None
        # In powers of two: the user's own pitch is among the candidates.
        first = 2.0 ** round(math.log2(2 / size.edge_of(_FIRST_VOXELS // 8)))
        self._next_refinement = first / COARSENING ** (_RUNS - 1)

    def planned(self) -> list[Expected]:
        """Runs that are left, up to the finest that is possible."""
        planned = []
        refinement = self._next_refinement
        while self._nodes(refinement) <= _MOST_NODES:
            planned.append(self._expected(refinement))
            refinement *= COARSENING
        return planned

    def needed(self, limit: float) -> list[Expected]:
        """Runs that are left until the error is expected to be within a limit.

        Args:
            limit: largest error over the tolerance [-].
        """
        planned = self.planned()
        if self.latest is None:
            return planned[: _RUNS - len(self._runs)]
        halvings = math.log2(max(self.latest.excess / limit, 1.0)) / _ORDER
        return planned[: math.ceil(halvings)]

    def refine(self, log: Callable[[str], None]) -> Reference | None:
        """Run the next one, or load it; None where more runs are needed.

        Args:
            log: called with a line before it is run.

        Raises:
            InputError: if it is too large or cannot be run.
        """
        expected = self._expected(self._next_refinement)
        if expected.nodes > _MOST_NODES:
            raise InputError(f"{expected.nodes:,} nodes are too many")
        try:
            solution, cost = refined_run(
                self._config(expected.refinement),
                settings=SETTINGS,
                log=partial(_announce, log, expected),
            )
        except InputError:
            if self.latest is None:
                # Coarse voxels may have nothing of a thin body, which finer ones have.
                self._runs.clear()
                self._next_refinement *= COARSENING
            raise
        self._next_refinement *= COARSENING
        self._times.append((cost["nodes"], cost["run_time_s"]))
        run = _Run(refinement=expected.refinement, solution=solution, cost=cost)
        self._runs = [*self._runs, run][-_RUNS:]
        if len(self._runs) == _RUNS:
            self.latest = self._reference()
        return self.latest

    def _reference(self) -> Reference:
        coarsest, middle, finest = self._runs
        error = discretization_error(
            finest.solution,
            middle=middle.solution,
            coarsest=coarsest.solution,
            count=POINTS,
            seed=SETTINGS.seed,
        )
        percent, kelvin = counted_error(error)
        # At a time without a difference there is no ratio.
        differs = error.rms_kelvin > 0
        ratios = error.rms_percent[differs] / error.rms_kelvin[differs]
        percent_per_kelvin = float(ratios.max(initial=0.0))
        coarser = []
        for run, difference in zip(
            (middle, coarsest), error.differences.max(axis=0), strict=True
        ):
            blocks = self._blocks(run.refinement)._replace(steps=_CONVERGED)
            excess = self._tolerance.excess(
                percent_per_kelvin * float(difference), kelvin=float(difference)
            )
            coarser.append((blocks, excess))
        return Reference(
            refinement=finest.refinement,
            points=truth_points(finest.solution, POINTS),
            own_error=error.as_dict(),
            percent=percent,
            kelvin=kelvin,
            excess=self._tolerance.excess(percent, kelvin=kelvin),
            cost=finest.cost,
            coarser=tuple(coarser),
        )

    def _config(self, refinement: float) -> SceneConfig:
        # By its pitch: a refinement below 1 is allowed here.
        full = Candidate(refinement, "full_volume")
        return full.applied(self._scene, self._pitches)

    def _expected(self, refinement: float) -> Expected:
        nodes = self._nodes(refinement)
        seconds = expected_seconds(nodes, self._times)
        return Expected(refinement=refinement, nodes=round(nodes), seconds=seconds)

    def _nodes(self, refinement: float) -> float:
        return expected_nodes(self._blocks(refinement), self.size)

    def _blocks(self, refinement: float) -> Candidate:
        """A reference as a candidate; in it, cells of sheets are as large as blocks."""
        if self.size.is_of_sheets:
            return Candidate(refinement / 2, "sheet")
        return Candidate(refinement, "aggregate", 2)


def counted_error(error: DiscretizationError) -> tuple[float, float]:
    """Error that a reference is taken to have, in percent of its range and in kelvin.

    The larger of Richardson's estimate and of the difference from the next coarser run.
    """
    kelvin = np.maximum(error.rms_kelvin, error.differences[:, 0])
    has_error = error.rms_kelvin > 0
    growth = kelvin[has_error] / error.rms_kelvin[has_error]
    percent = float((growth * error.rms_percent[has_error]).max(initial=0.0))
    return percent, float(kelvin.max())


def expected_seconds(nodes: float, measured: list[tuple[int, float]]) -> float:
    """Time of a reference of so many nodes [s], from those that were run.

    t = a + b N^(4/3): each halving of the voxels makes eight times the nodes, and twice
    the evaluations. Both a and b have priors.

    Args:
        nodes: N.
        measured: nodes and seconds of runs.
    """
    counts = np.array([count for count, _ in measured], float)
    times = np.array([seconds for _, seconds in measured])

    def residuals(logs: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " r"]:
        fixed, growing = np.exp(logs)
        ratios = np.log((fixed + growing * counts ** (4 / 3)) / times)
        return np.concatenate(
            [ratios / _TIME_NOISE, (logs - _LOG_TIMES) / _TIME_SPREAD]
        )

    fixed, growing = np.exp(least_squares(residuals, _LOG_TIMES).x)
    return float(fixed + growing * nodes ** (4 / 3))


def _announce(log: Callable[[str], None], expected: Expected, text: str) -> None:
    log(f"{text}: about {expected.nodes:,} nodes, {about_time(expected.seconds)}")


def about_time(seconds: float) -> str:
    """A rough duration [s]: "about 40 s", "about 12 min"."""
    if seconds < 90:
        return f"about {float(f'{seconds:.1g}'):.0f} s"
    if seconds < 5400:
        return f"about {float(f'{seconds / 60:.2g}'):.0f} min"
    return f"about {seconds / 3600:.2g} h"
