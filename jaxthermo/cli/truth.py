"""`truth` of a config: the error of a run against a finer one, for `summary.json`."""

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


# A run of much coarser voxels lacks thin parts; one of another mesh nearly everything.
_MAX_LOST_FRACTION = 0.5
"""Fraction of the reference's surface without which a run is of another mesh [-]."""


class Truth(NamedTuple):
    """The finer run that a config names."""

    given: TruthConfig
    reference: StoredSolution

    @classmethod
    def read(
        cls, config: SceneConfig, out: Path, surfaces: tuple[SolvedSurface, ...]
    ) -> "Truth | None":
        """Read the reference before the run; None if the config names none.

        Args:
            config: of the scene.
            out: folder of the run.
            surfaces: of the run's bodies.

        Raises:
            InputError: if it cannot be read, does not fit the scene, or would be
                written over by the run.
        """
        given = config.truth
        if given is None:
            return None
        path = given.reference
        if path.resolve().parent == out.resolve():
            raise InputError(
                f"truth.reference: {path} would be written over by the run: name "
                "another --out"
            )
        times = config.time.save_times
        try:
            found = load_solution(path).at_times(times, path)
        except InputError as error:
            raise InputError(f"truth.reference: {error}") from error
        if len(found.surfaces) != len(surfaces):
            raise InputError(
                f"truth.reference: {path} has {len(found.surfaces)} bodies and the "
                f"scene {len(surfaces)}: name a run of the same bodies"
            )
        truth = cls(given, found)
        truth._check_surfaces(surfaces)
        return truth

    def _check_surfaces(self, surfaces: tuple[SolvedSurface, ...]) -> None:
        # What follows from the surfaces alone is known before the run.
        fragments = sum(len(surface.geometry.fragment_area) for surface in surfaces)
        even = np.zeros((len(self.reference.times), fragments), np.float32)
        try:
            trial = self._error(StoredSolution(self.reference.times, even, surfaces))
        except InputError as error:
            raise InputError(
                f"truth.reference: {self.given.reference}: {error}"
            ) from error
        lost = float(trial.worst_lost_fraction)
        if lost > _MAX_LOST_FRACTION:
            raise InputError(
                f"truth.reference: {self.given.reference}: {100 * lost:.0f} % of its "
                "surface is not in the scene's bodies: name a run of the same meshes"
            )

    def _error(self, solution: Solution | StoredSolution) -> TruthError:
        return truth_error(
            solution,
            reference=self.reference,
            count=self.given.points,
            seed=self.given.seed,
        )

    def summary(self, solution: Solution) -> dict[str, Any]:
        """The error of a run as plain types, and what it was compared with."""
        pitches = lambda run: [surface.geometry.pitch for surface in run.surfaces]
        return {
            "reference": str(self.given.reference),
            "points": self.given.points,
            "seed": self.given.seed,
            "pitch_m": pitches(solution),
            "reference_pitch_m": pitches(self.reference),
            **self._error(solution).as_dict(),
        }

    @staticmethod
    def in_words(summary: dict[str, Any]) -> list[str]:
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
