"""A calibration from its config to its results folder."""

from collections.abc import Callable, ItemsView
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.arrays import precision
from jaxthermo.atomic import write_text
from jaxthermo.config.card_file import write_card
from jaxthermo.config.loader import resolved, to_yaml
from jaxthermo.console.results_folder import results_folder
from jaxthermo.parallel.devices import check_devices
from jaxthermo.progress import SILENT, Progress
from jaxthermo.provenance import provenance

from .analysis.experiment_design import rank_experiments
from .analysis.fit_card import make_card
from .analysis.identifiability import Identified, identify
from .analysis.judgement import judge_values
from .analysis.misfit import held_out_differences
from .analysis.shared_errors import check_declared, declared
from .analysis.truth import Truth
from .analysis.verdict import judge
from .config.fit_record import (
    Advice,
    FitRecord,
    Group,
    Pair,
    ParameterRow,
    write_fit,
)
from .config.loader import calibration_hash, load_calibration
from .config.schema import CalibrationConfig, shown_unit_of, unit_of
from .problem.build import Calibration
from .problem.parameters import ParameterSet
from .problem.reference import Log, program_hash
from .problem.targets import CaseError
from .report.page import write_report
from .solvers.cameras import build_aligned
from .solvers.fit import Fit, Fitting
from .solvers.levenberg_marquardt import jacobian_rows
from .solvers.noise_scale import residual_sd
from .solvers.progress import StepRecord
from .solvers.search import start_points
from .solvers.starts import SearchEnds, load_ends, search_starts
from .study.times import measure_speed


_CHECKPOINT = "state.npz"
_CHECKPOINT_HASH = "state.txt"
_ENDS = "starts.npz"


def fit_config(
    path: Path,
    out: Path,
    overrides: tuple[str, ...] = (),
    progress: Progress = SILENT,
    stop: Callable[[], bool] = lambda: False,
    report: bool = True,
    devices: int = 1,
) -> FitRecord:
    """Run the fit of a config, write its results, and return those of `fit.json`.

    Args:
        path: of the config.
        out: folder; a fit that was interrupted there is continued.
        overrides: "a.b=c" each.
        progress: receives the progress.
        stop: called before every step; if it returns True, the fit ends with the best
            so far.
        report: False to leave out the page and the advice on further cases.
        devices: number of devices that share derivatives and starts.

    Raises:
        InputError: for a mistake in the config or its data, or if the fit cannot be
            shared by so many devices.
    """
    check_devices(devices)
    config = load_calibration(path, overrides)
    check_declared(config)
    settings = config.fit

    def tell(step: StepRecord) -> None:
        progress.reach(step.number, f"step {step.number}: {step.outcome_words}")

    with results_folder(out) as folder:
        calibration = build_aligned(config, progress.stage)
        # Before the fit, so that references that cannot be run are reported at once.
        truth = Truth.prepare(config, calibration, progress.stage)
        _discard_old_checkpoint(folder, config)
        progress.stage("compiling")
        fitting = Fitting(calibration.train, settings, devices=devices)
        ends = None
        if settings.starts > 1:
            ends = _ends_of_starts(fitting, folder / _ENDS, progress, stop)
        start = None if ends is None else ends.best
        # A fit usually converges long before its step limit: an upper bound.
        progress.stage("fitting", settings.max_steps)
        fit = fitting.run(
            start=start, checkpoint=folder / _CHECKPOINT, log=tell, stop=stop
        )
        result = _conclude(
            config,
            calibration=calibration,
            truth=truth,
            fit=fit,
            ends=ends,
            log=progress.stage,
            advise=report,
        )
        # The results are complete only with the config that made them.
        write_text(folder / "config.yaml", to_yaml(config))
        write_fit(folder / "fit.json", result)
        card = make_card(config, calibration=calibration, fit=fit, result=result)
        write_card(folder / "card.yaml", card)
        if report:
            progress.stage("drawing the report")
            write_report(folder, calibration=calibration, fit=fit, result=result)
        # An interrupted fit continues from its checkpoint.
        if fit.ended != "interrupted":
            for name in (_CHECKPOINT, _CHECKPOINT_HASH, _ENDS):
                (folder / name).unlink(missing_ok=True)
    return result


def _ends_of_starts(
    fitting: Fitting, path: Path, progress: Progress, stop: Callable[[], bool]
) -> SearchEnds:
    """Ends of searches from several starts, those of an interrupted fit if stored."""
    if path.exists():
        return load_ends(path)
    settings = fitting.settings
    progress.stage(f"searching from {settings.starts} starts")
    points = start_points(
        settings.starts,
        size=fitting.problem.parameters.size,
        spread=settings.spread,
        seed=settings.seed,
    )
    ends = search_starts(fitting, points, stop, progress.line)
    # Searches that were stopped are to be repeated.
    if not stop():
        ends.save(path)
    return ends


def _discard_old_checkpoint(folder: Path, config: CalibrationConfig) -> None:
    # A state is only continued with the same config and the same code.
    marker = folder / _CHECKPOINT_HASH
    text = f"{calibration_hash(config)} {program_hash(with_calibrate=True)}"
    if not marker.exists() or marker.read_text() != text:
        for name in (_CHECKPOINT, _ENDS):
            (folder / name).unlink(missing_ok=True)
    write_text(marker, text)


def _conclude(
    config: CalibrationConfig,
    calibration: Calibration,
    truth: Truth | None,
    fit: Fit,
    ends: SearchEnds | None,
    log: Log,
    advise: bool,
) -> FitRecord:
    train = calibration.train
    errors = _errors_by_group(calibration, fit, log)
    by_case = _summed_up(errors, lambda cases: {n: e.as_json() for n, e in cases})
    sd = residual_sd(fit.residual, len(fit.z), train.known_sd)
    # Without a Jacobian there are too many values for a row each.
    judged = fit.jacobian is not None
    differences = ()
    if calibration.held_out is not None:
        fitted_errors = errors["held_out"]["fitted"]
        differences = held_out_differences(calibration.held_out, fitted_errors)
    uncertainties = declared(config)
    judgement = judge_values(
        train,
        fit=fit,
        uncertainties=uncertainties,
        differences=differences,
        ends=ends,
    )
    identified = judgement.identified
    misfit = judgement.misfit
    advice: list[Advice] = []
    if advise:
        advice = rank_experiments(
            config, calibration=calibration, fit=fit, sd=sd, log=log
        )
    log("timing")
    # The first case stands for all of them.
    case = train.cases[0]
    speed = measure_speed(
        calibration.configs[case.name],
        default=case.scene,
        fitted=calibration.scene_at(case.name, fit.z),
    )
    against_truth = None if truth is None else truth.judge(fit.z, log)
    verdict = judge(
        by_case,
        speedup=speed,
        is_of_weights=_fits_weights(train.parameters),
        truth=against_truth,
        differences=misfit.differences,
        elsewhere=judgement.elsewhere,
        away=[v.label for v in identified.verdicts if v.verdict == "not converged"],
    )
    start = np.asarray(train.parameters.flat_values(np.zeros_like(fit.z)), float)
    if judged:
        rows = parameter_rows(identified, start)
    else:
        rows = _field_rows(train.parameters, identified=identified, start=start)
    return FitRecord(
        name=config.name,
        verdict=verdict,
        parameters=rows,
        loss={"initial": fit.initial_loss, "final": fit.loss},
        ended=fit.ended,
        error_percent=_summed_up(errors, lambda cases: max(e.worst for _, e in cases)),
        errors=by_case,
        truth=against_truth,
        # Digits beyond these would only make the file longer.
        correlation=np.round(identified.correlation, 6).tolist(),
        singular_values=identified.singular_values.tolist(),
        advice=advice,
        speedup=speed,
        steps=[step.as_json(with_values=judged) for step in fit.steps],
        run_time_s={
            "fit": fit.step_seconds,
            "one_run": fit.run_seconds,
            "compile": fit.compile_seconds,
        },
        reference=config.reference.kind,
        config=resolved(config),
        program_hash=program_hash(),
        **provenance(calibration_hash(config), config.fit.seed),
        by_clusters=judgement.by_clusters,
        widening=misfit.widening,
        residuals=list(misfit.scales),
        shared_errors=uncertainties,
    )


_CaseErrors = dict[str, CaseError]


def _errors_by_group(
    calibration: Calibration, fit: Fit, log: Log
) -> dict[Group, Pair[_CaseErrors]]:
    train = calibration.train
    default = train.default()
    # The fit has run the scene's own values where it started from them.
    if fit.start is not None and np.array_equal(default, fit.start):
        before_training = train.case_errors(fit.initial_errors)
    else:
        before_training = train.errors_at([default])[0]
    errors: dict[Group, Pair[_CaseErrors]] = {
        "train": {
            "default": before_training,
            "fitted": train.case_errors(fit.errors),
        }
    }
    if calibration.held_out is not None:
        log("evaluating the held-out cases")
        before, after = calibration.held_out.errors_at([default, fit.z])
        errors["held_out"] = {"default": before, "fitted": after}
    return errors


def _summed_up(
    errors: dict[Group, Pair[_CaseErrors]],
    value: Callable[[ItemsView[str, CaseError]], Any],
) -> Any:
    """Errors of all cases as a value, with the scene's own and the fitted values."""
    return {
        group: {
            "default": value(pair["default"].items()),
            "fitted": value(pair["fitted"].items()),
        }
        for group, pair in errors.items()
    }


class _StartJudgement(NamedTuple):
    """Judgement of how well the data determine the start values of a fit."""

    identified: Identified
    errors: _CaseErrors
    """Error of each case by its name."""
    noise_is_known: bool


def identify_start(config: CalibrationConfig, log: Log) -> _StartJudgement:
    """Judge the start values of a fit, before anything is fitted."""
    problem = build_aligned(config, log).train
    log("computing derivatives")
    z = np.zeros(problem.parameters.size)
    with precision(problem.dtype.name):
        at = jnp.asarray(z, problem.dtype)
        step_tables = problem.step_tables_at(at)
        rows = jacobian_rows(
            problem.trace(step_tables),
            args=(step_tables, problem.views_at(at)),
            z=at,
            batch=problem.batch(),
        )
        rows = np.asarray(rows, float)
    log("evaluating the start")
    errors = problem.errors_at([z])[0]
    sd = problem.known_sd
    if sd is None:
        # The start's error, spread evenly over the residuals, stands for a remainder.
        squares = sum(np.mean(np.square(e.percent)) for e in errors.values())
        total = float(np.sqrt(squares / len(errors)))
        residual = np.full(rows.shape[1], total / rows.shape[1] ** 0.5)
        sd = residual_sd(residual, len(z), None)
    identified = identify(problem.parameters, z=z, jacobian=rows, sd=sd)
    return _StartJudgement(
        identified=identified,
        errors=errors,
        noise_is_known=problem.known_sd is not None,
    )


def _fits_weights(parameters: ParameterSet) -> bool:
    names = (parameter.name.split(".") for parameter in parameters.parameters)
    return any("weights" in words for words in names)


def parameter_rows(
    identified: Identified, start: Float[np.ndarray, " p"]
) -> dict[str, ParameterRow]:
    """A row for every value, by its label."""
    rows: dict[str, ParameterRow] = {}
    for verdict, initial in zip(identified.verdicts, start, strict=True):
        unit, size = shown_unit_of(verdict.label)
        error = verdict.standard_error
        rows[verdict.label] = {
            "value": verdict.value / size,
            "initial": float(initial) / size,
            "standard_error": None if error is None else error / size,
            "verdict": verdict.verdict,
            "with": list(verdict.with_others),
            "unit": unit,
        }
    return rows


def _field_rows(
    parameters: ParameterSet, identified: Identified, start: Float[np.ndarray, " p"]
) -> dict[str, ParameterRow]:
    # A row for every field of thousands of values, all of which are in the card.
    rows: dict[str, ParameterRow] = {}
    first = 0
    values = np.array([verdict.value for verdict in identified.verdicts])
    for parameter in parameters.parameters:
        indices = slice(first, first + parameter.size)
        rows[parameter.name] = {
            "value": float(np.median(values[indices])),
            "initial": float(np.median(start[indices])),
            "standard_error": None,
            "verdict": identified.verdicts[first].verdict,
            "with": [],
            "unit": unit_of(parameter.name),
            "count": parameter.size,
            "min": float(values[indices].min()),
            "max": float(values[indices].max()),
        }
        first += parameter.size
    return rows
