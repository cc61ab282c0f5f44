"""The search of a plan: from coarse references to the cheapest model that is verified.

References in ever finer voxels are run until the finest one's own error is half of the
tolerance; a candidate is within the tolerance if its error and the reference's together
are, as the root of the sum of their squares. A few blocks show how errors and times
fall with pitch, size and steps; from then on the candidate that is predicted to be the
cheapest within the tolerance is run, and its error and time correct the prediction,
until no other one is expected to be faster.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.console.progress import Progress
from jaxthermo.errors import InputError
from jaxthermo.timing import Spread

from .candidate import FAMILIES, Candidate, Family, Method, cards_of, pitches_of
from .predict import Forecast, Predictor
from .trial import MAX_OWN_ERROR, Bench, Reference, Tolerance, Trial, loop_times


_FIRST_VOXELS = 24_000
"""Voxels in which the first reference is run."""

_MOST_NODES = 3e6
"""Nodes of the finest reference."""

_FACTORS = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32)
_SHELL_FACTORS = (4, 8)
_STEPS = (8, 12, 18, 24, 36, 54, 72, 108)
_IMPLICIT_STEPS = (18, 36, 72)
_COARSENINGS = (0, 1, 2, 3, 4, 5, 6)
"""Pitches of candidates, in powers of sqrt(2) of the finest one."""

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


@dataclass(frozen=True, eq=False)
class Choice:
    """Outcome of a search."""

    trials: tuple[Trial, ...]
    reference: Reference
    best: Trial | None
    """Fastest candidate within the tolerance; None if there is none."""
    time: Spread | None
    """Run time of `best`, measured alternately with similar ones."""
    nearest: Trial
    """Candidate of the smallest error within the limits of time and memory."""


def search(
    scene: SceneConfig,
    tolerance: Tolerance,
    progress: Progress,
) -> Choice:
    """Search for the fastest model of a scene within a tolerance.

    Args:
        scene: config of the scene; its pitches, structures and solver are replaced.
        tolerance: of the error, the time and the memory.
        progress: receives the progress.

    Raises:
        InputError: if the scene has no finer voxels, or nothing can be run.
    """
    return _Search(scene, tolerance, progress).run()


class _Search:
    def __init__(
        self,
        scene: SceneConfig,
        tolerance: Tolerance,
        progress: Progress,
    ):
        self.bench = Bench(scene, pitches_of(scene), tolerance)
        self.tolerance = tolerance
        self.progress = progress
        self.cards = cards_of(scene)
        self.trials: list[Trial] = []
        self.failed: set[Candidate] = set()
        self.volume, self.area = self.bench.volume_and_area()

    def run(self) -> Choice:
        """Refine references, then run candidates and compare them with the finest."""
        # In powers of two: the user's own pitch is among the candidates.
        first = 2.0 ** round(math.log2(_FIRST_VOXELS / self.volume) / 3)
        self._refine_until(MAX_OWN_ERROR, first)
        self._probe()
        while len(self.trials) < _MAX_TRIALS:
            candidate = self._next()
            if candidate is None:
                # Finer voxels may still meet what no candidate does yet.
                if self._within() or not self._refine():
                    break
                continue
            self._try(candidate)
        return self._choice()

    def _refine_until(self, limit: float, first: float) -> None:
        refinement = first
        # A run that will hardly do shows it by one coarser run: a third one is saved.
        while (
            self._may_run(2 * refinement)
            and self.bench.expected_excess(refinement, self._announce) > limit
        ):
            refinement *= 2
        try:
            self.reference = self._find_reference(refinement)
        except InputError as error:
            if refinement == first:
                raise
            self.progress.line(f"no finer reference: {error}")
            self.reference = self._find_reference(refinement / 2)
        while self.reference.excess > limit and self._refine():
            pass

    def _refine(self) -> bool:
        """Halve the voxels of the reference; False where that is too much."""
        refinement = 2 * self.reference.refinement
        if not self._may_run(refinement):
            return False
        try:
            self.reference = self._find_reference(refinement)
        except InputError as error:
            self.progress.line(f"no finer reference: {error}")
            return False
        return True

    def _may_run(self, refinement: float) -> bool:
        # Of blocks of 2^3 voxels.
        return self.volume * (refinement / 2) ** 3 <= _MOST_NODES

    def _announce(self, text: str) -> None:
        self.progress.stage(f"reference: {text}")

    def _find_reference(self, refinement: float) -> Reference:
        reference = self.bench.reference(refinement, self._announce)
        about = f"reference of {reference.cost['nodes']:,} nodes"
        self.progress.line(f"{about}: off by {reference.excess:.2g} of the tolerance")
        return reference

    def _probe(self) -> None:
        finest = self.reference.refinement / 2
        edge = (self.volume / _PROBE_NODES) ** (1 / 3)
        # The finest voxels take the longest to prepare: once, if others have blocks.
        common = finest / 2
        single = finest
        if edge * common < _FACTORS[2]:
            common, single = single, common
        large = _factor_near(edge * common)
        small = _factor_near(edge * common / 2)
        base = Candidate(common, "aggregate", large, steps=_PROBE_STEPS)
        self._try(base)
        self._try(base._replace(factor=small))
        self._try(base._replace(steps=_FEW_PROBE_STEPS))
        near = _factor_near(edge * single / 2)
        self._try(base._replace(refinement=single, factor=near))
        # Its error in time may be opposite to that of its blocks.
        self._try(base._replace(method="forward_euler", steps=0))
        if not self.trials:
            raise InputError("no candidate can be run: see the messages above")

    def _try(self, candidate: Candidate) -> None:
        words = candidate.words(self.bench.pitches)
        self.progress.stage(words)
        try:
            trial = self.bench.run(candidate, self.reference)
        except InputError as error:
            self.failed.add(candidate)
            self.progress.line(f"{words}: {error}")
            return
        if not self._meets_all(trial):
            # Only those that may win are timed again.
            trial = trial._replace(loop=None)
        self.trials.append(trial)
        self.progress.line(trial.words(self.bench.pitches))

    def _next(self) -> Candidate | None:
        """Candidate that is expected to be the fastest within the tolerance, if any."""
        predictor = Predictor(
            runs=[trial.measured for trial in self.trials],
            errors=self.reference.coarser,
            end=self.bench.scene.time.last,
            volume=self.volume,
            area=self.area,
        )
        done = {trial.measured.candidate for trial in self.trials} | self.failed
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
        refinements = [finest * 2 ** (-power / 2) for power in _COARSENINGS]
        models: list[Candidate] = []
        for refinement in refinements:
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
        time = None
        if within:
            limit = _ALIKE * within[0].measured.run_time
            alike = [trial for trial in within if trial.measured.run_time <= limit]
            self.progress.stage("timing the fastest again")
            times = loop_times(alike, repeats=_REPEATS, dtype=self.bench.scene.dtype)
            pairs = zip(alike, times, strict=True)
            best, time = min(pairs, key=lambda pair: pair[1].median)
        fitting = [t for t in self.trials if self._fits(t)] or self.trials
        nearest = min(fitting, key=lambda trial: trial.measured.error)
        return Choice(
            trials=tuple(self.trials),
            reference=self.reference,
            best=best,
            time=time,
            nearest=nearest,
        )


def _factor_near(target: float) -> int:
    return min(_FACTORS, key=lambda factor: abs(math.log(factor / target)))


def _factors(family: Family) -> tuple[int, ...]:
    if family == "aggregate":
        return _FACTORS
    return _SHELL_FACTORS if family == "shell_over_core" else (1,)
