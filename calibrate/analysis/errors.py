"""What fits are judged by: the error of `surface_error`, before and after."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.integrate.surface_error import error_span

from ..problem.problem import Case
from ..problem.targets import SurfaceTarget
from ..problem.thermogram_targets import FrameTarget


class CaseError(NamedTuple):
    """Of one case, at every saved time."""

    times: tuple[float, ...]
    percent: tuple[float, ...]
    """Root mean square: of the reference's span; of the noise times 100, of frames."""
    kelvin: tuple[float, ...]
    """The same in kelvin, or in what frames show."""

    @property
    def worst(self) -> float:
        """The largest over the times: the case's error."""
        return max(self.percent)


def case_error(case: Case, errors: Float[np.ndarray, " t"]) -> CaseError:
    """How far a run is from its data.

    Args:
        case: with its data.
        errors: of its misfits at every time, as `Seen` has them.
    """
    target, found = case.target, np.asarray(errors, float)
    times = target.moments
    if isinstance(target, SurfaceTarget):
        span = np.asarray(error_span(jnp.asarray(np.asarray(target.reference))), float)
        return CaseError(times, tuple(found.tolist()), tuple(found * span / 100))
    assert isinstance(target, FrameTarget)
    return CaseError(times, tuple((100 * found).tolist()), tuple(found * target.noise))


def case_errors(
    cases: tuple[Case, ...], errors: tuple[Float[np.ndarray, " t"], ...]
) -> dict[str, CaseError]:
    """Of several cases, by their names."""
    pairs = zip(cases, errors, strict=True)
    return {case.name: case_error(case, found) for case, found in pairs}


def plain(error: CaseError) -> dict[str, Any]:
    """For a file."""
    return {
        "times_s": list(error.times),
        "rms_percent": list(error.percent),
        "rms_kelvin": list(error.kelvin),
        "worst_percent": error.worst,
    }
