"""Errors of a fit against finer voxels, before and after, and what they cost."""

import warnings
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.accuracy.truth_error import truth_error
from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import RESULTS

from ..config.loader import scene_config
from ..config.schema import CalibrationConfig, FullVolumeReference, RefinedReference
from ..problem.build import Calibration
from ..problem.problem import Problem
from ..problem.reference import (
    Log,
    TruthReference,
    read_at_surface,
    refined_reference,
)


@dataclass(frozen=True, eq=False)
class Truth:
    """The runs of finer voxels of all cases, and the errors of the start values."""

    given: RefinedReference
    references: dict[str, TruthReference]
    """By the name of the case."""
    calibration: Calibration
    default: dict[str, dict[str, Any]]
    """Errors of the start values by case, as plain values."""

    @classmethod
    def prepare(
        cls, config: CalibrationConfig, calibration: Calibration, log: Log
    ) -> "Truth | None":
        """Run or load the references of all cases; None if the config asks for none.

        Before the fit, with the start values beside them: what cannot be run or
        compared is then known at once.

        Raises:
            InputError: if a scene has no finer voxels, or a run fails.
        """
        if config.truth is None:
            return None
        # The truth has the same values as the runs that are fitted to.
        reference = config.reference
        true = reference.set if isinstance(reference, FullVolumeReference) else {}
        found, default = dict(calibration.references), {}
        truth = cls(config.truth, found, calibration, default)
        start = np.zeros(calibration.parameters.size)
        for case in (*config.train, *config.held_out):
            said = lambda stage, name=case.name: log(f"{name}: {stage}")
            try:
                if case.name not in found:
                    given = scene_config(config, case.set, true)
                    found[case.name] = refined_reference(given, config.truth, said)
                said("comparing the start values with finer voxels")
                default[case.name] = truth._error(case.name, start)
            except InputError as error:
                raise InputError(f"case {case.name}: {error}") from error
        return truth

    def judge(self, z: Float[np.ndarray, " p"], log: Log) -> dict[str, Any] | None:
        """Errors of all cases with the start values and at z, as in `fit.json`.

        None, with a warning, if a run with the fitted values fails.
        """
        cases: dict[str, Any] = {}
        for group, problem in self._problems.items():
            cases[group] = {}
            for name in (case.name for case in problem.cases):
                log(f"{name}: comparing the fitted values with finer voxels")
                try:
                    fitted = self._error(name, z)
                except InputError as error:
                    # The results of a long fit must not be lost.
                    text = f"case {name}: no error against finer voxels: {error}"
                    warnings.warn(text, stacklevel=2)
                    return None
                own = self.references[name].own_error.as_dict()
                both = {"default": self.default[name], "fitted": fitted}
                cases[group][name] = {**both, "reference": own}
        return {
            "refinement": self.given.refinement,
            "structure": self.given.structure.kind,
            "points": self.given.points,
            "cases": cases,
            "cost": [
                {"case": name, **cost}
                for name, reference in self.references.items()
                for cost in reference.costs
            ],
        }

    @property
    def _problems(self) -> dict[str, Problem]:
        held_out = self.calibration.held_out
        both = {"train": self.calibration.train}
        return both if held_out is None else {**both, "held_out": held_out}

    def _error(self, name: str, z: Float[np.ndarray, " p"]) -> dict[str, Any]:
        problem, case = next(
            (problem, case)
            for problem in self._problems.values()
            for case in problem.cases
            if case.name == name
        )
        with precision(problem.dtype.name):
            scene = problem.parameters.insert(case.scene, jnp.asarray(z, problem.dtype))
        # As `jaxthermo simulate` runs it, with its error in time controlled.
        given, reference = self.calibration.configs[name], self.references[name]
        end, saves = given.time.end, given.time.save_times
        solver, scene = given.solver.build(), read_at_surface(scene)
        found = simulate(scene, end, saves, solver=solver, throw=False)
        if found.result != RESULTS.successful:
            raise InputError(f"the run beside finer voxels: {RESULTS[found.result]}")
        points = self.given.points, self.given.seed
        return truth_error(found, reference.solution, *points).as_dict()
