"""A calibration from its config to its results folder."""

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.arrays import precision
from jaxthermo.atomic import replacing
from jaxthermo.cli.files import results_folder
from jaxthermo.cli.summary import write_json
from jaxthermo.config.card_file import write_card
from jaxthermo.config.strict_yaml import write_yaml

from .analysis.experiment_design import rank_experiments
from .analysis.fit_card import make_card
from .analysis.identifiability import Identified, identify, residual_sd
from .analysis.speedup import measure_speed
from .config.loader import calibration_hash, load_calibration, plain
from .config.schema import CalibrationConfig
from .problem.build import Calibration, build
from .problem.problem import Case, Problem
from .problem.reference import program_hash
from .problem.targets import CaseError
from .report.page import write_report
from .report.result import Errors, fit_json
from .solvers.broyden import jacobian_rows
from .solvers.checkpoint import StepRecord
from .solvers.fit import Fit, Fitting
from .solvers.multistart import start_points


_CHECKPOINT, _CHECKPOINT_HASH = "state.eqx", "state.txt"
_PACKAGES = ("jax", "optimistix", "equinox", "numpy")


class ProgressLog:
    """Receiver of a calibration's progress; this one ignores it."""

    def stage(self, name: str) -> None:
        """Called before each slow stage."""

    def step(self, step: StepRecord, seconds: float, max_steps: int) -> None:
        """Called after each step, with the seconds that all steps took so far."""


def fit_config(
    path: Path,
    out: Path,
    overrides: tuple[str, ...] = (),
    log: ProgressLog | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Run the fit of a config, and write its results into a folder.

    Args:
        path: of the config.
        out: folder; a fit that was interrupted there is continued.
        overrides: "a.b=c" each.
        log: receives the progress.
        stop: asked before every step if the fit should end with the best so far.

    Returns:
        The content of `fit.json`.

    Raises:
        InputError: for a mistake in the config or its data.
    """
    log = ProgressLog() if log is None else log
    config = load_calibration(path, overrides)
    with results_folder(out) as folder:
        calibration = build(config, log.stage)
        _discard_old_checkpoint(folder, config)
        log.stage("compiling")
        fitting = Fitting(calibration.train, config.fit)
        fit = fitting.run(
            start=_best_start(config, fitting, folder, log, stop),
            checkpoint=folder / _CHECKPOINT,
            log=lambda step, seconds: log.step(step, seconds, config.fit.max_steps),
            stop=stop,
        )
        result = _conclude(config, calibration, fit, log)
        # The results are complete only with the config that made them.
        with replacing(folder / "config.yaml") as target:
            target.write_text(write_yaml(plain(config)), encoding="utf-8")
        write_json(folder / "fit.json", result)
        card = make_card(config, calibration, fit, result)
        write_card(folder / "card.yaml", card)
        log.stage("drawing the report")
        write_report(folder, calibration, fit, result)
        # An interrupted fit continues from its checkpoint.
        if fit.ended != "interrupted":
            for name in (_CHECKPOINT, _CHECKPOINT_HASH):
                (folder / name).unlink(missing_ok=True)
    return result


def _discard_old_checkpoint(folder: Path, config: CalibrationConfig) -> None:
    # A state is only continued with the same config and the same code.
    marker, checkpoint = folder / _CHECKPOINT_HASH, folder / _CHECKPOINT
    text = f"{calibration_hash(config)} {program_hash(with_calibrate=True)}"
    if checkpoint.exists() and (not marker.exists() or marker.read_text() != text):
        checkpoint.unlink()
    with replacing(marker) as target:
        target.write_text(text, encoding="utf-8")


def _best_start(
    config: CalibrationConfig,
    fitting: Fitting,
    folder: Path,
    log: ProgressLog,
    stop: Callable[[], bool],
) -> Float[np.ndarray, " p"] | None:
    # A checkpoint is later than any start.
    fit, size = config.fit, fitting.problem.parameters.size
    if fit.starts == 1 or (folder / _CHECKPOINT).exists():
        return None
    log.stage(f"searching from {fit.starts} starts")
    points = start_points(fit.starts, size, fit.spread, fit.seed)
    return fitting.best_start(points, stop)


def _conclude(
    config: CalibrationConfig, calibration: Calibration, fit: Fit, log: ProgressLog
) -> dict[str, Any]:
    train = calibration.train
    errors: Errors = {
        "train": {
            "default": _case_errors(train.cases, fit.initial_errors),
            "fitted": _case_errors(train.cases, fit.errors),
        }
    }
    if calibration.held_out is not None:
        log.stage("evaluating the held-out cases")
        both = _errors_at(calibration.held_out, [np.zeros_like(fit.z), fit.z])
        errors["held_out"] = dict(zip(("default", "fitted"), both, strict=True))
    sd = residual_sd(fit.residual, len(fit.z), train.known_sd)
    identified = identify(train.parameters, fit.z, fit.jacobian, sd)
    advice = rank_experiments(config, calibration, fit, sd, log.stage)
    log.stage("timing")
    case = train.cases[0]
    with precision(train.dtype.name):
        z = jnp.asarray(fit.z, train.dtype)
        scene = train.parameters.insert(case.scene, z)
    # The first case stands for all of them.
    speed = measure_speed(calibration.configs[case.name], case.scene, scene)
    versions = {name: version(name) for name in _PACKAGES}
    return fit_json(
        config, train.parameters, fit, identified, errors, advice, speed, versions
    )


def _case_errors(
    cases: tuple[Case, ...], errors: tuple[Float[np.ndarray, " t"], ...]
) -> dict[str, CaseError]:
    pairs = zip(cases, errors, strict=True)
    return {case.name: case.target.case_error(found) for case, found in pairs}


def _errors_at(
    problem: Problem, points: list[Float[np.ndarray, " p"]]
) -> list[dict[str, CaseError]]:
    # One compiled program for all points.
    found, step_tables = [], None
    with precision(problem.dtype.name):
        traced = problem.trace(problem.step_tables())
        run = eqx.filter_jit(lambda traced, z, step_tables: traced(z, step_tables)[1])
        for point in points:
            z = jnp.asarray(point, problem.dtype)
            step_tables = problem.step_tables_at(z, step_tables)
            diagnostics = run(traced, z, step_tables)
            found.append(_case_errors(problem.cases, diagnostics.host_errors()))
    return found


def identify_start(
    config: CalibrationConfig, log: ProgressLog
) -> tuple[Identified, dict[str, CaseError], bool]:
    """Judge the parameters at the start, without a fit.

    Returns:
        The judgement, the error of each case, and if the noise of the data is known.
    """
    problem = build(config, log.stage).train
    log.stage("computing derivatives")
    z = np.zeros(problem.parameters.size)
    with precision(problem.dtype.name):
        at = jnp.asarray(z, problem.dtype)
        step_tables = problem.step_tables_at(at)
        traced = problem.trace(step_tables)
        rows = jacobian_rows(traced, step_tables, at, problem.batch())
        rows = np.asarray(rows, float)
    log.stage("evaluating the start")
    errors = _errors_at(problem, [z])[0]
    sd = problem.known_sd
    if sd is None:
        # As if a fit left all of the start's error, spread over the residuals.
        squares = sum(np.mean(np.square(e.percent)) for e in errors.values())
        total = float(np.sqrt(squares / len(errors)))
        each = np.full(rows.shape[1], total / rows.shape[1] ** 0.5)
        sd = residual_sd(each, len(z), None)
    found = identify(problem.parameters, z, rows, sd)
    return found, errors, problem.known_sd is not None
