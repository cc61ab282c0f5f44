"""A calibration whose cameras start where the outlines in their frames are."""

import numpy as np

from ..config.schema import CalibrationConfig
from ..problem.build import Calibration, build
from ..problem.reference import Log
from .fit import Fitting


_TOLERANCE, _MAX_STEPS = 1e-2, 10
"""Accuracy of the first fit: outlines hardly depend on the temperatures."""


def build_aligned(config: CalibrationConfig, log: Log) -> Calibration:
    """Build a calibration, and align its cameras if their poses are fitted.

    Outlines are first found at the start values; then, with all else fitted in these
    poses, again, to a small part of a pixel.
    """
    rough = build(config, log)
    if not rough.aligned:
        return rough
    others = rough.without_cameras()
    values = {}
    if others is not None:
        log("fitting all but the cameras")
        accuracy = {"tolerance": _TOLERANCE, "max_steps": _MAX_STEPS}
        fit = Fitting(others, config.fit.model_copy(update=accuracy)).run()
        found = others.parameters.values(np.asarray(fit.z, others.dtype))
        values = {name: np.asarray(value, float) for name, value in found.items()}
    return build(config, log, rough, values)
