"""A calibration whose cameras start where the outlines in their frames are."""

import numpy as np

from ..config.schema import CalibrationConfig
from ..problem.build import Calibration, build
from ..problem.clusters import design_effect
from ..problem.problem import Problem
from ..problem.reference import Log
from .fit import Fitting


_TOLERANCE, _MAX_STEPS = 1e-2, 10
"""Accuracy of the first fit, whose residuals are only sized."""


def build_aligned(config: CalibrationConfig, log: Log) -> Calibration:
    """Build a calibration, and align its cameras if their poses are fitted.

    With all else fitted in the poses that the outlines give, the residuals tell how
    much less than independent ones they say about the poses: a coarse model is off by
    about the same over a whole part of a body.
    """
    calibration = build(config, log)
    if not calibration.train.aligned:
        return calibration
    others = calibration.without_cameras()
    if others is None:
        return calibration
    log("fitting all but the cameras")
    accuracy = {"tolerance": _TOLERANCE, "max_steps": _MAX_STEPS}
    fit = Fitting(others, config.fit.model_copy(update=accuracy)).run()
    return calibration.weighed(_data_effect(others, fit.residual))


def _data_effect(problem: Problem, residual: np.ndarray) -> float:
    """Squares that the data's residuals sum to, over those of independent ones."""
    clusters, sd = problem.clusters, problem.known_sd
    assert clusters is not None and sd is not None
    return max(design_effect(residual[: len(clusters)] / sd, clusters), 1.0)
