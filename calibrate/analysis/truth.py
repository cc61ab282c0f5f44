"""Errors of a fit against finer voxels, before and after, and the cost of these."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxthermo.accuracy.error_records import TruthErrors
from jaxthermo.accuracy.truth_error import truth_error
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import stable_solver
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import RESULTS

from ..config.fit_record import TruthCase, TruthRecord
from ..config.loader import scene_config
from ..config.schema import CalibrationConfig, FullVolumeReference, RefinedReference
from ..problem.build import Calibration
from ..problem.reference import (
    Log,
    TruthReference,
    read_at_surface,
    refined_reference,
)


@dataclass(frozen=True, eq=False)
class Truth:
    """Runs of finer voxels of all cases, and the errors of the scene's own values."""

    settings: RefinedReference
    references: dict[str, TruthReference]
    """By the name of the case."""
    calibration: Calibration
    default: dict[str, TruthErrors]
    """Errors of the scene's own values by case, as plain values."""

    @classmethod
    def prepare(
        cls, config: CalibrationConfig, calibration: Calibration, log: Log
    ) -> "Truth | None":
        """Run or load the references of all cases; None if the config asks for none.

        This happens before the fit, together with runs of the scene's own values, so
        that what cannot be run or compared is reported at once.

        Raises:
            InputError: if a scene has no finer voxels, or a run fails.
        """
        if config.truth is None:
            return None
        # The truth has the same values as the runs that are fitted to.
        reference = config.reference
        true = reference.set if isinstance(reference, FullVolumeReference) else {}
        references = dict(calibration.references)
        default: dict[str, TruthErrors] = {}
        truth = cls(
            settings=config.truth,
            references=references,
            calibration=calibration,
            default=default,
        )
        start = calibration.train.default()
        for case in (*config.train, *config.held_out):
            announce = _named(log, case.name)
            try:
                if case.name not in references:
                    references[case.name] = refined_reference(
                        scene_config(config, case.set, true),
                        settings=config.truth,
                        log=announce,
                    )
                announce("comparing the scene's own values with finer voxels")
                default[case.name] = truth._error(case.name, start)
            except InputError as error:
                raise InputError(f"case {case.name}: {error}") from error
        return truth

    def judge(self, z: Float[np.ndarray, " p"], log: Log) -> TruthRecord | None:
        """Errors of all cases with the scene's own values and at z, as in `fit.json`.

        None, with a warning, if a run with the fitted values fails.
        """
        cases: dict[str, dict[str, TruthCase]] = {}
        for group, problem in self.calibration.problems.items():
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
                own_error = self.references[name].own_error
                cases[group][name] = {
                    "default": self.default[name],
                    "fitted": fitted,
                    "reference": own_error.as_dict(),
                }
        record: Any = {
            "refinement": self.settings.refinement,
            "structure": self.settings.structure.kind,
            "points": self.settings.points,
            "cases": cases,
            "cost": [
                {"case": name, **cost}
                for name, reference in self.references.items()
                for cost in reference.costs
            ],
        }
        return record

    def _error(self, name: str, z: Float[np.ndarray, " p"]) -> TruthErrors:
        scene = self.calibration.scene_at(name, z)
        # As `jaxthermo simulate` runs it, with its error in time controlled.
        config = self.calibration.configs[name]
        solution = simulate(
            read_at_surface(scene),
            t1=config.time.end,
            save_at=config.time.save_times,
            solver=stable_solver(
                config.solver.build(), scene=scene, end=config.time.last
            ),
            throw=False,
        )
        if solution.result != RESULTS.successful:
            raise InputError(
                f"the run compared with finer voxels: {RESULTS[solution.result]}"
            )
        error = truth_error(
            solution,
            reference=self.references[name].solution,
            count=self.settings.points,
            seed=self.settings.seed,
        )
        return error.as_dict()


def _named(log: Log, name: str) -> Log:
    """Log whose lines start with the name of a case."""
    return lambda stage: log(f"{name}: {stage}")
