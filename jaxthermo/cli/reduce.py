"""`jaxthermo reduce`: a linear scene as a reduced model, with an optional check."""

import functools
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from rich.console import Console

from ..accuracy.error_records import finite_number
from ..accuracy.truth_error import TruthError, truth_error
from ..arrays import precision
from ..atomic import write_json, write_text
from ..choices import ReductionMethod
from ..config.loader import config_hash, load_config, resolved, to_yaml
from ..config.schema.scene import SceneConfig
from ..config.types.quantities import NUMBER, to_si
from ..console.results_folder import results_folder
from ..console.terminal import open_console, print_line, status
from ..errors import InputError, located
from ..integrate.run.plan import Plan, plan_run
from ..integrate.run.simulate import run_plan
from ..integrate.run.solution import Solution
from ..integrate.run.time_error import of_pass
from ..provenance import processor, provenance
from ..reduction.reduce import reduce as reduce_scene
from ..reduction.reduced_model import ReducedModel
from ..report.numbers import seconds, seconds_with_range, significant
from ..scene.scene import Scene
from .summary import peak_memory


_MODEL = "model.npz"
_RESULTS = (_MODEL, "summary.json", "config.yaml")
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
    """Reduce the scene of a config and write the model and a summary.

    Raises:
        InputError: for a mistake in the config or an option, or a term that is not
            linear.
    """
    scene_config = load_config(config, overrides)
    fraction = _fraction(tolerance)
    console = open_console()
    default = Path("results") / f"{config.stem}-reduced"
    with results_folder(out or default) as folder, precision(scene_config.dtype):
        _check_own_folder(config, folder)
        with status(console, "building the scene"):
            scene = scene_config.build()
        model = reduce_scene(
            scene,
            t1=scene_config.time.last,
            save_at=scene_config.time.save_times,
            # Refused there, if it is none.
            method=cast(ReductionMethod, method),
            log=functools.partial(print_line, console),
            size=size,
            tolerance=fraction,
        )
        checked = None
        if check:
            checked = _checked(console, config=scene_config, scene=scene, model=model)
        for name in _RESULTS:
            (folder / name).unlink(missing_ok=True)
        model.save(folder / _MODEL)
        write_text(folder / "config.yaml", to_yaml(scene_config))
        # With a check, they were measured alternately with the full run.
        online = checked.online_loop_s if checked else _run_times([_online(model)])[0]
        summary = _summary(scene_config, model=model, check=checked, online=online)
        write_json(folder / "summary.json", summary)
        for line in _lines(model, checked, online):
            print_line(console, line)
        print_line(console, f"{_MODEL} and summary.json in {folder}")


def _check_own_folder(config: Path, folder: Path) -> None:
    # Results of different commands must not be mixed, nor the config overwritten.
    stored_config = folder / "config.yaml"
    if (folder / "solution.npz").exists() or (
        stored_config.exists() and stored_config.samefile(config)
    ):
        raise InputError(
            f"--out {folder}: holds a run, or the config itself; name another folder"
        )


def _fraction(tolerance: str | None) -> float | None:
    if tolerance is None:
        return None
    with located("--tolerance"):
        value = to_si(tolerance, NUMBER)
    if not 0 < value < 1:
        raise InputError(f"--tolerance {tolerance}: give a part of the range, as 0.1%")
    return value


class _FullRun(NamedTuple):
    """The full run that a reduced model is compared with, as `summary.json` has it."""

    nodes: int
    solver: str
    steps: int
    time_error_K: float | None
    loop_s: list[float]
    """Run times of the compiled loop [s]."""


class _Check(NamedTuple):
    """Comparison of a reduced model with the full run."""

    error: TruthError
    full: _FullRun
    online_loop_s: list[float]
    """Run times of the reduced model [s], measured alternately with the full run."""


def _summary(
    config: SceneConfig, model: ReducedModel, check: _Check | None, online: list[float]
) -> dict[str, Any]:
    about = model.about._asdict()
    comparison = {}
    if check is not None:
        comparison["full"] = check.full._asdict()
    return {
        "kind": "reduced model",
        **{k: list(v) if isinstance(v, tuple) else v for k, v in about.items()},
        "online_s": statistics.median(online),
        "online_loop_s": online,
        "inputs": [load._asdict() for load in model.inputs],
        "times_s": list(model.times),
        "truth_error": None if check is None else check.error.as_dict(),
        **comparison,
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
) -> _Check:
    """Error against the full run, and the times of both, measured alternately."""
    with status(console, "running the full scene"):
        plan = plan_run(
            scene,
            t1=config.time.last,
            save_at=config.time.save_times,
            solver=config.solver.build(),
            control_error=True,
        )
        full = run_plan(plan)
        error = truth_error(model(), full)
    with status(console, "timing"):
        loop = _full_loop(plan, full)
        full_loop, online = _run_times([loop, _online(model)])
    full_run = _FullRun(
        nodes=full.receipt.nodes,
        solver=full.run.solver,
        steps=full.run.steps,
        time_error_K=full.run.time_error,
        loop_s=full_loop,
    )
    return _Check(error=error, full=full_run, online_loop_s=online)


def _full_loop(plan: Plan, full: Solution) -> Callable[[], Any]:
    # The loop of the pass that met the limit of the error in time.
    passes = (full.run.steps // max(plan.steps, 1)).bit_length() - 1
    last_pass = of_pass(plan, max(passes, 0))
    return lambda: run_plan(last_pass)


def _run_times(calls: list[Callable[[], Any]]) -> list[list[float]]:
    """Run times of compiled calls [s], alternately: a slow moment meets all of them."""
    times: list[list[float]] = [[] for _ in calls]
    for call in calls:
        jax.block_until_ready(call())
    for _ in range(_REPEATS):
        for call, call_times in zip(calls, times, strict=True):
            start = time.perf_counter()
            jax.block_until_ready(call())
            call_times.append(time.perf_counter() - start)
    return times


def _lines(model: ReducedModel, check: _Check | None, online: list[float]) -> list[str]:
    about = model.about
    inputs = ", ".join(load.name for load in model.inputs) or "no load"
    lines = [
        f"{about.size} vectors for {about.nodes:,} nodes under {inputs}: made in "
        f"{seconds(about.offline_s)}, runs in {_in_words(online)} on {processor()}",
        f"error of the surface: about {significant(max(about.estimate_kelvin))} K, "
        f"{significant(about.estimate_percent)} % of its range; by the residual at "
        f"most {significant(max(about.residual_bound_kelvin))} K RMS over the volume",
    ]
    if check is not None:
        error = check.error
        percent = finite_number(error.worst_rms_percent)
        full = check.full
        ratio = statistics.median(full.loop_s) / statistics.median(online)
        lines.append(
            f"against the full run: {significant(float(error.worst_rms_kelvin))} K"
            f"{_percent(percent)} RMS at the worst time; its "
            f"{full.steps} steps of {full.solver} take {_in_words(full.loop_s)}, "
            f"{significant(ratio)} times as long"
        )
    return lines


def _in_words(times: list[float]) -> str:
    return seconds_with_range(
        statistics.median(times), fastest=min(times), slowest=max(times)
    )


def _percent(percent: float | None) -> str:
    return "" if percent is None else f" ({significant(percent)} %)"
