"""The folder of a run or of a steady state: its files, and their order."""

import time
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from ..accuracy.error_records import ReferenceComparison
from ..atomic import write_json, write_text
from ..config.loader import load_config, to_yaml
from ..config.schema.scene import SceneConfig
from ..console.results_folder import prepare_folder
from ..console.terminal import status
from ..errors import InputError
from ..integrate.run.solution import Solution
from ..integrate.steady import SteadySolution
from ..report.numbers import count
from ..scene.scene import Scene
from ..structures.report import StructureReport
from .frame_names import FRAMES, earlier_frames
from .frame_outputs import OUTPUTS_OF_FRAMES, Extras
from .frames import FrameCamera, write_frames
from .summary import peak_memory, summarize, write_energy, write_probes


CONFIG = "config.yaml"
_PROBES = "probes.csv"
_SUMMARY = "summary.json"
_ENERGY = "energy.csv"
_RESULT_FILES = (_SUMMARY, "solution.npz", _ENERGY, _PROBES, *OUTPUTS_OF_FRAMES)


def check_not_overwritten(config: Path, out: Path) -> None:
    """Refuse a folder whose handwritten config the resolved one would replace."""
    if (out / CONFIG).exists() and (out / CONFIG).samefile(config):
        text = config.read_text(encoding="utf-8")
        if text != to_yaml(load_config(config)):
            raise InputError(
                f"--out {out}: the run would write over {config}; name another folder"
            )


def begin_run_folder(config: SceneConfig, out: Path) -> None:
    """Remove the files of an earlier run, and its frames, and write the config.

    Results of an earlier run must not be mistaken for those of this one.
    """
    for path in (
        *(out / name for name in _RESULT_FILES),
        *earlier_frames(out / FRAMES),
    ):
        if path.is_dir():
            raise InputError(f"--out {out}: {path} is a folder; name another --out")
        path.unlink(missing_ok=True)
    prepare_folder(out / FRAMES)
    write_text(out / CONFIG, to_yaml(config))


class FinishedRun(NamedTuple):
    """A run or a steady state, and what is told about it."""

    config: SceneConfig
    scene: Scene
    solution: Solution | SteadySolution
    structures: list[StructureReport]
    """`structure_report` of each body that has a surface."""
    warnings: list[str]
    times: dict[str, float]
    """Wall times by name [s]."""
    truth_error: ReferenceComparison | None = None
    """Error against the reference that the config names, if any."""


class _WrittenRun(NamedTuple):
    """Time of the frames, and the lines that tell about the files of a run."""

    frames_time: float
    """Wall time of the frames [s]."""
    lines: list[str]
    """Lines on the terminal."""


def write_run(
    console: Console,
    run: FinishedRun,
    *,
    camera: FrameCamera,
    extras: Extras,
    out: Path,
) -> _WrittenRun:
    """Write the files of a run: its solution, energies, probes, summary and frames.

    Args:
        console: for the state of the work.
        run: the results.
        camera: of the frames.
        extras: animation and contact sheet.
        out: folder of the run, see `begin_run_folder`.
    """
    stored = run.solution.stored()
    stored.save(out)
    write_energy(out / _ENERGY, run.scene, run.solution)
    if run.solution.probes:
        write_probes(out / _PROBES, run.solution)
    summary = summarize(
        run.config,
        scene=run.scene,
        solution=run.solution,
        times=run.times | {"frames_time_s": 0.0},
        structures=run.structures,
        warnings=run.warnings,
    )
    summary["truth_error"] = run.truth_error
    # Written before the frames too, which need most of the space: if the disk is full,
    # only frames are missing, and `jaxthermo render` can draw them later.
    write_json(out / _SUMMARY, summary)
    clock = time.perf_counter()
    with status(console, "drawing frames"):
        frames = write_frames(
            run.config, camera=camera, stored=stored, folder=out, extras=extras
        )
    frames_time = time.perf_counter() - clock
    measured = {"frames_time_s": frames_time, "peak_memory_bytes": peak_memory()}
    write_json(out / _SUMMARY, summary | measured)
    frame_count = count(frames.count, "frame")
    told = f"{frame_count} in {out / FRAMES}, {_SUMMARY} in {out}"
    return _WrittenRun(frames_time=frames_time, lines=[told, *frames.lines])
