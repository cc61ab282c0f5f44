"""No fit is "fine" beside a wrong value: from random starts, and of damaged frames."""

import collections
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from calibrate.analysis.judgement import judge_values
from calibrate.config.loader import load_calibration
from calibrate.config.schema import FitConfig
from calibrate.problem.build import Calibration, build
from calibrate.problem.targets import FrameTarget
from calibrate.solvers.fit import Fit, Fitting
from jaxthermo.errors import InputError
from jaxthermo.image.files.thermogram_files import read_thermogram
from tests.frame_damages import FrameSet, damaged_sets


CONTROL = Path(__file__).parents[1] / "data/frames_and_api/00-works-celsius-tiff"
STARTS = 100
ENOUGH = 95
"""Starts that end at the control's values."""
SETTINGS = FitConfig(max_steps=50)
TIGHT = FitConfig(max_steps=50, tolerance=1e-6)
RANGES = {
    "material.conductivity": (2.0, 200.0),
    "convection.heat_transfer_coefficient": (3.0, 300.0),
}
NEAR = 2.0
FAR = 4.0
"""Distances from the control's values [standard error]."""


class Control(NamedTuple):
    """The control, whose search and programs serve all others of its pixels."""

    calibration: Calibration
    fitting: Fitting
    values: np.ndarray
    standard_errors: np.ndarray

    @property
    def target(self) -> FrameTarget:
        """Its frames."""
        target = self.calibration.train.cases[0].target
        assert isinstance(target, FrameTarget)
        return target


class Outcome(NamedTuple):
    """What a fit says."""

    verdicts: tuple[str, ...]
    values: np.ndarray
    standard_errors: np.ndarray
    """Those of values without one are infinite."""
    ended: str
    words: str
    """Why it is not to be trusted."""


def _built(path: Path) -> Calibration:
    return build(load_calibration(path, ()), lambda stage: None)


def _judged(fitting: Fitting, fit: Fit) -> Outcome:
    judgement = judge_values(fitting.problem, fit=fit, uncertainties={})
    verdicts = judgement.identified.verdicts
    errors = [
        np.inf if v.standard_error is None else v.standard_error for v in verdicts
    ]
    return Outcome(
        verdicts=tuple(v.verdict for v in verdicts),
        values=np.array([v.value for v in verdicts]),
        standard_errors=np.array(errors),
        ended=fit.ended,
        words="; ".join(judgement.misfit.differences),
    )


@pytest.fixture(scope="module")
def control():
    """The control's own fit."""
    calibration = _built(CONTROL / "calibration.yaml")
    fitting = Fitting(calibration.train, SETTINGS)
    outcome = _judged(fitting, fitting.run())
    assert outcome.verdicts == ("fine", "fine")
    return Control(
        calibration=calibration,
        fitting=fitting,
        values=outcome.values,
        standard_errors=outcome.standard_errors,
    )


@pytest.mark.slow
def test_the_control_is_what_its_readme_says(control):
    np.testing.assert_allclose(control.values, [19.84, 29.52], rtol=1e-3)


@pytest.mark.slow
def test_random_starts_end_at_the_control_or_say_why(control):
    rng = np.random.default_rng(18)
    lower, upper = np.log(np.array([*RANGES.values()])).T
    starts = np.exp(rng.uniform(lower, upper, (STARTS, len(RANGES))))
    assert control.calibration.parameters.labels == tuple(RANGES)
    near = 0
    said = []
    wrong = []
    for start in starts:
        values = dict(zip(RANGES, start, strict=True))
        z = np.asarray(control.calibration.parameters.coordinates(values), float)
        try:
            outcome = _judged(control.fitting, control.fitting.run(start=z))
        except InputError as error:
            said.append(f"{start}: {error}")
            continue
        away = np.abs(outcome.values - control.values) / control.standard_errors
        if (away <= NEAR).all():
            near += 1
            continue
        words = f"{start}: {outcome.ended}, {outcome.values}, {outcome.verdicts}"
        (wrong if "fine" in outcome.verdicts else said).append(words)
    print(f"{near} of {STARTS} starts end at the control's values")
    print(*said, *wrong, sep="\n")
    assert not wrong
    assert near >= ENOUGH


@pytest.mark.slow
def test_a_declared_error_of_the_emissivity_is_what_a_fit_with_it_is_off_by(control):
    """Of 0.2 %, over which values are linear in it."""
    relative = 2e-3
    path = CONTROL / "calibration.yaml"
    change = f"set.bodies.0.material.emissivity={0.95 * (1 + relative)}"
    other = build(load_calibration(path, (change,)), lambda stage: None)
    moved = np.asarray(other.parameters.flat_values(_fit(other).z), float)
    fit = _fit(control.calibration)
    judged = judge_values(
        control.calibration.train, fit=fit, uncertainties={"emissivity": relative}
    ).identified
    values = np.array([v.value for v in judged.verdicts])
    errors = np.array([v.standard_error or np.nan for v in judged.verdicts])
    shared = np.sqrt(errors**2 - control.standard_errors**2)
    np.testing.assert_allclose(np.abs(moved - values), shared, rtol=0.1)


def _fit(calibration: Calibration) -> Fit:
    return Fitting(calibration.train, TIGHT).run()


def _fit_of(control: Control, frame_set: FrameSet) -> Outcome | str:
    """Judgement of the fit to a frame set, or the line that refuses it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            calibration = _built(frame_set.config)
            target = calibration.train.cases[0].target
            assert isinstance(target, FrameTarget)
            pixels = np.asarray(target.indices[0])
            if np.array_equal(pixels, np.asarray(control.target.indices[0])):
                # Other data are other residuals of the same program.
                change = np.subtract(
                    control.target.data[0], target.data[0], dtype=float
                )
                noise = change.reshape(-1) / target.noise / target.pixel_count**0.5
                fitting = control.fitting
                return _judged(fitting, fitting.run(noise=noise))
            fitting = Fitting(calibration.train, SETTINGS)
            return _judged(fitting, fitting.run())
        except InputError as error:
            return str(error)


@pytest.mark.slow
def test_damaged_frames_never_end_in_fine_beside_a_wrong_value(control, tmp_path):
    files = [CONTROL / name for name in ("f60.tiff", "f240.tiff")]
    kelvin = np.stack([read_thermogram(path, "celsius") for path in files])
    sets = damaged_sets(
        CONTROL, kelvin, np.asarray(control.target.indices[0]), tmp_path
    )
    assert len(sets) == 60
    counts = collections.Counter()
    wrong = []
    for frame_set in sets:
        outcome = _fit_of(control, frame_set)
        if isinstance(outcome, str):
            assert "\n" not in outcome
            counts["refused"] += 1
            print(f"{frame_set.name}: refused: {outcome}")
            continue
        away = np.abs(outcome.values - control.values)
        fine = np.array([verdict == "fine" for verdict in outcome.verdicts])
        counts["fine" if fine.all() else "not fine"] += 1
        print(
            f"{frame_set.name}: {outcome.verdicts}, {outcome.values} "
            f"+- {outcome.standard_errors}, {outcome.words}"
        )
        if (fine & (away > FAR * outcome.standard_errors)).any():
            wrong.append(frame_set.name)
    print(counts)
    assert not wrong
