"""Results of a calibration as plain values: the content of `fit.json`."""

from typing import Any

import numpy as np
from jaxtyping import Float

from jaxthermo import __version__

from ..analysis.identifiability import Identified
from ..config.loader import calibration_hash, plain
from ..config.schema import CalibrationConfig, unit_of
from ..problem.parameters import ParameterSet
from ..problem.reference import program_hash
from ..problem.targets import CaseError
from ..solvers.fit import Fit


Errors = dict[str, dict[str, dict[str, CaseError]]]
"""Errors by "train" or "held_out", then by "default" or "fitted", then by case."""


def fit_json(
    config: CalibrationConfig,
    parameters: ParameterSet,
    fit: Fit,
    identified: Identified,
    errors: Errors,
    advice: list[dict[str, Any]],
    speed: dict[str, Any],
    versions: dict[str, str],
) -> dict[str, Any]:
    """Collect all results of a fit."""
    # Without a Jacobian there are too many values for a row each.
    start = np.asarray(parameters.flat_values(np.zeros_like(fit.z)), float)
    judged = fit.jacobian is not None
    rows = parameter_rows(identified, start)
    return {
        "name": config.name,
        "parameters": rows if judged else _field_rows(parameters, identified, start),
        "loss": {"initial": fit.initial_loss, "final": fit.loss},
        "ended": fit.ended,
        "error_percent": {
            group: {
                kind: max(error.worst for error in found.values())
                for kind, found in both.items()
            }
            for group, both in errors.items()
        },
        "errors": {
            group: {
                kind: {case: error.as_json() for case, error in found.items()}
                for kind, found in both.items()
            }
            for group, both in errors.items()
        },
        # Digits beyond these would only make the file longer.
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


def parameter_rows(
    identified: Identified, start: Float[np.ndarray, " p"]
) -> dict[str, dict[str, Any]]:
    """A row for every value, by its label."""
    return {
        verdict.label: {
            "value": verdict.value,
            "initial": float(initial),
            "standard_error": verdict.standard_error,
            "verdict": verdict.verdict,
            "with": list(verdict.with_others),
            "unit": unit_of(verdict.label),
        }
        for verdict, initial in zip(identified.verdicts, start, strict=True)
    }


def _field_rows(
    parameters: ParameterSet, identified: Identified, start: Float[np.ndarray, " p"]
) -> dict[str, dict[str, Any]]:
    # A row for every field of thousands of values, all of which are in the card.
    found, first = {}, 0
    values = np.array([verdict.value for verdict in identified.verdicts])
    for parameter in parameters.parameters:
        part = slice(first, first + parameter.size)
        found[parameter.name] = {
            "value": float(np.median(values[part])),
            "initial": float(np.median(start[part])),
            "standard_error": None,
            "verdict": identified.verdicts[first].verdict,
            "with": [],
            "unit": unit_of(parameter.name),
            "count": parameter.size,
            "min": float(values[part].min()),
            "max": float(values[part].max()),
        }
        first += parameter.size
    return found
