"""A calibration from its config to its folder."""

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

from .analysis.errors import CaseError, case_errors
from .analysis.experiment_design import advise
from .analysis.fit_card import make_card
from .analysis.identifiability import identify, left_over
from .analysis.speedup import measure_speed
from .config.loader import calibration_hash, load_calibration, plain
from .config.schema import CalibrationConfig
from .problem.build import Built, build
from .problem.problem import Problem, call, jacobian_rows
from .problem.reference import program_hash
from .report.page import write_report
from .report.result import Errors, fit_json
from .solvers.checkpoint import Step
from .solvers.fit import Fit, Fitting, enough_steps
from .solvers.search import Setting
from .solvers.starts import design


STATE, MARKER = "state.npz", "state.txt"
PACKAGES = ("jax", "optimistix", "equinox", "numpy")


class Told:
    """What a calibration says while it runs; silent unless somebody listens."""

    def doing(self, what: str) -> None:
        """Something that takes a while begins."""

    def step(self, step: Step, took: float, most: int) -> None:
        """A step of the fit is done."""


def fit_config(
    path: Path,
    out: Path,
    overrides: tuple[str, ...] = (),
    told: Told | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Fit what a config asks for, and write `fit.json` into a folder.

    Args:
        path: of the config.
        out: folder; a fit that was cut off there goes on.
        overrides: "a.b=c" each.
        told: is told what happens.
        stop: whether to end with the best so far.

    Raises:
        InputError: for a mistake in the config or its data.
    """
    told = Told() if told is None else told
    config = load_calibration(path, overrides)
    with results_folder(out) as folder:
        built = build(config, told.doing)
        state = folder / STATE
        _fresh(folder, config)
        told.doing("compiling")
        setting = settings(config)
        fitting = Fitting(built.train, setting)
        fit = fitting.run(
            start=_start(config, fitting, state, told, stop),
            keep=state,
            tell=lambda step, took: told.step(step, took, setting.most_steps),
            stop=stop,
        )
        result = conclude(config, built, fit, told.doing)
        with replacing(folder / "config.yaml") as target:
            target.write_text(write_yaml(plain(config)), encoding="utf-8")
        write_json(folder / "fit.json", result)
        write_card(folder / "card.yaml", make_card(config, built, fit, result))
        told.doing("drawing the report")
        write_report(folder, built, fit, result)
        if fit.ended != "interrupted":
            for left in (state, folder / MARKER):
                left.unlink(missing_ok=True)
    return result


def _start(
    config: CalibrationConfig,
    fitting: Fitting,
    state: Path,
    told: Told,
    stop: Callable[[], bool],
) -> Float[np.ndarray, " p"] | None:
    """The best of several starts; None for the one that is given, or kept."""
    given, size = config.fit, fitting.problem.parameters.size
    if given.starts == 1 or state.exists():
        return None
    told.doing(f"searching from {given.starts} starts")
    return fitting.best_of(design(given.starts, size, given.spread, given.seed), stop)


def settings(config: CalibrationConfig) -> Setting:
    """Of the search."""
    given = config.fit
    return Setting(
        given.method,
        given.tolerance,
        given.most_steps,
        given.huber,
        int(given.memory * 2**30),
    )


def _fresh(folder: Path, config: CalibrationConfig) -> None:
    """Go on only from a state of the same config."""
    marker = folder / MARKER
    text = f"{calibration_hash(config)} {program_hash(fits=True)}"
    state = folder / STATE
    if state.exists() and (not marker.exists() or marker.read_text() != text):
        state.unlink()
    with replacing(marker) as target:
        target.write_text(text, encoding="utf-8")


def conclude(
    config: CalibrationConfig, built: Built, fit: Fit, doing: Callable[[str], None]
) -> dict[str, Any]:
    """Errors before and after, what the fit is worth, advice and speed."""
    cases = built.train.cases
    errors: Errors = {
        "train": {
            "default": case_errors(cases, fit.initial_errors),
            "fitted": case_errors(cases, fit.errors),
        }
    }
    if built.held_out is not None:
        doing("checking what was held out")
        both = errors_at(built.held_out, [np.zeros_like(fit.z), fit.z])
        errors["held_out"] = dict(zip(("default", "fitted"), both, strict=True))
    sd = left_over(fit.residual, len(fit.z), built.train.known_sd)
    identified = identify(built.train.parameters, fit.z, fit.jacobian, sd)
    told = advise(config, built, fit, sd, doing)
    doing("timing")
    case = cases[0]
    with precision(built.train.dtype.name):
        scene = built.train.scene(case, jnp.asarray(fit.z, built.train.dtype))
    speed = measure_speed(built.configs[case.name], case.scene, scene)
    versions = {name: version(name) for name in PACKAGES}
    return fit_json(config, built, fit, identified, errors, told, speed, versions)


def errors_at(
    problem: Problem, points: list[Float[np.ndarray, " p"]]
) -> list[dict[str, CaseError]]:
    """Of every case, at several points; one program for all.

    Args:
        problem: parameters and cases.
        points: free numbers of each.
    """
    found = []
    with precision(problem.dtype.name):
        layouts = problem.layouts()
        traced = problem.trace(layouts)
        run = eqx.filter_jit(lambda traced, z, layouts: traced(z, layouts)[1])
        for point in points:
            z = jnp.asarray(point, problem.dtype)
            layouts = enough_steps(layouts, problem.stable_steps(z))
            seen = run(traced, z, layouts)
            found.append(case_errors(problem.cases, seen.known_errors()))
    return found


def jacobian(problem: Problem, z: Float[np.ndarray, " p"]) -> Float[np.ndarray, "p r"]:
    """Of the misfits by the free numbers."""
    with precision(problem.dtype.name):
        at = jnp.asarray(z, problem.dtype)
        layouts = enough_steps(problem.layouts(), problem.stable_steps(at))
        program = problem.trace(layouts), layouts
        return np.asarray(jacobian_rows(call, program, at, problem.batch()), float)
