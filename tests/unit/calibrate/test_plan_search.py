"""The search of a plan on a law of errors and times, without any run of a scene."""

import math
from typing import Any, NamedTuple

import pytest
from test_plan import AREA, END, VOLUME, law

from calibrate.plan import search as module
from calibrate.plan.candidate import Candidate
from calibrate.plan.command import _miss, _words
from calibrate.plan.predict import Size
from calibrate.plan.references import Expected, Reference, References
from calibrate.plan.search import _Search
from calibrate.plan.tolerance import Tolerance
from calibrate.plan.trial import Bench, Trial
from calibrate.study.rows import Rows
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.progress import Progress
from jaxthermo.timing import Spread


PITCHES = (0.01,)
SCENE = SceneConfig.model_validate(
    {
        "bodies": [
            {
                "shape": {"kind": "sphere", "radius": "0.25 m"},
                "pitch": PITCHES[0],
                "material": {
                    "conductivity": 16,
                    "density": 8000,
                    "specific_heat": 500,
                },
                "temperature": "300 K",
            }
        ],
        "time": {"end": END, "save_at": [END]},
    }
)


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr(module, "FAMILIES", ("aggregate",))
    monkeypatch.setattr(module, "_COARSENINGS", (0, 2))
    monkeypatch.setattr(module, "_STEPS", (8, 24))
    monkeypatch.setattr(module, "_IMPLICIT_STEPS", (18,))


class Clock:
    """A clock that stands still but for what is run."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(module.time, "perf_counter", lambda: self.now)


class FakeReferences(References):
    """References whose error over the tolerance is halved with their voxels."""

    def __init__(self, excess, finest=8.0, seconds=1.0, clock=None):
        self.size = Size(VOLUME, AREA)
        self.excess = excess
        self.finest = finest
        self.seconds = seconds
        self.clock = clock
        self.refinement = 1.0
        self.ran = []

    def planned(self):
        left = []
        refinement = self.refinement
        while refinement <= self.finest:
            left.append(Expected(refinement, nodes=1000, seconds=self.seconds))
            refinement *= 2
        return left

    def needed(self, limit):
        return self.planned()[:1]

    def refine(self, log):
        log(f"of {self.refinement:g}")
        self.ran.append(self.refinement)
        if self.clock is not None:
            self.clock.now += self.seconds
        points: Any = None
        cost: Any = {"nodes": 1000, "pitch_m": [0.01]}
        errors: Any = {}
        excess = self.excess / self.refinement
        reference = Reference(
            refinement=self.refinement,
            points=points,
            own_error=errors,
            percent=3 * excess,
            kelvin=excess,
            excess=excess,
            cost=cost,
            coarser=(),
        )
        self.refinement *= 2
        return reference


class FakeBench(Bench):
    """A bench whose candidates follow the law of `test_plan`."""

    def __init__(self, path, tolerance, stop_after=math.inf, clock=None):
        rows = Rows(path / "rows.jsonl", "program")
        super().__init__(SCENE, pitches=PITCHES, tolerance=tolerance, rows=rows)
        self.rows = rows
        self.stop_after = stop_after
        self.clock = clock
        self.ran: list[Candidate] = []

    def _run(self, candidate, reference):
        if len(self.ran) == self.stop_after:
            raise KeyboardInterrupt
        self.ran.append(candidate)
        if self.clock is not None:
            self.clock.now += 10.0
        measured = law(candidate)
        percent = measured.error
        excess = self.tolerance.excess(percent, kelvin=percent / 3)
        return Trial(
            measured=measured._replace(error=excess),
            percent=percent,
            kelvin=percent / 3,
            refinement=reference.refinement,
            allowed=reference.allowed,
            took=10.0,
        )

    def times(self, candidates, repeats):
        return [Spread.of([law(candidate).run_time]) for candidate in candidates]


class Lines(Progress):
    """Keeps the lines that are told."""

    def __init__(self):
        self.lines = []

    def line(self, text):
        self.lines.append(text)


class Outcome(NamedTuple):
    choice: module.Choice
    bench: FakeBench
    lines: list[str]


def searched(bench, references, deadline=math.inf) -> Outcome:
    progress = Lines()
    try:
        choice = _Search(
            bench, references=references, deadline=deadline, progress=progress
        )()
    finally:
        bench.rows.close()
    return Outcome(choice, bench, progress.lines)


THREE_PERCENT = Tolerance(percent=3.0)


def test_the_error_of_the_choice_and_of_its_reference_are_within_the_tolerance(
    tmp_path,
):
    references = FakeReferences(excess=0.9)
    choice = searched(FakeBench(tmp_path, THREE_PERCENT), references).choice
    assert references.ran == [1.0, 2.0]
    assert choice.best is not None and choice.is_complete
    assert choice.best.percent / 3 + choice.reference.excess <= 1.0


def test_a_finer_reference_is_run_where_the_latest_leaves_too_little(tmp_path):
    references = FakeReferences(excess=3.3)
    choice = searched(FakeBench(tmp_path, THREE_PERCENT), references).choice
    assert references.ran == [1.0, 2.0, 4.0, 8.0]
    assert choice.best is not None and choice.reference.excess < 0.5


@pytest.mark.parametrize(("seconds", "count"), [(40.0, 2), (60.0, 1)])
def test_a_slow_reference_is_run_only_where_it_changes_much(tmp_path, seconds, count):
    references = FakeReferences(excess=0.58, seconds=seconds)
    searched(FakeBench(tmp_path, Tolerance(percent=30.0)), references)
    assert len(references.ran) == count


def test_nothing_is_within_a_tolerance_that_the_reference_breaks(tmp_path):
    # 3 %, and a finest reference that is off by 10 %.
    references = FakeReferences(excess=10 / 3, finest=1.0)
    bench = FakeBench(tmp_path, THREE_PERCENT)
    choice = searched(bench, references).choice
    assert choice.best is None and choice.nearest is None and not bench.ran
    miss = _miss(choice, THREE_PERCENT, PITCHES)
    assert "reference is itself off by 10 %" in miss and "3.33 times" in miss
    assert _words(choice, PITCHES)[0].endswith("Finer ones would take too long.")


def test_a_reference_that_leaves_little_lets_only_accurate_models_through(tmp_path):
    references = FakeReferences(excess=0.95, finest=1.0)
    choice = searched(FakeBench(tmp_path, THREE_PERCENT), references).choice
    limit = 0.05 * 3
    assert choice.best is None or choice.best.percent <= limit
    if choice.best is None:
        assert choice.nearest is not None
        total = choice.nearest.percent / 3 + 0.95
        miss = _miss(choice, THREE_PERCENT, PITCHES)
        assert f"{total:.3g} times the tolerance" in miss


def test_the_plan_and_its_time_are_told_before_anything_is_run(tmp_path):
    lines = searched(
        FakeBench(tmp_path, THREE_PERCENT), FakeReferences(excess=0.9)
    ).lines
    assert lines[0].count("about 1,000 nodes, about 1 s") == 4
    assert "candidates" in lines[1] and lines[1].count("about ") == 3
    # Each reference is named before it is run.
    assert [line for line in lines if line.startswith("reference: ")] == [
        "reference: of 1",
        "reference: of 2",
    ]
    assert lines.index("reference: of 1") == 2


@pytest.mark.parametrize("done", [0, 5])
def test_a_stopped_search_goes_on_where_it_was(tmp_path, done):
    whole_folder = tmp_path / "whole"
    stopped_folder = tmp_path / "stopped"
    whole_folder.mkdir()
    stopped_folder.mkdir()
    whole = searched(FakeBench(whole_folder, THREE_PERCENT), FakeReferences(0.9))
    assert len(whole.bench.ran) > 5
    stopped = FakeBench(stopped_folder, THREE_PERCENT, stop_after=done)
    with pytest.raises(KeyboardInterrupt):
        searched(stopped, FakeReferences(0.9))
    resumed = searched(FakeBench(stopped_folder, THREE_PERCENT), FakeReferences(0.9))
    assert [*stopped.ran, *resumed.bench.ran] == whole.bench.ran
    assert resumed.choice.best == whole.choice.best
    assert resumed.choice.trials == whole.choice.trials


def test_another_tolerance_uses_the_candidates_again(tmp_path):
    searched(FakeBench(tmp_path, THREE_PERCENT), FakeReferences(0.9))
    earlier = Rows(tmp_path / "rows.jsonl", "program")
    earlier.close()
    # The reference is the same, and its error is less of a wider tolerance.
    wider = Tolerance(percent=6.0)
    references = FakeReferences(0.9)
    references.refinement = 2.0
    outcome = searched(FakeBench(tmp_path, wider), references)
    assert outcome.choice.best is not None
    assert len(outcome.bench.ran) <= len(outcome.choice.trials) - 4
    excess = outcome.choice.best.measured.error
    assert excess == pytest.approx(outcome.choice.best.percent / 6)


def test_a_search_ends_with_the_best_that_it_knows_by_then(tmp_path, monkeypatch):
    clock = Clock(monkeypatch)
    whole_folder = tmp_path / "whole"
    whole_folder.mkdir()
    whole = searched(FakeBench(whole_folder, THREE_PERCENT), FakeReferences(0.9))
    clock.now = 0.0
    bench = FakeBench(tmp_path, THREE_PERCENT, clock=clock)
    references = FakeReferences(0.9, seconds=1.0, clock=clock)
    outcome = searched(bench, references, deadline=55.0)
    # Two references of 1 s, then candidates of 10 s each.
    assert bench.ran == whole.bench.ran[:5] and clock.now <= 55.0
    choice = outcome.choice
    within = [trial for trial in choice.trials if trial.is_within]
    assert choice.best is min(within, key=lambda trial: trial.measured.run_time)
    assert not choice.is_complete
    assert "ended by its time" in " ".join(_words(choice, PITCHES))
    # The same command goes on from there.
    clock.now = 0.0
    later = searched(FakeBench(tmp_path, THREE_PERCENT), FakeReferences(0.9))
    assert later.choice.best == whole.choice.best and later.choice.is_complete
    assert later.bench.ran == whole.bench.ran[5:]


def test_a_reference_that_takes_longer_than_the_search_is_not_begun(
    tmp_path, monkeypatch
):
    clock = Clock(monkeypatch)
    bench = FakeBench(tmp_path, THREE_PERCENT, clock=clock)
    references = FakeReferences(0.9, seconds=60.0, clock=clock)
    outcome = searched(bench, references, deadline=150.0)
    assert references.ran == [1.0] and len(bench.ran) > 3
    assert any(line.startswith("no finer reference") for line in outcome.lines)
    assert outcome.choice.reference.excess == pytest.approx(0.9)
    assert not outcome.choice.is_complete


def test_without_any_time_the_first_reference_is_all_that_is_known(
    tmp_path, monkeypatch
):
    clock = Clock(monkeypatch)
    bench = FakeBench(tmp_path, THREE_PERCENT, clock=clock)
    references = FakeReferences(0.4, clock=clock)
    choice = searched(bench, references, deadline=0.5).choice
    assert references.ran == [1.0] and choice.best is None and not bench.ran
    miss = _miss(choice, THREE_PERCENT, PITCHES)
    assert "no candidate was run" in miss and "--search-time" in miss
