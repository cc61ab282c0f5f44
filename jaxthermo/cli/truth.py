"""`truth` of a config: the finer run that a run is compared with, and its error."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..accuracy.reference_run import ReferenceRun
from ..config.schema.scene import SceneConfig
from ..errors import InputError, located
from ..report.numbers import significant
from ..scene.scene import SolvedSurface


def read_reference(
    config: SceneConfig, out: Path, surfaces: tuple[SolvedSurface, ...]
) -> ReferenceRun | None:
    """Read the reference before the run; None if the config names none.

    Args:
        config: config of the scene.
        out: folder of the run.
        surfaces: surfaces of the run's bodies.

    Raises:
        InputError: if it cannot be read, does not fit the scene, or would be written
            over by the run.
    """
    if config.truth is None:
        return None
    path = config.truth.reference
    if path.resolve().parent == out.resolve():
        raise InputError(
            f"truth.reference: {path} would be written over by the run: name another "
            "--out"
        )
    with located("truth.reference"):
        reference = ReferenceRun.load(
            path,
            times=config.time.save_times,
            points=config.truth.points,
            seed=config.truth.seed,
        )
        reference.check(surfaces)
    return reference


def error_in_words(summary: Mapping[str, Any]) -> list[str]:
    """The error of a summary in a line for the terminal, and the remarks."""
    percent = summary["worst_rms_percent"]
    relative = "" if percent is None else f" ({significant(percent)} %)"
    line = (
        f"error against {summary['reference']}: "
        f"{significant(summary['worst_rms_kelvin'])} K{relative} RMS at the worst "
        "time, 99 % of the surface within "
        f"{significant(summary['worst_p99_kelvin'])} K, mean "
        f"{summary['worst_bias_kelvin']:+.3g} K"
    )
    if summary["worst_lost_fraction"] > 0:
        lost = 100 * summary["worst_lost_fraction"]
        line += f"; {significant(lost)} % of its surface is not in these voxels"
    return [line, *(f"note: {remark}" for remark in summary["remarks"])]
