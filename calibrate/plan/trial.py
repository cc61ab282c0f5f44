"""Trials of a plan: candidates that are run and compared with a reference."""

import json
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxthermo.accuracy.error_records import finite_number
from jaxthermo.archive import text_hash
from jaxthermo.arrays import precision
from jaxthermo.config.loader import config_hash
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.made_solution import make_solution
from jaxthermo.integrate.run.plan import Plan
from jaxthermo.integrate.run.solution import RESULTS, Observation, run_result
from jaxthermo.provenance import processor
from jaxthermo.timing import Spread, interleaved

from ..study.case import build_case, plan_case
from ..study.rows import Row, Rows
from ..study.times import Loop, compiled_loop
from .candidate import Candidate
from .predict import Measured
from .references import Reference
from .tolerance import Tolerance


_SHORT = 0.2
"""Time of a loop up to which it is repeated [s]."""
_REPEATS = 10
"""Number of repeats of a short loop."""


class Trial(NamedTuple):
    """A candidate that was run, compared with a reference."""

    measured: Measured
    percent: float
    """Largest root mean square of the saved times [%]."""
    kelvin: float
    """Largest root mean square of the saved times [K]."""
    refinement: float
    """Refinement of the reference [-]."""
    allowed: float
    """Largest error over the tolerance [-]."""
    took: float
    """Time to prepare, compile, run and compare it [s]."""

    @property
    def is_within(self) -> bool:
        """True if its error and the reference's together are within the tolerance."""
        return self.measured.error <= self.allowed

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

    def as_json(self) -> Row:
        """Values for `plan.json` and `rows.jsonl`."""
        return {
            **self.measured._asdict(),
            "candidate": self.measured.candidate._asdict(),
            "stable_step": finite_number(self.measured.stable_step),
            "error": finite_number(self.measured.error),
            "excess": finite_number(self.measured.error),
            "error_percent": finite_number(self.percent),
            "error_kelvin": self.kelvin,
            "reference_refinement": self.refinement,
            "took_s": self.took,
        }


class Bench:
    """The scene of a plan: runs its candidates, or takes them from an earlier search.

    Rows of trials do not depend on the tolerance: another one uses them again.
    """

    def __init__(
        self,
        scene: SceneConfig,
        pitches: tuple[float, ...],
        tolerance: Tolerance,
        rows: Rows,
    ):
        """Nothing is run yet."""
        self.scene = scene
        self.pitches = pitches
        self.tolerance = tolerance
        self._rows = rows
        # Times are those of one processor.
        self._scene_key = [config_hash(scene), processor()]
        self._loops: dict[Candidate, Loop] = {}

    def is_stored(self, candidate: Candidate, reference: Reference) -> bool:
        """True for a candidate that an earlier search compared with the reference."""
        return self._key(candidate, reference) in self._rows.by_id

    def trial(self, candidate: Candidate, reference: Reference) -> Trial:
        """Run a candidate, then time it warm; or take it from an earlier search.

        Raises:
            InputError: if it cannot be built or fails.
        """
        key = self._key(candidate, reference)
        row = self._rows.by_id.get(key)
        if row is None:
            try:
                trial = self._run(candidate, reference)
            except InputError as error:
                self._rows.append([{"id": key, "failed": str(error)}])
                raise
            self._rows.append([{"id": key, **trial.as_json()}])
            return trial
        if "failed" in row:
            raise InputError(row["failed"])
        return self._stored(row, candidate, reference)

    def _key(self, candidate: Candidate, reference: Reference) -> str:
        inputs = [*self._scene_key, list(candidate), reference.refinement]
        return text_hash(json.dumps(inputs))

    def _stored(self, row: Row, candidate: Candidate, reference: Reference) -> Trial:
        measured = {name: row[name] for name in Measured._fields}
        percent = _or_infinite(row["error_percent"])
        kelvin = float(row["error_kelvin"])
        measured |= {
            "candidate": candidate,
            "stable_step": _or_infinite(row["stable_step"]),
            "error": self.tolerance.excess(percent, kelvin=kelvin),
        }
        return Trial(
            measured=Measured(**measured),
            percent=percent,
            kelvin=kelvin,
            refinement=reference.refinement,
            allowed=reference.allowed,
            took=row["took_s"],
        )

    def _loop(self, candidate: Candidate) -> Loop:
        config = candidate.applied(self.scene, self.pitches)
        return compiled_loop(plan_case(config, build_case(config).scene))

    def _run(self, candidate: Candidate, reference: Reference) -> Trial:
        clock = time.perf_counter()
        with precision(self.scene.dtype):
            loop = self._loop(candidate)
            plan = loop.plan
            surface = _surface(plan, loop.run())
            error = reference.points.error(surface)
            seconds = loop.seconds()
            if seconds < _SHORT:
                # Other work of the machine makes a run longer, never shorter.
                seconds = min(loop.seconds() for _ in range(_REPEATS))
        receipt = plan.compiled.receipt
        percent = float(error.worst_rms_percent)
        kelvin = float(error.worst_rms_kelvin)
        measured = Measured(
            candidate=candidate,
            error=self.tolerance.excess(percent, kelvin=kelvin),
            nodes=receipt.nodes,
            fragments=sum(len(s.geometry.fragment_area) for s in surface.surfaces),
            steps=plan.steps,
            stages=getattr(plan.stepper, "stages_taken", 1),
            stable_step=float(plan.stable_step or np.inf),
            run_time=seconds,
            memory=receipt.memory_bytes,
        )
        if measured.error <= reference.allowed:
            # Only those that may win are timed again.
            self._loops[candidate] = loop
        return Trial(
            measured=measured,
            percent=percent,
            kelvin=kelvin,
            refinement=reference.refinement,
            allowed=reference.allowed,
            took=time.perf_counter() - clock,
        )

    def times(self, candidates: Sequence[Candidate], repeats: int) -> list[Spread]:
        """Times of the loops of candidates, measured alternately [s]."""
        with precision(self.scene.dtype):
            calls = {
                str(number): (self._loops.get(candidate) or self._loop(candidate)).run
                for number, candidate in enumerate(candidates)
            }
            spans = interleaved(calls, repeats)
        return [Spread.of(span) for span in spans.values()]


def _or_infinite(value: float | None) -> float:
    return np.inf if value is None else value


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
