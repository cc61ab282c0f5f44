"""References of a plan: the error that counts, and what is expected of a run."""

import math
from typing import Any

import numpy as np
import pytest

from calibrate.plan import references as module
from calibrate.plan.predict import Size
from calibrate.plan.references import (
    Reference,
    References,
    about_time,
    counted_error,
    expected_seconds,
)
from calibrate.plan.tolerance import Tolerance
from jaxthermo.accuracy.discretization_error import DiscretizationError
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError


SCENE = SceneConfig.model_validate(
    {
        "bodies": [
            {
                "shape": {"kind": "box", "size": ["40 mm", "40 mm", "30 mm"]},
                "pitch": "2 mm",
                "material": {
                    "conductivity": 16,
                    "density": 8000,
                    "specific_heat": 500,
                },
                "temperature": "300 K",
            }
        ],
        "time": {"end": "60 s", "save_at": [30, 60]},
    }
)
SIZE = Size(volume=6000.0, area=2000.0)


def reference(excess):
    points: Any = None
    empty: Any = {}
    return Reference(
        refinement=1.0,
        points=points,
        own_error=empty,
        percent=excess,
        kelvin=excess,
        excess=excess,
        cost=empty,
        coarser=(),
    )


@pytest.mark.parametrize("excess", [0.0, 0.3, 0.5, 0.8, 1.0])
def test_a_candidate_may_have_what_the_reference_leaves_of_the_tolerance(excess):
    allowed = reference(excess).allowed
    # Errors in the same direction add up; squares of others are a part of that.
    assert allowed + excess == pytest.approx(1.0)
    assert np.hypot(allowed, excess) <= 1.0


@pytest.mark.parametrize("excess", [1.0, 10 / 3, 100.0])
def test_a_reference_that_breaks_the_tolerance_leaves_nothing(excess):
    assert reference(excess).allowed == 0.0


def richardson(order, coefficient=0.4):
    """Estimate for errors c h^p at h = 1, 2 and 4, and half of that at a later time."""
    errors = coefficient * np.array([1.0, 2.0, 4.0]) ** order
    differences = np.stack([np.diff(errors), np.diff(errors) / 2])
    kelvin = np.array([coefficient, coefficient / 2])
    return DiscretizationError(
        times=np.array([1.0, 2.0]),
        rms_kelvin=kelvin,
        # A range of 20 K, then of 5 K.
        rms_percent=100 * kelvin / np.array([20.0, 5.0]),
        order=np.full(2, order),
        is_bound=np.full(2, False),
        differences=differences,
    )


@pytest.mark.parametrize("order", [0.5, 0.8, 1.0])
def test_errors_of_low_order_count_as_they_are_estimated(order):
    percent, kelvin = counted_error(richardson(order))
    assert kelvin == pytest.approx(0.4)
    assert percent == pytest.approx(100 * 0.2 / 5.0)


@pytest.mark.parametrize("order", [1.2, 2.0, 3.0])
def test_errors_of_high_order_count_as_if_they_were_of_the_first(order):
    percent, kelvin = counted_error(richardson(order))
    assert kelvin == pytest.approx(0.4 * (2**order - 1))
    assert percent == pytest.approx(100 * kelvin / 2 / 5.0)


def test_runs_that_agree_have_no_error():
    assert counted_error(richardson(1.0, coefficient=0.0)) == (0.0, 0.0)


@pytest.mark.parametrize("nodes", [1e3, 1e5, 2e6])
def test_times_of_references_are_those_of_the_law_that_they_follow(nodes):
    def law(count):
        return 3.0 + 5e-6 * count ** (4 / 3)

    # The priors count little where runs of many sizes are known.
    measured = [(count, law(count)) for count in (1_000, 8_000, 64_000, 512_000)]
    assert expected_seconds(nodes, measured) == pytest.approx(law(nodes), rel=0.1)
    slower = [(count, 4 * seconds) for count, seconds in measured]
    ratio = expected_seconds(nodes, slower) / expected_seconds(nodes, measured)
    assert ratio == pytest.approx(4.0, rel=0.1)


def test_the_time_of_a_first_run_is_expected_too():
    assert 1.0 < expected_seconds(1000.0, []) < 30.0


def test_durations_are_rough():
    texts = [about_time(seconds) for seconds in (5.2, 43.0, 100.0, 1600.0, 9000.0)]
    assert texts == [
        "about 5 s",
        "about 40 s",
        "about 2 min",
        "about 27 min",
        "about 2.5 h",
    ]


class Runs:
    """Stands for runs of references whose errors fall with the first order."""

    def __init__(self, monkeypatch, fails=()):
        self.refinements = []
        self.fails = fails
        monkeypatch.setattr(module, "refined_run", self._run)
        monkeypatch.setattr(module, "discretization_error", self._error)
        monkeypatch.setattr(module, "truth_points", lambda solution, count: None)

    def _run(self, config, settings, log):
        refinement = 2e-3 / config.bodies[0].pitch
        if any(math.isclose(refinement, failing) for failing in self.fails):
            raise InputError("nothing of the body is in its voxels")
        log("running")
        self.refinements.append(refinement)
        return refinement, {"nodes": 1000, "run_time_s": 2.0}

    def _error(self, finest, middle, coarsest, count, seed):
        assert middle == pytest.approx(finest / 2)
        assert coarsest == pytest.approx(finest / 4)
        return richardson(1.0, coefficient=1.0 / finest)

    def references(self):
        return References(
            SCENE, pitches=(2e-3,), tolerance=Tolerance(kelvin=0.25), size=SIZE
        )


def test_references_become_finer_by_halves_and_each_is_named_before_it_is_run(
    monkeypatch,
):
    runs = Runs(monkeypatch)
    references = runs.references()
    planned = [expected.refinement for expected in references.planned()]
    assert planned == [2.0 ** (power - 1) for power in range(len(planned))]
    assert references.planned()[-1].nodes <= 3e6 < 9 * references.planned()[-1].nodes
    # Two coarser ones show the error of the first.
    assert [expected.refinement for expected in references.needed(0.5)] == planned[:3]
    lines = []
    assert references.refine(lines.append) is None
    assert references.refine(lines.append) is None
    first = references.refine(lines.append)
    assert first is not None and first.refinement == 2.0
    assert first.excess == pytest.approx(0.5 / 0.25)
    assert [e.refinement for e in references.needed(0.5)] == [4.0, 8.0]
    second = references.refine(lines.append)
    assert second is not None and second.excess == pytest.approx(1.0)
    assert runs.refinements == pytest.approx([0.5, 1.0, 2.0, 4.0])
    assert len(lines) == 4 and all("nodes, about" in line for line in lines)


def test_coarse_voxels_that_miss_the_body_are_left_out(monkeypatch):
    runs = Runs(monkeypatch, fails=(1.0,))
    references = runs.references()
    latest = None
    failures = 0
    while latest is None:
        try:
            latest = references.refine(lambda line: None)
        except InputError:
            failures += 1
    assert failures == 1
    assert latest.refinement == 8.0 and runs.refinements == [0.5, 2.0, 4.0, 8.0]
