"""A calibration whose cameras start where the outlines in their frames are."""

import numpy as np

from ..config.schema import CalibrationConfig
from ..problem.build import Calibration, build
from ..problem.clusters import design_effect
from ..problem.problem import Problem
from ..problem.reference import Log
from .fit import Fitting


_TOLERANCE = 1e-2
"""Accuracy of the first fit, of which only the size of the residuals counts."""
_MAX_STEPS = 10
"""Largest number of steps of the first fit."""


def build_aligned(config: CalibrationConfig, log: Log) -> Calibration:
    """Build a calibration, and align its cameras if their poses are fitted.

    With all else fitted in the poses that the outlines give, the residuals tell how
    much less than independent ones they say about the poses: a coarse model is off by
    about the same over a whole part of a body.
    """
    calibration = build(config, log)
    if not calibration.train.aligned:
        return calibration
    without_cameras = calibration.without_cameras()
    if without_cameras is None:
        return calibration
    log("fitting all but the cameras")
    accuracy = {"tolerance": _TOLERANCE, "max_steps": _MAX_STEPS}
    fit = Fitting(without_cameras, config.fit.model_copy(update=accuracy)).run()
    return calibration.weighed(_data_effect(without_cameras, fit.residual))


def _data_effect(problem: Problem, residual: np.ndarray) -> float:
    """Squares that the data's residuals sum to, over those of independent ones."""
    clusters = problem.clusters()
    sd = problem.known_sd
    assert clusters is not None and sd is not None
    return max(design_effect(residual[: len(clusters)] / sd, clusters), 1.0)
