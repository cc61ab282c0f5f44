"""A measured series of temperatures as the data of a problem."""

import math
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from calibrate.problem.targets import SurfaceTarget
from jaxthermo.constants import ZERO_CELSIUS
from jaxthermo.voxels.selection import FACES


def fragment_of(scene: jt.Scene, face: Literal["front", "back"]) -> int:
    """Number of a fragment of a face of the first body, a sheet."""
    of_face = scene.bodies[0].structure.grid.fragment_face
    assert of_face is not None
    return int(np.flatnonzero(of_face == FACES.index(face))[0])


def thermocouple(
    times: tuple[float, ...],
    temperatures: Float[np.ndarray, " t"],
    fragment: int,
    fragments: int,
) -> SurfaceTarget:
    """Temperatures [K] of one of the fragments of a scene at times [s].

    Its residuals are in kelvin, over the root of their number. Where no temperature is
    known it is 0 degC: such a time is to be left out.
    """
    known = np.nan_to_num(temperatures, nan=ZERO_CELSIUS)
    reference: Any = np.repeat(known[:, None], fragments, axis=1)
    scale: Any = np.zeros(reference.shape)
    scale[:, fragment] = 1 / math.sqrt(len(times))
    return SurfaceTarget(times=times, reference=reference, scale=scale)
