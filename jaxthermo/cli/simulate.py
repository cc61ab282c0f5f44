"""`jaxthermo simulate`: a config is read, its scene is run, the results are written."""

import shutil
import time
from pathlib import Path

from rich.console import Console

from .. import __version__
from ..atomic import replacing
from ..config.build import build_scene, build_solver
from ..config.loader import config_hash, load_config, to_yaml
from ..config.schema import SceneConfig
from ..geometry.verdict import verdict_line
from ..image.ticks import time_label
from ..integrate.segments import (
    Progress,
    begin,
    compile_segments,
    finish,
    load_checkpoint,
    save_checkpoint,
    segments,
    steps_done,
    time_reached,
)
from ..integrate.simulate import Plan, plan, raise_failure
from ..integrate.solution import Solution
from ..integrate.store import StoredSolution, save_solution
from ..memory import readable_bytes
from ..precision import precision
from ..scene.scene import Scene
from .files import prepare_folder
from .frames import prepare_view, write_frames
from .progress import patient_interrupt, progress_bar
from .summary import peak_memory, summarize, write_energy, write_json


CHECKPOINT = "checkpoint.npz"
CHECKPOINT_EVERY = 20.0
"""Wall time between checkpoints [s]."""

RESULTS_OF_A_RUN = ("summary.json", "solution.npz", "energy.csv", "frames")


def simulate(config: Path, out: Path | None, overrides: tuple[str, ...]) -> None:
    """Reads the config, makes the folder, keeps the resolved config, runs the scene."""
    scene = load_config(config, overrides)
    folder = prepare_folder(out or Path("results") / config.stem)
    run_simulation(scene, folder)


def run_simulation(config: SceneConfig, out: Path) -> None:
    """Runs the scene and writes summary, solution, energies and frames into `out`."""
    console = Console(highlight=False, soft_wrap=True)
    with precision(config.dtype):
        clock = time.perf_counter()
        scene = build_scene(config)
        todo = plan(
            scene, config.time.end, config.time.save_times, build_solver(config.solver)
        )
        _tell_scene(console, scene, todo)
        view = prepare_view(config, todo.compiled.surfaces, scene.terms)
        setup = time.perf_counter() - clock
        # From here on the folder is this run's: the camera and the scene are sound.
        _clear(out)
        with replacing(out / "config.yaml") as path:
            path.write_text(to_yaml(config), encoding="utf-8")
        solution, times = _run(console, config, scene, todo, out)
        save_solution(out / "solution.npz", solution)
        write_energy(out / "energy.csv", solution)
        raise_failure(solution.result)
        stored = StoredSolution(
            solution.times, solution.surface_temperature, solution.surfaces
        )
        clock = time.perf_counter()
        frames = write_frames(config, view, stored, out / "frames")
        times |= {"setup_time_s": setup, "frames_time_s": time.perf_counter() - clock}
        summary = summarize(config, scene, solution, times) | {"frames": frames}
        write_json(out / "summary.json", summary)
    (out / CHECKPOINT).unlink(missing_ok=True)
    _tell_result(console, solution, times, frames, out)


def _clear(out: Path) -> None:
    """Remove an earlier run's results: its files must not pass for this one's."""
    for name in RESULTS_OF_A_RUN:
        target = out / name
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)


def _run(
    console: Console, config: SceneConfig, scene: Scene, todo: Plan, out: Path
) -> tuple[Solution, dict[str, float]]:
    """Segments with a bar and checkpoints, from where an earlier run was cut off."""
    key = f"{config_hash(config)} {__version__}"
    fresh = begin(scene, todo)
    kept = load_checkpoint(out / CHECKPOINT, fresh, key)
    if kept is not None:
        console.print(f"going on from {time_label(time_reached(todo, kept))}")
    clock = time.perf_counter()
    progress = compile_segments(todo, kept or fresh)
    compiled, clock = time.perf_counter() - clock, time.perf_counter()
    with (
        patient_interrupt() as interrupted,
        progress_bar(console, config.time.end, todo.steps) as update,
    ):
        last = clock
        for progress in segments(todo, progress):
            update(steps_done(todo, progress), time_reached(todo, progress))
            if interrupted():
                _stop(todo, progress, out, key)
            if time.perf_counter() - last > CHECKPOINT_EVERY:
                save_checkpoint(out / CHECKPOINT, progress, key)
                last = time.perf_counter()
    run = time.perf_counter() - clock
    return finish(scene, todo, progress), {
        "compile_time_s": compiled,
        "run_time_s": run,
    }


def _stop(todo: Plan, progress: Progress, out: Path, key: str) -> None:
    save_checkpoint(out / CHECKPOINT, progress, key)
    raise KeyboardInterrupt(
        f"stopped at {time_label(time_reached(todo, progress))}; "
        "run the same command again to go on from there"
    )


def _tell_scene(console: Console, scene: Scene, todo: Plan) -> None:
    for body in scene.bodies:
        grid = body.structure.grid
        shape = " x ".join(str(n) for n in grid.lattice.shape)
        console.print(verdict_line(grid.mesh), markup=False)
        console.print(
            f"  {grid.solid_count} solid voxels of {grid.pitch * 1e3:.4g} mm in "
            f"{shape}, {len(grid.fragment_area)} surface fragments"
        )
    receipt = todo.compiled.receipt
    console.print(f"included: {', '.join(receipt.included)}")
    for omission in receipt.left_out:
        console.print(f"left out: {omission.what} ({omission.why})", markup=False)
    limit = "none" if todo.limit is None else f"{todo.limit:.4g} s"
    console.print(
        f"{todo.steps} steps, stable step {limit}, "
        f"about {readable_bytes(receipt.memory_bytes)}"
    )


def _tell_result(console, solution, times, frames, out) -> None:
    residual = float(abs(solution.energy.residual_relative).max())
    surface = solution.surface_temperature[-1] - 273.15
    console.print(
        f"compiled in {times['compile_time_s']:.1f} s, ran in "
        f"{times['run_time_s']:.1f} s, {readable_bytes(peak_memory())} at most"
    )
    console.print(
        f"at the end the surface is at {float(surface.min()):.1f} to "
        f"{float(surface.max()):.1f} degC; energy residual {residual:.1e}"
    )
    console.print(f"{len(frames)} frames in {out / 'frames'}, summary.json beside them")
