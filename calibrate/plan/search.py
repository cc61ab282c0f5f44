"""The search of a plan: from coarse references to the cheapest model that is verified.

References in ever finer voxels are run until the finest one's own error is half of the
tolerance; a candidate is within the tolerance if its difference from the reference and
the reference's own error together are. A few blocks show how errors and times fall with
pitch, size and steps; from then on the candidate that is predicted to be the cheapest
within the tolerance is run, and its error and time correct the prediction, until no
other one is expected to be faster.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.progress import Progress
from jaxthermo.timing import Spread

from ..study.rows import Rows
from .candidate import FAMILIES, Candidate, Family, Method, cards_of, pitches_of
from .predict import Forecast, Predictor, scene_size
from .references import Reference, References, about_time
from .tolerance import Tolerance
from .trial import Bench, Trial


MAX_OWN_ERROR = 0.5
"""Largest error of the reference itself over the tolerance [-], if finer voxels are
possible."""
_MAX_OWN_ERROR_OF_SLOW = 0.6
"""The same where a finer reference is expected to take longer than all candidates."""

_FACTORS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32)
_SHELL_FACTORS = (4, 8)
_STEPS = (8, 12, 18, 24, 36, 54, 72, 108)
_IMPLICIT_STEPS = (18, 36, 72)
_COARSENINGS = (0, 1, 2, 3, 4, 5, 6)
"""Pitches of candidates, in powers of sqrt(2) of the finest one."""

_SHEET_COARSENINGS = range(2, 14)
"""The same of the cells of sheets, where there is no solid. Those of the reference are
twice as large as its voxels."""

_PROBE_NODES = 300
"""Number of blocks of the coarsest of the first candidates, without the surface's."""

_PROBE_STEPS = 36
"""Steps of most of the first candidates."""
_FEW_PROBE_STEPS = 12
"""Steps of one of the first candidates."""

_MAX_TRIALS = 18
_GAIN = 0.85
"""Expected time over that of the best one, above which nothing more is run [-]."""

_MARGIN = 0.97
"""Largest predicted error over the allowed one [-]."""

_NEARER = 0.8
"""Expected error over the smallest one so far, from which the most accurate candidate
is run where none is expected to be within the tolerance [-]."""

_ALIKE = 1.4
"""Ratio of run times up to which candidates are timed again at the end [-]."""

_REPEATS = 7

_USUAL_TRIALS = 10
"""Number of candidates that a search usually runs."""
_TRIAL_SECONDS = 5.0
"""Time of a candidate before any is run [s]."""
_REFERENCE_SHARE = 0.5
"""Largest expected time of a finer reference over what is left of the search's [-]."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Outcome of a search."""

    trials: tuple[Trial, ...]
    reference: Reference
    best: Trial | None
    """Fastest candidate within the tolerance; None if there is none."""
    time: Spread | None
    """Run time of `best`, measured alternately with similar ones."""
    nearest: Trial | None
    """Candidate of the smallest error within the limits of time and memory; None where
    the reference's own error exceeds the tolerance and nothing is compared with it."""
    is_complete: bool
    """False if the search was ended by its time."""


def search(
    scene: SceneConfig,
    tolerance: Tolerance,
    rows: Rows,
    search_time: float,
    progress: Progress,
) -> Choice:
    """Search for the fastest model of a scene within a tolerance.

    Args:
        scene: config of the scene; its pitches, structures and solver are replaced.
        tolerance: of the error, the time and the memory.
        rows: candidates of earlier searches, to which those of this one are added.
        search_time: time after which nothing more is begun [s]; the first reference is
            always run.
        progress: receives the progress.

    Raises:
        InputError: if the scene has no finer voxels, or nothing can be run.
    """
    deadline = time.perf_counter() + search_time
    pitches = pitches_of(scene)
    bench = Bench(scene, pitches=pitches, tolerance=tolerance, rows=rows)
    references = References(
        scene, pitches=pitches, tolerance=tolerance, size=scene_size(scene, pitches)
    )
    return _Search(bench, references=references, deadline=deadline, progress=progress)()


class _Search:
    def __init__(
        self, bench: Bench, references: References, deadline: float, progress: Progress
    ):
        self.bench = bench
        self.references = references
        self.deadline = deadline
        self.progress = progress
        self.tolerance = bench.tolerance
        self.size = references.size
        self.cards = cards_of(bench.scene)
        self.trials: list[Trial] = []
        self.failed: set[Candidate] = set()
        self.is_complete = True
        self.is_over = False

    def __call__(self) -> Choice:
        """Refine references, then run candidates and compare them with the finest."""
        self._announce_plan()
        self.reference = self._first_reference()
        while self.reference.excess > self._own_limit() and self._refine():
            pass
        # Nothing is within a tolerance that the reference itself exceeds.
        while self.reference.allowed > 0:
            if not self._run_candidates() or not self._refine():
                break
        return self._choice()

    def _own_limit(self) -> float:
        """Error of a reference over the tolerance from which a finer one is run [-]."""
        planned = self.references.planned()
        is_slow = planned and planned[0].seconds > _USUAL_TRIALS * _TRIAL_SECONDS
        return _MAX_OWN_ERROR_OF_SLOW if is_slow else MAX_OWN_ERROR

    def _announce_plan(self) -> None:
        planned = self.references.planned()
        listed = "; ".join(
            f"{1e3 * self.bench.pitches[0] / run.refinement:.3g} mm, about "
            f"{run.nodes:,} nodes, {about_time(run.seconds)}"
            for run in planned
        )
        self.progress.line(
            "references in voxels of half the edge each time, until one is off by "
            f"{MAX_OWN_ERROR:g} of the tolerance: {listed}"
        )
        candidates = _USUAL_TRIALS * _TRIAL_SECONDS
        first = sum(run.seconds for run in self.references.needed(MAX_OWN_ERROR))
        finest = sum(run.seconds for run in planned)
        self.progress.line(
            f"then about {_USUAL_TRIALS} candidates, at most {_MAX_TRIALS}: "
            f"{about_time(first + candidates)} if the third reference will do, "
            f"{about_time(finest + candidates)} if the finest is needed"
        )

    def _first_reference(self) -> Reference:
        reason = InputError("no reference can be run")
        for _ in self.references.planned():
            try:
                reference = self.references.refine(self._announce)
            except InputError as error:
                reason = error
                continue
            if reference is not None:
                return self._checked(reference)
        raise reason

    def _refine(self) -> bool:
        """Halve the voxels of the reference; False where that is too much."""
        planned = self.references.planned()
        if not planned:
            return False
        left = self.deadline - time.perf_counter()
        if planned[0].seconds > _REFERENCE_SHARE * left:
            self.is_complete = False
            expected = f"about {planned[0].nodes:,} nodes"
            self.progress.line(f"no finer reference: no time is left for {expected}")
            return False
        try:
            reference = self.references.refine(self._announce)
        except InputError as error:
            self.progress.line(f"no finer reference: {error}")
            return False
        assert reference is not None
        self.reference = self._checked(reference)
        return True

    def _announce(self, text: str) -> None:
        self.progress.line(f"reference: {text}")
        self.progress.stage(f"reference: {text}")

    def _checked(self, reference: Reference) -> Reference:
        if math.isinf(reference.excess):
            raise InputError(
                "--tolerance: at a saved time the whole surface of the reference has "
                "one temperature, a range that nothing is a percentage of: give "
                "--kelvin instead"
            )
        needed = self.references.needed(MAX_OWN_ERROR)
        seconds = sum(run.seconds for run in needed) + _USUAL_TRIALS * _TRIAL_SECONDS
        nodes = reference.cost["nodes"]
        text = f"reference of {nodes:,} nodes: off by {reference.excess:.2g} of the "
        text += f"tolerance; {about_time(seconds)} are left"
        self.progress.line(text)
        return reference

    def _run_candidates(self) -> bool:
        """Run candidates; False where one is within the tolerance, or time is over."""
        if not self.trials:
            self._probe()
        while len(self.trials) < _MAX_TRIALS and not self.is_over:
            candidate = self._next()
            if candidate is None:
                # Finer voxels may still meet what no candidate does yet.
                return not self._within()
            self._try(candidate)
        return False

    def _probe(self) -> None:
        finest = self.reference.refinement / 2
        edge = self.size.edge_of(_PROBE_NODES)
        if self.size.is_of_sheets:
            probes = _first_sheets(finest / 2, edge)
        else:
            probes = _first_blocks(finest, edge)
        # In coarse voxels two of them may be equal.
        for candidate in dict.fromkeys(probes):
            self._try(candidate)
        if not self.trials and not self.is_over:
            raise InputError("no candidate can be run: see the messages above")

    def _try(self, candidate: Candidate) -> None:
        words = candidate.words(self.bench.pitches)
        is_stored = self.bench.is_stored(candidate, self.reference)
        longest = max((trial.took for trial in self.trials), default=0.0)
        if not is_stored and time.perf_counter() + longest > self.deadline:
            self.is_complete = False
            self.is_over = True
            return
        self.progress.stage(words)
        try:
            trial = self.bench.trial(candidate, self.reference)
        except InputError as error:
            self.failed.add(candidate)
            self.progress.line(f"{words}: {error}")
            return
        self.trials.append(trial)
        earlier = " (run before)" if is_stored else ""
        self.progress.line(trial.words(self.bench.pitches) + earlier)

    def _next(self) -> Candidate | None:
        """Candidate that is expected to be the fastest within the tolerance, if any."""
        predictor = Predictor(
            runs=[trial.measured for trial in self.trials],
            errors=self.reference.coarser,
            end=self.bench.scene.time.last,
            size=self.size,
        )
        compared = {
            trial.measured.candidate
            for trial in self.trials
            if trial.refinement == self.reference.refinement
        }
        done = compared | self.failed
        best = min((t.measured.run_time for t in self._within()), default=None)
        fastest = None
        shortest = float("inf") if best is None else _GAIN * best
        limit = _MARGIN * self.reference.allowed
        nearest = None
        smallest_error = _NEARER * min(t.measured.error for t in self.trials)
        for candidate in self._candidates():
            if candidate in done:
                continue
            expected = predictor.forecast(candidate)
            if not self._is_affordable(expected):
                continue
            if expected.error <= limit and expected.run_time < shortest:
                fastest = candidate
                shortest = expected.run_time
            if expected.error < smallest_error:
                nearest = candidate
                smallest_error = expected.error
        # The most accurate one shows if the tolerance can be met at all.
        return nearest if fastest is None and best is None else fastest

    def _is_affordable(self, expected: Forecast) -> bool:
        # A forecast of the time may be off by this much.
        run_time = expected.run_time / 1.2
        return self.tolerance.affords(run_time=run_time, memory=expected.memory)

    def _candidates(self) -> Iterator[Candidate]:
        finest = self.reference.refinement / 2
        models: list[Candidate] = []
        if self.size.is_of_sheets:
            sizes = (finest * 2 ** (-power / 2) for power in _SHEET_COARSENINGS)
            models += [Candidate(size, "sheet") for size in sizes]
        for power in () if models else _COARSENINGS:
            refinement = finest * 2 ** (-power / 2)
            for family in FAMILIES:
                factors = _factors(family)
                models += [Candidate(refinement, family, f) for f in factors]
            models += [card._replace(refinement=refinement) for card in self.cards]
        methods: list[tuple[Method, int]] = [
            ("forward_euler", 0),
            *(("super_time_stepping", n) for n in _STEPS),
            *(("trbdf2", n) for n in _IMPLICIT_STEPS),
        ]
        for model, (method, steps) in product(models, methods):
            yield model._replace(method=method, steps=steps)

    def _meets_all(self, trial: Trial) -> bool:
        return trial.is_within and self._fits(trial)

    def _fits(self, trial: Trial) -> bool:
        measured = trial.measured
        return self.tolerance.affords(measured.run_time, memory=measured.memory)

    def _within(self) -> list[Trial]:
        # An error against a coarser reference than the last one counts no longer.
        return [
            t
            for t in self.trials
            if self._meets_all(t) and t.refinement == self.reference.refinement
        ]

    def _choice(self) -> Choice:
        within = sorted(self._within(), key=lambda trial: trial.measured.run_time)
        best = None
        spread = None
        if within:
            best, spread = self._timed_again(within)
        fitting = [t for t in self.trials if self._fits(t)] or self.trials
        nearest = min(fitting, key=lambda trial: trial.measured.error, default=None)
        return Choice(
            trials=tuple(self.trials),
            reference=self.reference,
            best=best,
            time=spread,
            nearest=nearest,
            is_complete=self.is_complete,
        )

    def _timed_again(self, within: list[Trial]) -> tuple[Trial, Spread]:
        """The fastest of trials, the first of which was so far, and its time."""
        fastest = within[0]
        limit = _ALIKE * fastest.measured.run_time
        alike = [trial for trial in within if trial.measured.run_time <= limit]
        expected = sum(
            trial.took + _REPEATS * trial.measured.run_time for trial in alike
        )
        if time.perf_counter() + expected > self.deadline:
            return fastest, Spread.of([fastest.measured.run_time])
        self.progress.stage("timing the fastest again")
        candidates = [trial.measured.candidate for trial in alike]
        times = self.bench.times(candidates, repeats=_REPEATS)
        pairs = zip(alike, times, strict=True)
        return min(pairs, key=lambda pair: pair[1].median)


def _first_sheets(finest: float, edge: float) -> tuple[Candidate, ...]:
    """First candidates where there is no solid, up to the finest refinement.

    Args:
        finest: largest refinement [-].
        edge: of the cells of the coarsest one, over the pitch of the scene's file [-].
    """
    base = Candidate(min(1 / edge, finest / 2), "sheet", steps=_PROBE_STEPS)
    return (
        base,
        base._replace(refinement=2 * base.refinement),
        base._replace(steps=_FEW_PROBE_STEPS),
        # Its error in time may be opposite to that of its cells.
        base._replace(method="forward_euler", steps=0),
    )


def _first_blocks(finest: float, edge: float) -> tuple[Candidate, ...]:
    """First candidates of solids, alone or beside sheets; arguments as above."""
    # The finest voxels take the longest to prepare: once, if others have blocks.
    common = finest / 2
    single = finest
    if edge * common < _FACTORS[2]:
        common, single = single, common
    large = _factor_near(edge * common)
    small = _factor_near(edge * common / 2)
    base = Candidate(common, "aggregate", large, steps=_PROBE_STEPS)
    return (
        base,
        base._replace(factor=small),
        base._replace(steps=_FEW_PROBE_STEPS),
        base._replace(refinement=single, factor=_factor_near(edge * single / 2)),
        # Its error in time may be opposite to that of its blocks.
        base._replace(method="forward_euler", steps=0),
    )


def _factor_near(target: float) -> int:
    return min(_FACTORS, key=lambda factor: abs(math.log(factor / target)))


def _factors(family: Family) -> tuple[int, ...]:
    if family == "aggregate":
        return _FACTORS
    return _SHELL_FACTORS if family == "shell_over_core" else (1,)
