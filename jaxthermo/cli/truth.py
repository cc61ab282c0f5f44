"""Section `truth` of a config: the error of a run compared with a finer run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..config.schema.scene import SceneConfig, TruthConfig
from ..errors import InputError
from ..integrate.run.solution import Solution
from ..integrate.run.solution_file import StoredSolution, load_solution
from ..integrate.truth_error import TruthError, truth_error
from ..report.numbers import significant
from ..scene.scene import SolvedSurface


_MAX_LOST_FRACTION = 0.5
"""Largest fraction of the reference's surface that a run may lack [-]: coarser voxels
lose thin parts, but a run of another mesh lacks nearly everything."""


class Truth(NamedTuple):
    """The finer run that a config names."""

    config: TruthConfig
    reference: StoredSolution

    @classmethod
    def read(
        cls, config: SceneConfig, out: Path, surfaces: tuple[SolvedSurface, ...]
    ) -> "Truth | None":
        """Read the reference before the run; None if the config has no reference.

        Args:
            config: of the scene.
            out: folder of the run.
            surfaces: of the run's bodies.

        Raises:
            InputError: if it cannot be read, does not fit the scene, or would be
                overwritten by the run.
        """
        truth_config = config.truth
        if truth_config is None:
            return None
        path = truth_config.reference
        if path.resolve().parent == out.resolve():
            raise InputError(
                f"truth.reference: {path} would be written over by the run: name "
                "another --out"
            )
        times = config.time.save_times
        try:
            reference = load_solution(path).at_times(times, path)
        except InputError as error:
            raise InputError(f"truth.reference: {error}") from error
        if len(reference.surfaces) != len(surfaces):
            raise InputError(
                f"truth.reference: {path} has {len(reference.surfaces)} bodies and the "
                f"scene {len(surfaces)}: name a run of the same bodies"
            )
        truth = cls(config=truth_config, reference=reference)
        truth._check_surfaces(surfaces)
        return truth

    def _check_surfaces(self, surfaces: tuple[SolvedSurface, ...]) -> None:
        # Mistakes that follow from the surfaces alone are found before the run.
        fragments = sum(len(surface.geometry.fragment_area) for surface in surfaces)
        uniform = np.zeros((len(self.reference.times), fragments), np.float32)
        run = StoredSolution(self.reference.times, uniform, surfaces)
        try:
            trial = self._error(run)
        except InputError as error:
            raise InputError(
                f"truth.reference: {self.config.reference}: {error}"
            ) from error
        lost = float(trial.worst_lost_fraction)
        if lost > _MAX_LOST_FRACTION:
            raise InputError(
                f"truth.reference: {self.config.reference}: {100 * lost:.0f} % of its "
                "surface is not in the scene's bodies: name a run of the same meshes"
            )

    def _error(self, solution: Solution | StoredSolution) -> TruthError:
        return truth_error(
            solution,
            reference=self.reference,
            count=self.config.points,
            seed=self.config.seed,
        )

    def summary(self, solution: Solution) -> dict[str, Any]:
        """The error of a run and the reference, as plain types for `summary.json`."""
        return {
            "reference": str(self.config.reference),
            "points": self.config.points,
            "seed": self.config.seed,
            "pitch_m": _pitches(solution),
            "reference_pitch_m": _pitches(self.reference),
            **self._error(solution).as_dict(),
        }

    @staticmethod
    def in_words(summary: Mapping[str, Any]) -> list[str]:
        """Lines for the terminal: the error of a summary, and the remarks."""
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


def _pitches(run: Solution | StoredSolution) -> list[float]:
    return [surface.geometry.pitch for surface in run.surfaces]
