"""What a calibration leaves behind, as plain values: `fit.json`."""

from typing import Any

import numpy as np

from jaxthermo import __version__

from ..analysis.identifiability import Identified
from ..config.loader import calibration_hash, plain
from ..config.schema import CalibrationConfig, unit_of
from ..problem.build import Calibration
from ..problem.reference import program_hash
from ..problem.targets import CaseError
from ..solvers.fit import Fit


Errors = dict[str, dict[str, dict[str, CaseError]]]
"""By "train" or "held_out", then by "default" or "fitted", then by case."""


def worst(errors: dict[str, CaseError]) -> float:
    """The error of several cases: the largest."""
    return max(error.worst for error in errors.values())


def fit_json(
    config: CalibrationConfig,
    calibration: Calibration,
    fit: Fit,
    identified: Identified,
    errors: Errors,
    advice: list[dict[str, Any]],
    speed: dict[str, Any],
    versions: dict[str, str],
) -> dict[str, Any]:
    """All that is told of a fit.

    Args:
        config: of the calibration.
        calibration: its problems.
        fit: what was found.
        identified: what it is worth.
        errors: before and after.
        advice: further runs that would tell more.
        speed: of the fitted structure beside the full volume.
        versions: of the packages.
    """
    start = np.asarray(
        calibration.train.parameters.flat_values(np.zeros_like(fit.z)), float
    )
    judged = fit.jacobian is not None
    parameters = (_each if judged else _fields)(calibration, identified, start)
    return {
        "name": config.name,
        "parameters": parameters,
        "loss": {"initial": fit.initial_loss, "final": fit.loss},
        "ended": fit.ended,
        "error_percent": {
            group: {kind: worst(found) for kind, found in both.items()}
            for group, both in errors.items()
        },
        "errors": {
            group: {
                kind: {case: e.as_json() for case, e in found.items()}
                for kind, found in both.items()
            }
            for group, both in errors.items()
        },
        "correlation": np.round(identified.correlation, 6).tolist(),
        "singular_values": identified.singular_values.tolist(),
        "advice": advice,
        "speedup": speed,
        "steps": [
            {
                "step": step.number,
                "loss": step.loss,
                "accepted": step.accepted,
                "jacobian_computed": step.exact,
                "values": list(step.values) if judged else [],
            }
            for step in fit.steps
        ],
        "run_time_s": {
            "fit": fit.step_seconds,
            "one_run": fit.run_seconds,
            "compile": fit.compile_seconds,
        },
        "reference": config.reference.kind,
        "config": plain(config),
        "config_hash": calibration_hash(config),
        "program_hash": program_hash(),
        "seed": config.fit.seed,
        "versions": {"jaxthermo": __version__, **versions},
    }


def _each(
    calibration: Calibration, identified: Identified, start
) -> dict[str, dict[str, Any]]:
    """A row a value."""
    del calibration
    return {
        verdict.label: {
            "value": verdict.value,
            "initial": float(first),
            "standard_error": verdict.standard_error,
            "verdict": verdict.verdict,
            "with": list(verdict.with_others),
            "unit": unit_of(verdict.label),
        }
        for verdict, first in zip(identified.verdicts, start, strict=True)
    }


def _fields(
    calibration: Calibration, identified: Identified, start
) -> dict[str, dict[str, Any]]:
    """A row a parameter, of thousands of values: the card has them all."""
    found, begin = {}, 0
    values = np.array([verdict.value for verdict in identified.verdicts])
    for parameter in calibration.train.parameters.parameters:
        end = begin + len(parameter.labels)
        own, first = values[begin:end], start[begin:end]
        found[parameter.name] = {
            "value": float(np.median(own)),
            "initial": float(np.median(first)),
            "standard_error": None,
            "verdict": identified.verdicts[begin].verdict,
            "with": [],
            "unit": unit_of(parameter.name),
            "count": len(own),
            "min": float(own.min()),
            "max": float(own.max()),
        }
        begin = end
    return found
