"""Trials of a plan: references in ever finer voxels, and candidates beside them."""

import math
import statistics
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxthermo.accuracy.truth_error import TruthError, TruthPoints, truth_points
from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.simulate import make_solution
from jaxthermo.integrate.run.solution import RESULTS, Observation, run_result
from jaxthermo.integrate.run.solution_file import StoredSolution
from jaxthermo.timing import Timing

from ..config.schema import RefinedReference
from ..problem.reference import (
    COARSENING,
    Log,
    coarser_difference,
    refined_reference,
)
from ..runs.scenes import build_case
from ..runs.times import Loop, compiled_loop
from .candidate import Candidate
from .predict import Found


_REFERENCE = {"kind": "aggregate", "factor": 2}
"""Structure of the references: blocks are as accurate as their voxels are fine, with an
eighth of the nodes."""

_POINTS = 4000
"""Points on the meshes at which temperatures are compared."""

_CONVERGED = 2000
"""Steps of a run whose error in time is controlled, for predictions."""

MAX_OWN_ERROR = 0.5
"""Largest error of the reference itself over the tolerance [-]."""

_SHORT, _REPEATS = 0.2, 10
"""Time of a loop up to which it is repeated, and how often [s, -]."""

_ORDER = 1.5
"""Order at which a reference's error falls, before three runs show it."""


class Tolerance(NamedTuple):
    """Limits of a plan."""

    percent: float | None = None
    """Largest root mean square over the range of the reference [%],"""
    kelvin: float | None = None
    """or this one [K], or both."""
    run_time: float | None = None
    """Time of the compiled loop [s]."""
    memory: float | None = None
    """[bytes]"""

    def excess(self, percent: float, kelvin: float) -> float:
        """Error over the tolerance [-]: at most 1 where it is kept."""
        parts = []
        if self.percent is not None:
            parts.append(percent / self.percent)
        if self.kelvin is not None:
            parts.append(kelvin / self.kelvin)
        return max(parts)

    def words(self) -> str:
        """As in a sentence: "1 %, 0.2 K"."""
        parts = []
        if self.percent is not None:
            parts.append(f"{self.percent:.3g} %")
        if self.kelvin is not None:
            parts.append(f"{self.kelvin:.3g} K")
        if self.run_time is not None:
            parts.append(f"{1e3 * self.run_time:.3g} ms")
        if self.memory is not None:
            parts.append(f"{self.memory / 2**20:.4g} MiB")
        return ", ".join(parts)


class Reference(NamedTuple):
    """A run of finer voxels that candidates are compared with."""

    refinement: float
    points: TruthPoints
    """Its temperatures at points of the meshes."""
    own_error: dict[str, Any]
    """Its own error, as of `DiscretizationError`."""
    excess: float
    """That error over the tolerance [-]."""
    cost: dict[str, Any]
    coarser: tuple[tuple[Candidate, float], ...]
    """Blocks that its error follows from, and their errors over the tolerance [-]."""

    @property
    def own_percent(self) -> float:
        """Largest of its own errors at the saved times [%]."""
        return max(e for e in self.own_error["rms_percent"] if e is not None)

    @property
    def allowed(self) -> float:
        """Largest error beside it over the tolerance, so that both together keep it."""
        # Where finer references are too much, the plan says so.
        return math.sqrt(1 - min(self.excess, MAX_OWN_ERROR) ** 2)


class Trial(NamedTuple):
    """A candidate that was run, beside a reference."""

    found: Found
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
        return self.found.error <= self.allowed

    @property
    def percent(self) -> float:
        """Largest root mean square of the saved times [%]."""
        return float(self.error.worst_rms_percent)

    @property
    def kelvin(self) -> float:
        """The same [K]."""
        return float(self.error.worst_rms_kelvin)

    @property
    def as_dict(self) -> dict[str, Any]:
        """Plain values for `plan.json`."""
        plain = self.found._asdict() | {"candidate": self.found.candidate._asdict()}
        if not np.isfinite(self.found.stable_step):
            plain["stable_step"] = None
        return {
            **plain,
            "excess": self.found.error,
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
        self.scene, self.pitches, self.tolerance = scene, pitches, tolerance

    def reference(self, refinement: float, log: Log) -> Reference:
        """Run voxels so many times finer, or load the run, with its own error."""
        found = refined_reference(*self._refined(refinement), log)
        own, points = found.own_error, truth_points(found.solution, _POINTS)
        if self.tolerance.percent is not None and not own.rms_percent.max() < np.inf:
            raise InputError(
                "--tolerance: at a saved time the whole surface of the reference has "
                "one temperature, a range that nothing is a percentage of: give "
                "--kelvin instead"
            )
        excess = self.tolerance.excess(
            float(own.rms_percent.max()), float(own.rms_kelvin.max())
        )
        # At a time without a difference there is no ratio.
        differs = own.rms_kelvin > 0
        ratios = own.rms_percent[differs] / own.rms_kelvin[differs]
        percent_per_kelvin = float(ratios.max(initial=0.0))
        coarser = []
        for factor, kelvin in zip((2, 4), own.differences.max(axis=0), strict=True):
            blocks = Candidate(refinement / factor, "aggregate", 2, steps=_CONVERGED)
            error = percent_per_kelvin * float(kelvin), float(kelvin)
            coarser.append((blocks, self.tolerance.excess(*error)))
        own_error, cost = own.as_dict(), found.costs[0]
        return Reference(
            refinement=refinement,
            points=points,
            own_error=own_error,
            excess=excess,
            cost=cost,
            coarser=tuple(coarser),
        )

    def expected_excess(self, refinement: float, log: Log) -> float:
        """Error over the tolerance that a reference is expected to have [-].

        From its difference to the next coarser run, without a third one.
        """
        config, given = self._refined(refinement)
        error = coarser_difference(config, given, log)
        percent, kelvin = error.worst_rms_percent, error.worst_rms_kelvin
        return self.tolerance.excess(float(percent), float(kelvin)) / (
            COARSENING**_ORDER - 1
        )

    def _refined(self, refinement: float) -> tuple[SceneConfig, RefinedReference]:
        given = RefinedReference.model_validate(
            {"refinement": 1.0, "structure": _REFERENCE, "points": _POINTS}
        )
        # Of a coarser pitch too, which a refinement below 1 would be.
        full = Candidate(refinement, "full_volume")
        return full.applied(self.scene, self.pitches), given

    def run(self, candidate: Candidate, reference: Reference) -> Trial:
        """Run a candidate, and again to time it warm.

        Raises:
            InputError: if it cannot be built or fails.
        """
        config = candidate.applied(self.scene, self.pitches)
        scene = build_case(config).scene
        end, saves = config.time.end, config.time.save_times
        with precision(config.dtype):
            plan = plan_run(scene, t1=end, save_at=saves, solver=config.solver.build())
            loop = compiled_loop(plan)
            surface = _surface(plan, loop.run())
            error = reference.points.error(surface)
            seconds = loop.seconds()
            if seconds < _SHORT:
                # Other work of the machine makes a run longer, never shorter.
                seconds = min(loop.seconds() for _ in range(_REPEATS))
        excess = self.tolerance.excess(
            float(error.worst_rms_percent), float(error.worst_rms_kelvin)
        )
        receipt = plan.compiled.receipt
        found = Found(
            candidate=candidate,
            error=excess,
            nodes=receipt.nodes,
            fragments=sum(len(s.geometry.fragment_area) for s in surface.surfaces),
            steps=plan.steps,
            stages=getattr(plan.stepper, "stages_taken", 1),
            stable_step=float(plan.stable_step or np.inf),
            run_time=seconds,
            memory=receipt.memory_bytes,
        )
        return Trial(
            found=found,
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


def _surface(plan: Plan, found: Any) -> StoredSolution:
    """Surface temperatures that a loop found, without what a solution has besides.

    Raises:
        InputError: if the run failed.
    """
    surfaces, times = plan.compiled.surfaces, np.asarray(plan.save_times)
    # A run that controls its error, or in which something moves, says if it fails.
    if not isinstance(found, Observation):
        return StoredSolution(times, np.asarray(found), surfaces)
    if times[0] == 0.0:
        solution = make_solution(plan, found)
        result, rows = solution.result, solution.surface_temperature
    else:
        # The energies would take a program of their own for each structure.
        last = jax.tree.map(lambda rows: rows[-1], found.statistics)
        ended = found.is_finite.all(), found.is_physical.all()
        result, rows = run_result(*ended, last), found.surface_temperature
    if result != RESULTS.successful:
        raise InputError(RESULTS[result])
    return StoredSolution(times, np.asarray(rows), surfaces)


def in_turn(trials: Sequence[Trial], repeats: int, dtype: str) -> list[Timing]:
    """Times of the loops of trials, each repeated in turn with the others [s]."""
    spans: list[list[float]] = [[] for _ in trials]
    with precision(dtype):
        for _ in range(repeats):
            for span, trial in zip(spans, trials, strict=True):
                assert trial.loop is not None
                span.append(trial.loop.seconds())
    return [Timing(statistics.median(s), min(s), max(s)) for s in spans]
