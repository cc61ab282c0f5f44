"""`jaxthermo simulate`: read a config, run its scene, write the results."""

import time
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from .. import __version__
from ..arrays import precision
from ..atomic import replacing, write_json
from ..config.card_file import load_card
from ..config.loader import config_hash, load_config, to_yaml
from ..config.schema.image import ImageConfig, PinholeConfig
from ..config.schema.scene import SceneConfig
from ..config.shipped_cards import card_name
from ..errors import InputError
from ..image.colour.ticks import time_label
from ..integrate.run import segments
from ..integrate.run.checkpoint import (
    checkpoint_files,
    load_checkpoint,
    save_checkpoint,
)
from ..integrate.run.plan import Plan, plan_run
from ..integrate.run.save_solution import save_solution
from ..integrate.run.solution import RESULTS, Solution
from ..parallel.devices import provide_devices
from ..parallel.meeting import Group
from ..parallel.processes import (
    agreed,
    any_process,
    check_alike,
    is_first,
    join,
    wait_for_all,
    watching_others,
)
from ..report.numbers import count
from ..scene.compile.compile import mechanism_names
from ..scene.compile.on_devices import on_devices
from ..scene.dimensionless_groups import body_numbers
from ..scene.scene import Scene
from ..structures.extrapolation import extrapolations
from ..structures.report import structure_report
from .console import (
    open_console,
    patient_interrupt,
    print_line,
    progress_bar,
    status,
)
from .files import FRAMES, earlier_frames, prepare_folder, results_folder
from .frame_outputs import NO_EXTRAS, OUTPUTS_OF_FRAMES, Extras
from .frames import FrameCamera, write_frames
from .report import log_receipt, log_result, log_scene
from .summary import (
    peak_memory,
    summarize,
    write_energy,
    write_probes,
)
from .truth import Truth


CONFIG = "config.yaml"
CHECKPOINT = "checkpoint.npz"
# Wall time between checkpoints [s]: a run that is killed loses at most that much.
CHECKPOINT_EVERY = 20.0
PROBES = "probes.csv"
RESULTS_OF_A_RUN = (
    *("summary.json", "solution.npz", "energy.csv", PROBES),
    *OUTPUTS_OF_FRAMES,
)


def simulate(
    config: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    extras: Extras = NO_EXTRAS,
    devices: int = 1,
    group: Group | None = None,
) -> None:
    """Run a scene and write its results, with the resolved config beside them.

    With a `group` this process runs it together with others, of which the first writes.
    """
    provide_devices(devices if group is None else devices // group.processes)
    scene, folder = load_config(config, overrides), out or Path("results") / config.stem
    extras.check(scene)
    if group is not None:
        join(group, f"jaxthermo {__version__} with config {config_hash(scene)[:8]}")
        if not is_first():
            run_along(scene, folder, devices)
            return
    with results_folder(folder):
        _check_not_overwritten(config, folder)
        _run_simulation(scene, out=folder, extras=extras, devices=devices)


def run_along(config: SceneConfig, out: Path, devices: int) -> None:
    """Run a scene in a process that writes no results."""
    console = Console(quiet=True)
    with precision(config.dtype):
        planned = _planned(console, config, devices)
        run_plan(console, config=config, todo=planned.todo, out=out)


def explain(config: Path, overrides: tuple[str, ...], devices: int = 1) -> None:
    """Compile the scene and print the included and pruned terms."""
    provide_devices(devices)
    scene_config = load_config(config, overrides)
    console = open_console()
    with precision(scene_config.dtype):
        planned = _planned(console, scene_config, devices)
        log_receipt(console, planned.todo)
        # A camera that sees nothing is refused.
        with status(console, "finding what the camera sees"):
            surfaces = planned.todo.compiled.surfaces
            camera = FrameCamera(scene_config, surfaces, planned.scene.terms)
        for line in camera.remarks():
            print_line(console, line)


class _Planned(NamedTuple):
    scene: Scene
    todo: Plan
    structures: list[dict[str, Any]]
    warnings: list[str]


def _planned(console: Console, config: SceneConfig, devices: int) -> _Planned:
    with status(console, "building the scene"):
        scene = on_devices(config.build(), devices)
        end, saves = config.time.end, config.time.save_times
        todo = plan_run(
            scene,
            t1=end,
            save_at=saves,
            solver=config.solver.build(),
            control_error=True,
        )
        structures = [structure_report(body.structure) for body in scene.bodies]
        warnings = [*todo.compiled.receipt.warnings, *_card_warnings(config, scene)]
    log_scene(console, scene=scene, todo=todo, structures=structures)
    for warning in warnings:
        print_line(console, f"warning: {warning}")
    return _Planned(scene=scene, todo=todo, structures=structures, warnings=warnings)


def _card_warnings(config: SceneConfig, scene: Scene) -> list[str]:
    # The weights of a card are fitted: outside of their range they may be far off.
    found = []
    for n, (given, body) in enumerate(zip(config.bodies, scene.bodies, strict=True)):
        path = given.structure.weights.card
        if path is None:
            continue
        numbers = body_numbers(scene, body, config.time.last)
        card, mechanisms = load_card(path), mechanism_names(scene)
        known = given.geometry, body.structure.grid.surface_cells
        for words in extrapolations(card, numbers, mechanisms, *known):
            where = f"bodies.{n}: beyond the range of {card_name(path)}"
            found.append(f"{where}: {words}")
    return found


def _check_not_overwritten(config: Path, out: Path) -> None:
    # The resolved config would replace one that was written by hand, and its comments.
    if (out / CONFIG).exists() and (out / CONFIG).samefile(config):
        text = config.read_text(encoding="utf-8")
        if text != to_yaml(load_config(config)):
            raise InputError(
                f"--out {out}: the run would write over {config}; name another folder"
            )


def _run_simulation(
    config: SceneConfig, out: Path, extras: Extras, devices: int
) -> None:
    console = open_console()
    with precision(config.dtype):
        clock = time.perf_counter()
        scene, todo, structures, warnings = _planned(console, config, devices)
        with status(console, "finding what the camera sees"):
            camera = FrameCamera(config, todo.compiled.surfaces, scene.terms)
            truth = Truth.read(config, out, todo.compiled.surfaces)
        for line in camera.remarks():
            print_line(console, line)
        setup = time.perf_counter() - clock
        # The camera and the scene are valid: from here on the folder is this run's, and
        # results of an earlier run must not be mistaken for its own.
        _remove_results(out, RESULTS_OF_A_RUN)
        prepare_folder(out / FRAMES)
        with replacing(out / CONFIG) as path:
            path.write_text(to_yaml(config), encoding="utf-8")
        solution, times = run_plan(console, config=config, todo=todo, out=out)
        if solution.result != RESULTS.successful:
            raise InputError(RESULTS[solution.result])
        stored = save_solution(out / "solution.npz", solution)
        write_energy(out / "energy.csv", solution)
        if solution.probes:
            write_probes(out / PROBES, solution)
        times |= {"setup_time_s": setup, "frames_time_s": 0.0}
        summary = summarize(
            config,
            scene=scene,
            solution=solution,
            times=times,
            structures=structures,
            warnings=warnings,
        )
        error = None if truth is None else truth.summary(solution)
        summary["truth_error"] = error
        # Also before the frames, which need most of the space: a full disk takes only
        # these, and `jaxthermo render` draws them later.
        write_json(out / "summary.json", summary)
        clock = time.perf_counter()
        with status(console, "drawing frames"):
            frames = write_frames(
                config, camera=camera, stored=stored, folder=out, extras=extras
            )
        times["frames_time_s"] = time.perf_counter() - clock
        summary |= {**times, "peak_memory_bytes": peak_memory()}
        write_json(out / "summary.json", summary)
    for path in checkpoint_files(out / CHECKPOINT):
        path.unlink(missing_ok=True)
    log_result(console, solution, times)
    for line in [] if error is None else Truth.in_words(error):
        print_line(console, line)
    shown = f"{count(frames.count, 'frame')} in {out / FRAMES}"
    for line in (f"{shown}, summary.json beside them", *frames.lines):
        print_line(console, line)


def _remove_results(out: Path, names: tuple[str, ...]) -> None:
    """Remove the files of an earlier run, and its frames, but nothing else."""
    for path in (*(out / name for name in names), *earlier_frames(out / FRAMES)):
        if path.is_dir():
            raise InputError(f"--out {out}: {path} is a folder; name another --out")
        path.unlink(missing_ok=True)


def run_plan(
    console: Console, config: SceneConfig, todo: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    """Run a scene from the last checkpoint in `out`, if there is one, with its times.

    Raises:
        KeyboardInterrupt: after Ctrl-C, when the checkpoint is written.
    """
    remedy = "the same commands go on from the last checkpoint"
    with watching_others(remedy):
        return _run_segments(console, config=config, todo=todo, out=out)


def _run_segments(
    console: Console, config: SceneConfig, todo: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    key = _checkpoint_key(config)
    fresh = segments.begin_run(todo)
    wait_for_all("folder of the results is there")
    kept = load_checkpoint(out / CHECKPOINT, plan=todo, fresh=fresh, key=key)
    position = "none" if kept is None else f"{kept.interval}, {kept.steps_taken}"
    check_alike(f"checkpoints in {out}, which all must read", position)
    if kept is not None:
        print_line(console, f"going on from {time_label(kept.time_reached(todo))}")
    elif (out / CHECKPOINT).exists():
        print_line(
            console, f"starting again: {CHECKPOINT} is of another run, or damaged"
        )
    clock = time.perf_counter()
    with status(console, "compiling"):
        ready = segments.compile_segments(todo, kept or fresh)
    compiled, clock = time.perf_counter() - clock, time.perf_counter()
    with (
        patient_interrupt() as interrupted,
        progress_bar(console, config.time.last, todo.steps) as update,
    ):
        progress, last = ready, clock
        for progress in segments.run_segments(todo, ready):
            done, number = progress.steps_done(todo), progress.passes.number
            update(done, progress.time_reached(todo), number)
            if any_process(interrupted()):
                _stop(todo, progress=progress, out=out, key=key)
            if agreed(time.perf_counter() - last > CHECKPOINT_EVERY):
                save_checkpoint(out / CHECKPOINT, plan=todo, progress=progress, key=key)
                last = time.perf_counter()
    times = {"compile_time_s": compiled, "run_time_s": time.perf_counter() - clock}
    return segments.finish_run(todo, progress), times


def _checkpoint_key(config: SceneConfig) -> str:
    # All that the simulation depends on: camera and truth may change meanwhile.
    undrawn: dict[str, Any] = {"camera": PinholeConfig(), "image": ImageConfig()}
    undrawn |= {"name": None, "truth": None}
    return f"{config_hash(config.model_copy(update=undrawn))} {__version__}"


def _stop(todo: Plan, progress: segments.RunProgress, out: Path, key: str) -> None:
    save_checkpoint(out / CHECKPOINT, plan=todo, progress=progress, key=key)
    raise KeyboardInterrupt(
        f"stopped at {time_label(progress.time_reached(todo))}; "
        "the same command goes on from there"
    )
