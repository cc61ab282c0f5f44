"""A finer run in a file, with which a run is compared as its bodies are known."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..integrate.run.abstract_solution import StoredSolution
from ..integrate.run.solution_file import load_solution
from ..scene.scene import SolvedSurface
from .error_records import ReferenceComparison
from .surface_error import AnySolution
from .truth_error import TruthError, truth_error


# A run of much coarser voxels lacks thin parts; one of another mesh nearly everything.
_MAX_LOST_FRACTION = 0.5
"""Fraction of the reference's surface without which a run is of another mesh [-]."""


class ReferenceRun(NamedTuple):
    """A finer run that a `solution.npz` stores, and how runs are compared with it."""

    path: Path
    solution: StoredSolution
    """The finer run, at the save times of the runs that are compared."""
    points: int
    """Number of points, on all bodies together."""
    seed: int
    """Seed of the points."""

    @classmethod
    def load(
        cls, path: Path, times: tuple[float, ...], points: int, seed: int
    ) -> "ReferenceRun":
        """Read a reference at the save times of a run [s].

        Raises:
            InputError: if it cannot be read, or lacks one of the times.
        """
        solution = load_solution(path).at_times(times, path)
        return cls(path=path, solution=solution, points=points, seed=seed)

    def check(self, surfaces: tuple[SolvedSurface, ...]) -> None:
        """Compare the surfaces of a run with those of the reference, before the run.

        Raises:
            InputError: if they are those of other bodies or meshes.
        """
        expected = len(self.solution.surfaces)
        if expected != len(surfaces):
            raise InputError(
                f"{self.path} has {expected} bodies and the scene {len(surfaces)}: "
                "name a run of the same bodies"
            )
        fragments = sum(len(surface.geometry.fragment_area) for surface in surfaces)
        uniform = np.zeros((len(self.solution.times), fragments), np.float32)
        trial = StoredSolution(self.solution.times, uniform, surfaces)
        try:
            lost = float(self.error(trial).worst_lost_fraction)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error
        if lost > _MAX_LOST_FRACTION:
            raise InputError(
                f"{self.path}: {100 * lost:.0f} % of its surface is not in the scene's "
                "bodies: name a run of the same meshes"
            )

    def error(self, solution: AnySolution) -> TruthError:
        """Compare a run with the reference, see `truth_error`."""
        return truth_error(
            solution, reference=self.solution, count=self.points, seed=self.seed
        )

    def summary(self, solution: AnySolution) -> ReferenceComparison:
        """Return the error of a run and the comparison as plain types for JSON."""
        return ReferenceComparison(
            reference=str(self.path),
            points=self.points,
            seed=self.seed,
            pitch_m=[surface.geometry.pitch for surface in solution.surfaces],
            reference_pitch_m=[
                surface.geometry.pitch for surface in self.solution.surfaces
            ],
            **self.error(solution).as_dict(),
        )
