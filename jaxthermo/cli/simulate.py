"""`jaxthermo simulate`: read a config, run its scene, write the results."""

import time
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from .. import __version__
from ..alike_lines import grouped_lines
from ..arrays import precision
from ..config.card_file import load_card
from ..config.loader import config_hash, load_config
from ..config.scene_file import plan_of
from ..config.schema.image import ImageConfig, PinholeConfig
from ..config.schema.scene import SceneConfig
from ..config.shipped_cards import card_name
from ..console.progress import terminal_progress
from ..console.results_folder import results_folder
from ..console.terminal import (
    collected_warnings,
    open_console,
    patient_interrupt,
    print_line,
    status,
)
from ..errors import InputError
from ..image.colour.ticks import time_label
from ..integrate.run import segments
from ..integrate.run.checkpoint import (
    checkpoint_files,
    load_checkpoint,
    save_checkpoint,
)
from ..integrate.run.plan import Plan
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
from ..scene.air import bodies_with_surface
from ..scene.compile.on_devices import on_devices
from ..scene.dimensionless_groups import body_numbers
from ..scene.scene import Scene, mechanism_names
from ..structures.extrapolation import extrapolations
from ..structures.report import StructureReport, structure_report
from .frame_outputs import NO_EXTRAS, Extras
from .frames import FrameCamera
from .report import log_receipt, log_result, log_scene, log_steps
from .run_folder import (
    FinishedRun,
    begin_run_folder,
    check_not_overwritten,
    write_run,
)
from .truth import error_in_words, read_reference


CHECKPOINT = "checkpoint.npz"
# Wall time between checkpoints [s]: a run that is killed loses at most that much.
_CHECKPOINT_EVERY = 20.0
_VERY_MANY = 1000
"""Number of bodies from which the time that they take is told beforehand."""
_SETUP_OVER_LOADING = 3.0
"""Time from a loaded config to the first step, over that of loading: bodies of a few
voxels without radiation, the least that there is."""


def simulate(
    config: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    extras: Extras = NO_EXTRAS,
    devices: int = 1,
    group: Group | None = None,
) -> None:
    """Run a scene and write its results and its resolved config.

    In a `group` several processes run the scene, and the first one writes the results.
    """
    provide_devices(devices if group is None else devices // group.processes)
    scene = loaded(config, overrides)
    folder = out or Path("results") / config.stem
    extras.check(scene)
    if group is not None:
        join(group, f"jaxthermo {__version__} with config {config_hash(scene)[:8]}")
        if not is_first():
            _run_along(scene, folder, devices)
            return
    with results_folder(folder):
        check_not_overwritten(config, folder)
        _run_simulation(scene, out=folder, extras=extras, devices=devices)


def loaded(path: Path, overrides: tuple[str, ...]) -> SceneConfig:
    """The config, with a line on the time that very many bodies take."""
    clock = time.perf_counter()
    config = load_config(path, overrides)
    if len(config.bodies) >= _VERY_MANY:
        seconds = _SETUP_OVER_LOADING * (time.perf_counter() - clock)
        print_line(
            open_console(),
            f"{len(config.bodies):,} bodies: at least {seconds:.0f} s more until "
            "the first step",
        )
    return config


def _run_along(config: SceneConfig, out: Path, devices: int) -> None:
    """Run a scene in a process that writes no results."""
    console = Console(quiet=True)
    with precision(config.dtype):
        planned = _planned(console, config, devices)
        run_plan(console, config=config, plan=planned.plan, out=out)


def explain(config: Path, overrides: tuple[str, ...], devices: int = 1) -> None:
    """Compile the scene and print the included and pruned terms."""
    provide_devices(devices)
    scene_config = loaded(config, overrides)
    console = open_console()
    with precision(scene_config.dtype):
        planned = _planned(console, scene_config, devices)
        log_receipt(console, planned.plan)
        # A camera that sees nothing is refused.
        with status(console, "finding what the camera sees"):
            surfaces = planned.plan.compiled.surfaces
            camera = FrameCamera(scene_config, surfaces, planned.scene.terms)
        for line in camera.remarks():
            print_line(console, line)


class _Planned(NamedTuple):
    """A scene that is ready to run."""

    scene: Scene
    plan: Plan
    structures: list[StructureReport]
    """`structure_report` of each body."""
    warnings: list[str]


def _planned(console: Console, config: SceneConfig, devices: int) -> _Planned:
    with status(console, "building the scene"):
        with collected_warnings() as doubts:
            scene = on_devices(config.build(), devices)
        plan = plan_of(config, scene)
        structures = [
            structure_report(body.structure) for body in bodies_with_surface(scene)
        ]
        warnings = [
            *doubts,
            *plan.compiled.receipt.warnings,
            *card_warnings(config, scene),
        ]
    receipt = plan.compiled.receipt
    log_scene(console, scene=scene, receipt=receipt, structures=structures)
    log_steps(console, plan)
    for warning in grouped_lines(warnings):
        print_line(console, f"warning: {warning}")
    return _Planned(scene=scene, plan=plan, structures=structures, warnings=warnings)


def card_warnings(config: SceneConfig, scene: Scene) -> list[str]:
    """Numbers of bodies that are outside the range of their fit cards."""
    # The weights of a card are fitted: outside their range they may be far off.
    warnings = []
    pairs = zip(config.bodies, bodies_with_surface(scene), strict=True)
    for n, (body_config, body) in enumerate(pairs):
        path = body_config.structure.weights.card
        if path is None:
            continue
        remarks = extrapolations(
            load_card(path),
            numbers=body_numbers(scene, body, config.time.last),
            mechanisms=mechanism_names(scene),
            geometry=body_config.geometry,
            surface_cells=body.structure.voxels.surface_cells,
        )
        for remark in remarks:
            warnings.append(
                f"bodies.{n}: beyond the range of {card_name(path)}: {remark}"
            )
    return warnings


def _run_simulation(
    config: SceneConfig, out: Path, extras: Extras, devices: int
) -> None:
    console = open_console()
    with precision(config.dtype):
        clock = time.perf_counter()
        planned = _planned(console, config, devices)
        plan = planned.plan
        with status(console, "finding what the camera sees"):
            camera = FrameCamera(
                config, surfaces=plan.compiled.surfaces, terms=planned.scene.terms
            )
            truth = read_reference(config, out, plan.compiled.surfaces)
        for line in camera.remarks():
            print_line(console, line)
        setup = time.perf_counter() - clock
        # The camera and the scene are valid: from here on the folder is this run's.
        begin_run_folder(config, out)
        solution, times = run_plan(console, config=config, plan=plan, out=out)
        if solution.result != RESULTS.successful:
            raise InputError(RESULTS[solution.result])
        times["setup_time_s"] = setup
        error = None if truth is None else truth.summary(solution)
        finished = FinishedRun(
            config=config,
            scene=planned.scene,
            solution=solution,
            structures=planned.structures,
            warnings=[*planned.warnings, *solution.run.warnings],
            times=times,
            truth_error=error,
        )
        written = write_run(console, finished, camera=camera, extras=extras, out=out)
    for path in checkpoint_files(out / CHECKPOINT):
        path.unlink(missing_ok=True)
    times["frames_time_s"] = written.frames_time
    log_result(console, planned.scene, solution, times)
    for line in [] if error is None else error_in_words(error):
        print_line(console, line)
    for line in written.lines:
        print_line(console, line)


def run_plan(
    console: Console, config: SceneConfig, plan: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    """Run a scene from the last checkpoint in `out`, if any; return wall times too.

    Raises:
        KeyboardInterrupt: after Ctrl-C, when the checkpoint has been written.
    """
    remedy = "the same commands go on from the last checkpoint"
    with watching_others(remedy):
        return _run_segments(console, config=config, plan=plan, out=out)


def _run_segments(
    console: Console, config: SceneConfig, plan: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    key = _checkpoint_key(config)
    fresh = segments.begin_run(plan)
    wait_for_all("folder of the results is there")
    checkpoint = load_checkpoint(out / CHECKPOINT, plan=plan, fresh=fresh, key=key)
    position = (
        "none"
        if checkpoint is None
        else f"{checkpoint.interval}, {checkpoint.steps_taken}"
    )
    check_alike(f"checkpoints in {out}, which all must read", position)
    if checkpoint is not None:
        print_line(
            console, f"going on from {time_label(checkpoint.time_reached(plan))}"
        )
    elif (out / CHECKPOINT).exists():
        print_line(
            console, f"starting again: {CHECKPOINT} is of another run, or damaged"
        )
    clock = time.perf_counter()
    with status(console, "compiling"):
        ready = segments.compile_segments(plan, checkpoint or fresh)
    run_start = time.perf_counter()
    compile_time = run_start - clock
    with (
        patient_interrupt() as interrupted,
        terminal_progress(console) as shown,
    ):
        progress = ready
        last_saved = run_start
        for progress in segments.shown_segments(plan, ready, shown):
            if any_process(interrupted()):
                _stop(plan, progress=progress, out=out, key=key)
            if agreed(time.perf_counter() - last_saved > _CHECKPOINT_EVERY):
                save_checkpoint(out / CHECKPOINT, plan=plan, progress=progress, key=key)
                last_saved = time.perf_counter()
    run_time = time.perf_counter() - run_start
    times = {"compile_time_s": compile_time, "run_time_s": run_time}
    return segments.finish_run(plan, progress), times


def _checkpoint_key(config: SceneConfig) -> str:
    # Everything that the simulation depends on: camera and truth may change meanwhile.
    simulated = config.model_copy(
        update={
            "camera": PinholeConfig(),
            "image": ImageConfig(),
            "name": None,
            "truth": None,
        }
    )
    return f"{config_hash(simulated)} {__version__}"


def _stop(plan: Plan, progress: segments.RunProgress, out: Path, key: str) -> None:
    save_checkpoint(out / CHECKPOINT, plan=plan, progress=progress, key=key)
    raise KeyboardInterrupt(
        f"stopped at {time_label(progress.time_reached(plan))}; "
        "the same command goes on from there"
    )
