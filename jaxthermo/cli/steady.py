"""`jaxthermo simulate --steady`: the steady state of a scene in place of a run."""

import time
from pathlib import Path

from ..alike_lines import grouped_lines
from ..arrays import precision
from ..config.schema.scene import SceneConfig
from ..config.types.quantities import TIME, to_si
from ..console.results_folder import results_folder
from ..console.terminal import collected_warnings, open_console, print_line, status
from ..errors import InputError
from ..integrate.run.solution import RESULTS
from ..integrate.steady import steady
from ..parallel.devices import provide_devices
from ..scene.air import bodies_with_surface
from ..structures.report import structure_report
from .frame_outputs import NO_EXTRAS
from .frames import FrameCamera
from .report import log_scene, log_steady
from .run_folder import (
    FinishedRun,
    begin_run_folder,
    check_not_overwritten,
    write_run,
)
from .simulate import card_warnings, loaded


def check_steady(at: str | None, others: dict[str, bool]) -> float:
    """Return the time of the values of a steady state [s].

    Args:
        at: the time as text; None for the start.
        others: options that mean nothing for one state, with whether they are there.

    Raises:
        InputError: for such an option, or a time that is none or before the start.
    """
    for option, is_there in others.items():
        if is_there:
            raise InputError(
                f"{option}: a steady state is one frame, from one process: leave out "
                f"{option} or --steady"
            )
    if at is None:
        return 0.0
    try:
        seconds = to_si(at, TIME)
    except InputError as error:
        raise InputError(f"--at: {error}") from error
    if seconds < 0:
        raise InputError(f"--at {at}: give a time from the start of the scene on")
    return seconds


def simulate_steady(
    config: Path, out: Path | None, overrides: tuple[str, ...], at: float
) -> None:
    """Write the steady state of a scene as a folder of one saved time.

    Args:
        config: the scene, a YAML file.
        out: folder for the results; results/NAME by default.
        overrides: values to change.
        at: time of the poses and values of the steady state [s].

    Raises:
        InputError: for a mistake in the scene, or a scene without a steady state.
    """
    provide_devices(1)
    scene_config = loaded(config, overrides)
    if scene_config.truth is not None:
        raise InputError(
            "truth: a steady state has no saved times to compare: --set truth=null"
        )
    # Frames at saved times of a run are none of this one.
    image = scene_config.image.model_copy(update={"frames": None})
    scene_config = scene_config.model_copy(update={"image": image})
    folder = out or Path("results") / config.stem
    with results_folder(folder):
        check_not_overwritten(config, folder)
        with precision(scene_config.dtype):
            _write(scene_config, folder, at)


def _write(config: SceneConfig, out: Path, at: float) -> None:
    console = open_console()
    clock = time.perf_counter()
    with collected_warnings() as doubts:
        with status(console, "building the scene"):
            scene = config.build()
        setup = time.perf_counter() - clock
        with status(console, "finding the steady state"):
            solution = steady(scene, at=at, throw=False)
    structures = [structure_report(b.structure) for b in bodies_with_surface(scene)]
    receipt = solution.receipt
    log_scene(console, scene=scene, receipt=receipt, structures=structures)
    warnings = [*doubts, *card_warnings(config, scene)]
    for warning in grouped_lines(warnings):
        print_line(console, f"warning: {warning}")
    if solution.result != RESULTS.successful:
        raise InputError(RESULTS[solution.result])
    times = {
        "setup_time_s": setup,
        "run_time_s": time.perf_counter() - clock - setup,
    }
    camera = FrameCamera(config, solution.surfaces, solution.terms)
    for line in camera.remarks():
        print_line(console, line)
    begin_run_folder(config, out)
    finished = FinishedRun(
        config=config,
        scene=scene,
        solution=solution,
        structures=structures,
        warnings=warnings,
        times=times,
    )
    written = write_run(console, finished, camera=camera, extras=NO_EXTRAS, out=out)
    times["frames_time_s"] = written.frames_time
    log_steady(console, scene, solution, times)
    for line in written.lines:
        print_line(console, line)
