"""Trials of a plan: references in ever finer voxels, and candidates."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxthermo.accuracy.error_records import ReferenceErrors
from jaxthermo.accuracy.truth_error import TruthError, TruthPoints, truth_points
from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.plan import Plan
from jaxthermo.integrate.run.simulate import make_solution
from jaxthermo.integrate.run.solution import RESULTS, Observation, run_result
from jaxthermo.integrate.run.solution_file import StoredSolution
from jaxthermo.timing import Spread, interleaved

from ..config.schema import RefinedReference
from ..problem.reference import (
    COARSENING,
    Log,
    RunCost,
    coarser_difference,
    refined_reference,
)
from ..study.case import build_case, plan_case
from ..study.times import Loop, compiled_loop
from .candidate import Candidate
from .predict import Measured


_POINTS = 4000
"""Points on the meshes at which temperatures are compared."""

_REFERENCE_SETTINGS = RefinedReference.model_validate(
    {
        "refinement": 1.0,
        "structure": {"kind": "aggregate", "factor": 2},
        "points": _POINTS,
    }
)
"""References of blocks, which are as accurate as their voxels with an eighth of the
nodes."""

_CONVERGED = 2000
"""Steps of a run whose error in time is controlled, for predictions."""

MAX_OWN_ERROR = 0.5
"""Largest error of the reference itself over the tolerance [-]."""

_SHORT = 0.2
"""Time of a loop up to which it is repeated [s]."""
_REPEATS = 10
"""Number of repeats of a short loop."""

_ORDER = 1.5
"""Order at which a reference's error falls, before three runs show it."""


class Tolerance(NamedTuple):
    """Limits of a plan."""

    percent: float | None = None
    """Largest RMS error over the range of the reference [%]; None for no limit."""
    kelvin: float | None = None
    """Largest RMS error [K]; None for no limit."""
    run_time: float | None = None
    """Longest time of the compiled loop [s]; None for no limit."""
    memory: float | None = None
    """Largest peak memory [bytes]; None for no limit."""

    def affords(self, run_time: float, memory: float | int) -> bool:
        """True if a time [s] and a memory [bytes] are within the limits."""
        in_time = self.run_time is None or run_time <= self.run_time
        return in_time and (self.memory is None or memory <= self.memory)

    def excess(self, percent: float, kelvin: float) -> float:
        """Error over the tolerance [-]: at most 1 within it."""
        ratios = []
        if self.percent is not None:
            ratios.append(percent / self.percent)
        if self.kelvin is not None:
            ratios.append(kelvin / self.kelvin)
        return max(ratios)

    def words(self) -> str:
        """As in a sentence: "1 %, 0.2 K"."""
        limits = []
        if self.percent is not None:
            limits.append(f"{self.percent:.3g} %")
        if self.kelvin is not None:
            limits.append(f"{self.kelvin:.3g} K")
        if self.run_time is not None:
            limits.append(f"{1e3 * self.run_time:.3g} ms")
        if self.memory is not None:
            limits.append(f"{self.memory / 2**20:.4g} MiB")
        return ", ".join(limits)


class Reference(NamedTuple):
    """A run of finer voxels that candidates are compared with."""

    refinement: float
    points: TruthPoints
    """Its temperatures at points of the meshes."""
    own_error: ReferenceErrors
    """Its own error, as of `DiscretizationError`."""
    excess: float
    """That error over the tolerance [-]."""
    cost: RunCost
    coarser: tuple[tuple[Candidate, float], ...]
    """Blocks from which its error follows, and their errors over the tolerance [-]."""

    @property
    def own_percent(self) -> float:
        """Largest of its own errors at the saved times [%]."""
        percents = self.own_error["rms_percent"]
        return max(percent for percent in percents if percent is not None)

    @property
    def allowed(self) -> float:
        """Largest error of a candidate over the tolerance, with the reference's."""
        # Where finer references are too much, the plan says so.
        return math.sqrt(1 - min(self.excess, MAX_OWN_ERROR) ** 2)


TrialRecord = Mapping[str, object]
"""A trial in `plan.json`."""


class Trial(NamedTuple):
    """A candidate that was run, compared with a reference."""

    measured: Measured
    error: TruthError
    loop: Loop | None
    """Compiled loop, where the candidate is within the tolerance."""
    refinement: float
    """Refinement of the reference [-]."""
    allowed: float
    """Largest error over the tolerance [-]."""

    @property
    def is_within(self) -> bool:
        """True if its error and the reference's together are within the tolerance."""
        return self.measured.error <= self.allowed

    @property
    def percent(self) -> float:
        """Largest root mean square of the saved times [%]."""
        return float(self.error.worst_rms_percent)

    @property
    def kelvin(self) -> float:
        """Largest root mean square of the saved times [K]."""
        return float(self.error.worst_rms_kelvin)

    def error_words(self) -> str:
        """Errors in words."""
        return f"{self.percent:.2g} % ({self.kelvin:.2g} K)"

    def time_words(self) -> str:
        """Run time in words."""
        return Spread.of([self.measured.run_time]).text().partition(" (")[0]

    def memory_words(self) -> str:
        """Peak memory in words."""
        return f"{self.measured.memory / 2**20:.3g} MiB"

    def words(self, pitches: tuple[float, ...]) -> str:
        """Candidate, error and time; `pitches` are those of the scene's file [m]."""
        model = self.measured.candidate.words(pitches)
        return f"{model}: {self.error_words()}, {self.time_words()}"

    def as_json(self) -> TrialRecord:
        """Values for `plan.json`: the fields of `Measured`, and the errors."""
        stable_step = self.measured.stable_step
        return {
            **self.measured._asdict(),
            "candidate": self.measured.candidate._asdict(),
            "stable_step": stable_step if np.isfinite(stable_step) else None,
            "excess": self.measured.error,
            "error_percent": self.percent,
            "error_kelvin": self.kelvin,
            "reference_refinement": self.refinement,
        }


class Bench:
    """The scene of a plan: runs its references and its candidates."""

    def __init__(
        self, scene: SceneConfig, pitches: tuple[float, ...], tolerance: Tolerance
    ):
        """Nothing is run yet."""
        self.scene = scene
        self.pitches = pitches
        self.tolerance = tolerance

    def reference(self, refinement: float, log: Log) -> Reference:
        """Run of voxels so many times finer, or from the cache, with its own error."""
        refined = refined_reference(
            self._refined(refinement), settings=_REFERENCE_SETTINGS, log=log
        )
        own_error = refined.own_error
        if (
            self.tolerance.percent is not None
            and not own_error.rms_percent.max() < np.inf
        ):
            raise InputError(
                "--tolerance: at a saved time the whole surface of the reference has "
                "one temperature, a range that nothing is a percentage of: give "
                "--kelvin instead"
            )
        excess = self.tolerance.excess(
            float(own_error.rms_percent.max()),
            kelvin=float(own_error.rms_kelvin.max()),
        )
        # At a time without a difference there is no ratio.
        differs = own_error.rms_kelvin > 0
        ratios = own_error.rms_percent[differs] / own_error.rms_kelvin[differs]
        percent_per_kelvin = float(ratios.max(initial=0.0))
        coarser = []
        for factor, kelvin in zip(
            (2, 4), own_error.differences.max(axis=0), strict=True
        ):
            blocks = Candidate(refinement / factor, "aggregate", 2, steps=_CONVERGED)
            coarser_excess = self.tolerance.excess(
                percent_per_kelvin * float(kelvin), kelvin=float(kelvin)
            )
            coarser.append((blocks, coarser_excess))
        return Reference(
            refinement=refinement,
            points=truth_points(refined.solution, _POINTS),
            own_error=own_error.as_dict(),
            excess=excess,
            cost=refined.costs[0],
            coarser=tuple(coarser),
        )

    def expected_excess(self, refinement: float, log: Log) -> float:
        """Expected error of a reference over the tolerance [-].

        It follows from the difference to the next coarser run, without a third one.
        """
        error = coarser_difference(
            self._refined(refinement), settings=_REFERENCE_SETTINGS, log=log
        )
        return self._excess(error) / (COARSENING**_ORDER - 1)

    def _refined(self, refinement: float) -> SceneConfig:
        # By its pitch: a refinement below 1 is allowed here.
        full = Candidate(refinement, "full_volume")
        return full.applied(self.scene, self.pitches)

    def _excess(self, error: TruthError) -> float:
        return self.tolerance.excess(
            float(error.worst_rms_percent), kelvin=float(error.worst_rms_kelvin)
        )

    def run(self, candidate: Candidate, reference: Reference) -> Trial:
        """Run a candidate, then time it warm.

        Raises:
            InputError: if it cannot be built or fails.
        """
        config = candidate.applied(self.scene, self.pitches)
        plan = plan_case(config, build_case(config).scene)
        with precision(config.dtype):
            loop = compiled_loop(plan)
            surface = _surface(plan, loop.run())
            error = reference.points.error(surface)
            seconds = loop.seconds()
            if seconds < _SHORT:
                # Other work of the machine makes a run longer, never shorter.
                seconds = min(loop.seconds() for _ in range(_REPEATS))
        receipt = plan.compiled.receipt
        measured = Measured(
            candidate=candidate,
            error=self._excess(error),
            nodes=receipt.nodes,
            fragments=sum(len(s.geometry.fragment_area) for s in surface.surfaces),
            steps=plan.steps,
            stages=getattr(plan.stepper, "stages_taken", 1),
            stable_step=float(plan.stable_step or np.inf),
            run_time=seconds,
            memory=receipt.memory_bytes,
        )
        return Trial(
            measured=measured,
            error=error,
            loop=loop,
            refinement=reference.refinement,
            allowed=reference.allowed,
        )

    def volume_and_area(self) -> tuple[float, float]:
        """Volume and area of all bodies, in cubes and squares of their pitches [-]."""
        meshes = [body.build_mesh() for body in self.scene.bodies]
        pairs = list(zip(meshes, self.pitches, strict=True))
        return (
            sum(abs(mesh.volume) / pitch**3 for mesh, pitch in pairs),
            sum(mesh.area / pitch**2 for mesh, pitch in pairs),
        )


def _surface(plan: Plan, outcome: Any) -> StoredSolution:
    """Surface temperatures of a loop's outcome, without the rest of a solution.

    Raises:
        InputError: if the run failed.
    """
    surfaces = plan.compiled.surfaces
    times = np.asarray(plan.save_times)
    # A run that controls its error, or in which something moves, says if it fails.
    if not isinstance(outcome, Observation):
        return StoredSolution(times, np.asarray(outcome), surfaces)
    if times[0] == 0.0:
        solution = make_solution(plan, outcome)
        result = solution.result
        rows = solution.surface_temperature
    else:
        # The energies would take a program of their own for each structure.
        last = jax.tree.map(lambda rows: rows[-1], outcome.statistics)
        result = run_result(outcome.is_finite.all(), outcome.is_physical.all(), last)
        rows = outcome.surface_temperature
    if result != RESULTS.successful:
        raise InputError(RESULTS[result])
    return StoredSolution(times, np.asarray(rows), surfaces)


def loop_times(trials: Sequence[Trial], repeats: int, dtype: str) -> list[Spread]:
    """Times of the loops of trials, measured alternately [s]."""
    loops = {str(n): trial.loop for n, trial in enumerate(trials)}
    calls = {name: loop.run for name, loop in loops.items() if loop is not None}
    assert len(calls) == len(trials)
    with precision(dtype):
        spans = interleaved(calls, repeats, warm_up=False)
    return [Spread.of(span) for span in spans.values()]
