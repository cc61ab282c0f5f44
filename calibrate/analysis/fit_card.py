"""From a fit to its card: weights, and the ranges in which they were fitted."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxthermo.arrays import precision
from jaxthermo.scene.compile.compile import mechanism_names
from jaxthermo.scene.dimensionless_groups import scene_numbers
from jaxthermo.structures.fit_card import FitCard
from jaxthermo.structures.weights import ConductionWeights

from ..config.schema import CalibrationConfig
from ..problem.build import Built
from ..solvers.fit import Fit


def make_card(
    config: CalibrationConfig, built: Built, fit: Fit, result: dict[str, Any]
) -> FitCard:
    """The card of a fit; of a scene of several bodies, with the first one's weights.

    Args:
        config: of the calibration.
        built: its problems.
        fit: what was found.
        result: as in `fit.json`.
    """
    problem, first = built.train, built.train.cases[0]
    with precision(problem.dtype.name):
        z = jnp.asarray(fit.z, problem.dtype)
        scene = problem.scene(first, z)
        values = problem.parameters.values(z)
    weights = scene.bodies[0].structure.weights
    known = {name: np.asarray(value, float) for name, value in vars(weights).items()}
    others = {
        name: float(value)
        for name, value in values.items()
        if "weights" not in name.split(".") and np.ndim(value) == 0
    }
    ends = [built.configs[case.name].time.end for case in problem.cases]
    pairs = zip(problem.cases, ends, strict=True)
    numbers = [scene_numbers(case.scene, end) for case, end in pairs]
    return FitCard(
        name=config.name or "",
        structure=built.configs[first.name].bodies[0].structure.options,
        weights=ConductionWeights(**known),
        parameters=others,
        ranges={
            name: (min(n[name] for n in numbers), max(n[name] for n in numbers))
            for name in numbers[0]
        },
        mechanisms=tuple(
            dict.fromkeys(
                name for case in problem.cases for name in mechanism_names(case.scene)
            )
        ),
        error_percent=result["error_percent"],
        origin={
            "config": result["config_hash"],
            "program": result["program_hash"],
            **result["versions"],
        },
    )
