"""`jaxthermo simulate`: a config is read, its scene is run, the results are written."""

import time
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from .. import __version__
from ..arrays import precision
from ..atomic import replacing
from ..config.loader import config_hash, load_config, to_yaml
from ..config.schema.image import ImageConfig, PinholeConfig
from ..config.schema.scene import SceneConfig
from ..errors import InputError
from ..image.ticks import time_label
from ..integrate.run.plan import Plan, plan_run
from ..integrate.run.segments import (
    RunProgress,
    begin_run,
    compile_segments,
    finish_run,
    load_checkpoint,
    run_segments,
    save_checkpoint,
    steps_done,
    time_reached,
)
from ..integrate.run.solution import RESULTS, Solution
from ..integrate.run.solution_file import StoredSolution, save_solution
from ..scene.scene import Scene
from ..structures.report import structure_report
from .cards import card_warnings
from .console import doing, open_console, tell
from .files import FRAMES, prepare_folder, remove_results, results_folder
from .frames import Watch, write_frames
from .progress import patient_interrupt, progress_bar
from .report import tell_receipt, tell_result, tell_scene
from .summary import summarize, write_energy, write_json


CONFIG = "config.yaml"
CHECKPOINT = "checkpoint.npz"
CHECKPOINT_EVERY = 20.0
"""Wall time between checkpoints [s]."""

RESULTS_OF_A_RUN = ("summary.json", "solution.npz", "energy.csv")


def simulate(config: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Reads the config, makes the folder, keeps the resolved config, runs the scene."""
    scene = load_config(config, overrides)
    with results_folder(out or Path("results") / config.stem) as folder:
        _spare(config, folder)
        run_simulation(scene, folder)


def explain(config: Path, overrides: tuple[str, ...]) -> None:
    """Compiles the scene and tells what a run would compute, and what it would not."""
    scene_config = load_config(config, overrides)
    console = open_console()
    with precision(scene_config.dtype):
        planned = _planned(console, scene_config)
        tell_receipt(console, planned.scene, planned.todo)


class _Planned(NamedTuple):
    scene: Scene
    todo: Plan
    structures: list[dict[str, Any]]
    warnings: list[str]


def _planned(console: Console, config: SceneConfig) -> _Planned:
    """The scene and how it will be run, told."""
    with doing(console, "building the scene"):
        scene = config.build()
        end, saves = config.time.end, config.time.save_times
        todo = plan_run(scene, end, saves, config.solver.build())
        structures = [structure_report(body.structure) for body in scene.bodies]
        warnings = card_warnings(config, scene)
    tell_scene(console, scene, todo, structures)
    for warning in warnings:
        tell(console, f"warning: {warning}")
    return _Planned(scene, todo, structures, warnings)


def _spare(config: Path, out: Path) -> None:
    """Refuse to write the resolved config over one that somebody wrote by hand."""
    if (out / CONFIG).exists() and (out / CONFIG).samefile(config):
        text = config.read_text(encoding="utf-8")
        if text != to_yaml(load_config(config)):
            raise InputError(
                f"--out {out}: the run would write over {config}; name another folder"
            )


def run_simulation(config: SceneConfig, out: Path) -> None:
    """Runs the scene and writes summary, solution, energies and frames into `out`."""
    console = open_console()
    with precision(config.dtype):
        clock = time.perf_counter()
        scene, todo, structures, warnings = _planned(console, config)
        with doing(console, "finding what the camera sees"):
            watch = Watch(config, todo.compiled.surfaces, scene.terms)
        setup = time.perf_counter() - clock
        # From here on the folder is this run's: the camera and the scene are sound.
        # Results of an earlier one must not pass for this one's.
        remove_results(out, RESULTS_OF_A_RUN)
        prepare_folder(out / FRAMES)
        with replacing(out / CONFIG) as path:
            path.write_text(to_yaml(config), encoding="utf-8")
        solution, times = _run(console, config, scene, todo, out)
        if solution.result != RESULTS.successful:
            raise InputError(RESULTS[solution.result])
        save_solution(out / "solution.npz", solution)
        write_energy(out / "energy.csv", solution)
        stored = StoredSolution(
            solution.times, solution.surface_temperature, solution.surfaces
        )
        clock = time.perf_counter()
        with doing(console, "drawing frames"):
            frames = write_frames(config, watch, stored, out / FRAMES)
        times |= {"setup_time_s": setup, "frames_time_s": time.perf_counter() - clock}
        summary = summarize(config, scene, solution, times, structures, warnings)
        write_json(out / "summary.json", summary)
    (out / CHECKPOINT).unlink(missing_ok=True)
    tell_result(console, solution, times)
    tell(
        console,
        f"{frames} frame{'s' * (frames != 1)} in {out / FRAMES}, "
        "summary.json beside them",
    )


def _run(
    console: Console, config: SceneConfig, scene: Scene, todo: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    """Segments with a bar and checkpoints, from where an earlier run was cut off."""
    key = _checkpoint_key(config)
    fresh = begin_run(todo)
    kept = load_checkpoint(out / CHECKPOINT, fresh, key)
    if kept is not None:
        tell(console, f"going on from {time_label(time_reached(todo, kept))}")
    elif (out / CHECKPOINT).exists():
        tell(console, f"starting anew: {CHECKPOINT} is of another run, or damaged")
    clock = time.perf_counter()
    with doing(console, "compiling"):
        ready = compile_segments(todo, kept or fresh)
    compiled, clock = time.perf_counter() - clock, time.perf_counter()
    with (
        patient_interrupt() as interrupted,
        progress_bar(console, config.time.end, todo.steps) as update,
    ):
        progress, last = ready, clock
        for progress in run_segments(todo, ready):
            update(steps_done(todo, progress), time_reached(todo, progress))
            if interrupted():
                _stop(todo, progress, out, key)
            if time.perf_counter() - last > CHECKPOINT_EVERY:
                save_checkpoint(out / CHECKPOINT, progress, key)
                last = time.perf_counter()
    run = time.perf_counter() - clock
    return finish_run(todo, progress), {
        "compile_time_s": compiled,
        "run_time_s": run,
    }


def _checkpoint_key(config: SceneConfig) -> str:
    """Of all that the simulation depends on: the camera may change meanwhile."""
    undrawn = {"camera": PinholeConfig(), "image": ImageConfig(), "name": None}
    return f"{config_hash(config.model_copy(update=undrawn))} {__version__}"


def _stop(todo: Plan, progress: RunProgress, out: Path, key: str) -> None:
    save_checkpoint(out / CHECKPOINT, progress, key)
    raise KeyboardInterrupt(
        f"stopped at {time_label(time_reached(todo, progress))}; "
        "the same command goes on from there"
    )
