"""Errors of a fit against finer voxels, before and after, and what they cost."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.arrays import precision
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.integrate.run.solution import RESULTS
from jaxthermo.integrate.truth_error import truth_error
from jaxthermo.scene.scene import Scene

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
    """The runs of finer voxels of all cases."""

    given: RefinedReference
    references: dict[str, TruthReference]
    """By the name of the case."""

    @classmethod
    def prepare(
        cls, config: CalibrationConfig, known: dict[str, TruthReference], log: Log
    ) -> "Truth | None":
        """Run or load the references of all cases; None if the config asks for none.

        Those of `known` cases are there.

        Raises:
            InputError: if a scene has no finer voxels, or a run fails.
        """
        if config.truth is None:
            return None
        # The truth has the same values as the runs that are fitted to.
        reference = config.reference
        true = reference.set if isinstance(reference, FullVolumeReference) else {}
        found = dict(known)
        for case in (*config.train, *config.held_out):
            if case.name in found:
                continue
            said = lambda stage, name=case.name: log(f"{name}: {stage}")
            given = scene_config(config, case.set, true)
            try:
                found[case.name] = refined_reference(given, config.truth, said)
            except InputError as error:
                raise InputError(f"case {case.name}: {error}") from error
        return cls(config.truth, found)

    def judge(
        self, calibration: Calibration, z: Float[np.ndarray, " p"], log: Log
    ) -> dict[str, Any]:
        """Errors of all cases with the start values and at z, as in `fit.json`."""
        cases: dict[str, Any] = {}
        problems = {"train": calibration.train}
        if calibration.held_out is not None:
            problems["held_out"] = calibration.held_out
        for group, problem in problems.items():
            for case in problem.cases:
                reference = self.references[case.name]
                found: dict[str, Any] = {"reference": reference.own_error.as_dict()}
                for kind, at in (("default", np.zeros_like(z)), ("fitted", z)):
                    log(f"{case.name}: comparing {kind} values with finer voxels")
                    with precision(problem.dtype.name):
                        point = jnp.asarray(at, problem.dtype)
                        scene = problem.parameters.insert(case.scene, point)
                    given = calibration.configs[case.name]
                    found[kind] = self._error(scene, given, reference)
                cases.setdefault(group, {})[case.name] = found
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

    def _error(
        self, scene: Scene, given: SceneConfig, reference: TruthReference
    ) -> dict[str, Any]:
        # As `jaxthermo simulate` runs it, with its error in time controlled.
        solver = given.solver.build()
        scene = read_at_surface(scene)
        end, saves = given.time.end, given.time.save_times
        found = simulate(scene, end, saves, solver=solver, throw=False)
        if found.result != RESULTS.successful:
            raise InputError(f"the run beside finer voxels: {RESULTS[found.result]}")
        error = truth_error(
            found, reference.solution, self.given.points, self.given.seed
        )
        return error.as_dict()
