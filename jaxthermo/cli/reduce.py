"""`jaxthermo reduce`: a linear scene as a reduced model, checked if asked for."""

import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from rich.console import Console

from ..arrays import precision
from ..atomic import replacing, write_json
from ..config.loader import config_hash, load_config, resolved, to_yaml
from ..config.schema.scene import SceneConfig
from ..config.types.quantities import NUMBER, to_si
from ..errors import InputError
from ..integrate.run.plan import Plan, initial_state, plan_run
from ..integrate.run.simulate import integrate, run_plan
from ..integrate.run.solution import Solution
from ..integrate.run.time_error import of_pass
from ..integrate.truth_error import truth_error
from ..provenance import processor, provenance
from ..reduction.reduce import reduce as reduce_scene
from ..reduction.reduced_model import ReducedModel
from ..report.numbers import seconds, seconds_with_range, significant
from ..scene.scene import Scene
from ..timing import interleaved
from .console import open_console, print_line, status
from .files import results_folder
from .summary import peak_memory


MODEL = "model.npz"
_RESULTS = (MODEL, "summary.json", "config.yaml")
_REPEATS = 5


def reduce(
    config: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    size: int | None,
    tolerance: str | None,
    method: str,
    check: bool,
) -> None:
    """Reduce the scene of a config and write the model beside a summary.

    Raises:
        InputError: for a mistake in the config or an option, or a term that is not
            linear.
    """
    given, fraction = load_config(config, overrides), _fraction(tolerance)
    console = open_console()
    default = Path("results") / f"{config.stem}-reduced"
    with results_folder(out or default) as folder, precision(given.dtype):
        _check_own_folder(config, folder)
        with status(console, "building the scene"):
            scene = given.build()
        options: dict[str, Any] = {"size": size, "tolerance": fraction}
        log = lambda text: print_line(console, text)
        times = given.time.last, given.time.save_times
        model = reduce_scene(scene, *times, method=method, log=log, **options)
        checked = (
            _checked(console, config=given, scene=scene, model=model) if check else None
        )
        for name in _RESULTS:
            (folder / name).unlink(missing_ok=True)
        model.save(folder / MODEL)
        with replacing(folder / "config.yaml") as path:
            path.write_text(to_yaml(given), encoding="utf-8")
        summary = _summary(given, model, checked)
        write_json(folder / "summary.json", summary)
        for line in _lines(model, summary):
            print_line(console, line)
        print_line(console, f"{MODEL} in {folder}, summary.json beside it")


def _check_own_folder(config: Path, folder: Path) -> None:
    # The results of another command must not be mixed with these, nor the config lost.
    own = folder / "config.yaml"
    if (folder / "solution.npz").exists() or (own.exists() and own.samefile(config)):
        raise InputError(
            f"--out {folder}: holds a run, or the config itself; name another folder"
        )


def _fraction(tolerance: str | None) -> float | None:
    if tolerance is None:
        return None
    try:
        value = to_si(tolerance, NUMBER)
    except InputError as error:
        raise InputError(f"--tolerance: {error}") from error
    if not 0 < value < 1:
        raise InputError(f"--tolerance {tolerance}: give a part of the range, as 0.1%")
    return value


def _summary(
    config: SceneConfig, model: ReducedModel, checked: dict[str, Any] | None
) -> dict[str, Any]:
    about = model.about
    # Measured with the full run in turn, where there is one.
    if checked:
        online = checked.pop("online_loop_s")
    else:
        online = interleaved({"online": _online(model)}, _REPEATS)["online"]
    return {
        "kind": "reduced model",
        **{
            k: list(v) if isinstance(v, tuple) else v
            for k, v in about._asdict().items()
        },
        "online_s": statistics.median(online),
        "online_loop_s": online,
        "inputs": [each._asdict() for each in model.inputs],
        "times_s": list(model.times),
        "truth_error": None,
        **(checked or {}),
        "peak_memory_bytes": peak_memory(),
        "config": resolved(config),
        **provenance(config_hash(config)),
    }


def _online(model: ReducedModel) -> Callable[[], Any]:
    """The compiled model, with the surface read at the saved times."""
    function = jax.jit(model.as_function())
    amplitudes = jnp.asarray(model.amplitudes, model.dtype)
    return lambda: function(amplitudes)


def _checked(
    console: Console, config: SceneConfig, scene: Scene, model: ReducedModel
) -> dict[str, Any]:
    """Error against the full run, and the times of both, measured in turn."""
    with status(console, "running the full scene"):
        times = config.time.last, config.time.save_times
        solver = config.solver.build()
        plan = plan_run(scene, *times, solver, control_error=True)
        full = run_plan(plan)
        error = truth_error(model(), full)
    with status(console, "timing"):
        loop = _full_loop(plan, full)
        spans = interleaved({"full": loop, "online": _online(model)}, _REPEATS)
    return {
        "truth_error": error.as_dict(),
        "full": {
            "nodes": full.receipt.nodes,
            "solver": full.run.solver,
            "steps": full.run.steps,
            "time_error_K": full.run.time_error,
            "loop_s": spans["full"],
        },
        "online_loop_s": spans["online"],
    }


def _full_loop(plan: Plan, full: Solution) -> Callable[[], Any]:
    # Of the pass in which the error in time was met.
    passes = (full.run.steps // max(plan.steps, 1)).bit_length() - 1
    chosen = of_pass(plan, max(passes, 0))
    return lambda: integrate(chosen, initial_state(chosen))


def _lines(model: ReducedModel, summary: dict[str, Any]) -> list[str]:
    about, online = model.about, summary["online_loop_s"]
    inputs = ", ".join(each.name for each in model.inputs) or "no load"
    lines = [
        f"{about.size} vectors for {about.nodes:,} nodes under {inputs}: made in "
        f"{seconds(about.offline_s)}, runs in {_words(online)} on {processor()}",
        f"error of the surface: about {significant(max(about.estimate_kelvin))} K, "
        f"{significant(about.estimate_percent)} % of its range; by the residual at "
        f"most {significant(max(about.residual_bound_kelvin))} K RMS over the volume",
    ]
    error = summary["truth_error"]
    if error is not None:
        full = summary["full"]
        ratio = statistics.median(full["loop_s"]) / statistics.median(online)
        lines.append(
            f"against the full run: {significant(error['worst_rms_kelvin'])} K"
            f"{_percent(error['worst_rms_percent'])} RMS at the worst time; its "
            f"{full['steps']} steps of {full['solver']} take {_words(full['loop_s'])}, "
            f"{significant(ratio)} times as long"
        )
    return lines


def _words(spans: list[float]) -> str:
    return seconds_with_range(statistics.median(spans), min(spans), max(spans))


def _percent(percent: float | None) -> str:
    return "" if percent is None else f" ({significant(percent)} %)"
