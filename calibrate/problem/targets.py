"""Data that runs are compared with; here the surface of a full-volume run.

A target turns surface temperatures into residuals whose squares sum to about 1 where
model and data differ by one unit: 1 % error, or one standard deviation of pixel noise.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import ParametricSolution
from jaxthermo.integrate.surface_error import AnySolution, error_span
from jaxthermo.scene.scene import Scene


class CaseError(NamedTuple):
    """Root mean square error of one case at each saved time."""

    times: tuple[float, ...]
    """[s]"""
    percent: tuple[float, ...]
    """Percent of the reference's temperature range, or of the pixel noise."""
    kelvin: tuple[float, ...]
    """In kelvin, or in the unit of the frames."""

    @property
    def worst(self) -> float:
        """Error of the case: the largest over the times [%]."""
        return max(self.percent)

    def as_json(self) -> dict[str, Any]:
        """Values for `fit.json`."""
        return {
            "times_s": list(self.times),
            "rms_percent": list(self.percent),
            "rms_kelvin": list(self.kelvin),
            "worst_percent": self.worst,
        }


class AbstractTarget(eqx.Module):
    """Data of one case."""

    times: eqx.AbstractVar[tuple[float, ...]]

    @property
    @abc.abstractmethod
    def known_sd(self) -> float | None:
        """Standard deviation of a residual due to noise; None if it is not known."""

    @abc.abstractmethod
    def residual(
        self, scene: Scene, solution: ParametricSolution
    ) -> Float[Array, "t r"]:
        """Residuals of a run, one row per saved time."""

    @abc.abstractmethod
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        """Error in percent and kelvin of the root sum of squared residuals."""


class SurfaceTarget(AbstractTarget):
    """Surface temperatures of a reference run: a residual norm of 1 is an error of 1 %.

        r_ts = 100 sqrt(a_s / sum a) (T_ts - T_ref,ts) / span_t / sqrt(times),

    whose squares sum to the mean over the times of the squared error in percent.
    """

    times: tuple[float, ...] = eqx.field(static=True)
    reference: Float[Array, "t s"]
    """[K]"""
    scale: Float[Array, "t s"]
    """[1/K]"""

    @property
    @override
    def known_sd(self) -> float | None:
        # What remains after a fit is the model's error and no noise.
        return None

    @override
    def residual(
        self, scene: Scene, solution: ParametricSolution
    ) -> Float[Array, "t r"]:
        # The scene's terms only matter to cameras.
        del scene
        return (solution.surface_temperature - self.reference) * self.scale

    @override
    def case_error(self, errors: Float[np.ndarray, " t"]) -> CaseError:
        span = np.asarray(error_span(jnp.asarray(np.asarray(self.reference))), float)
        return CaseError(self.times, tuple(errors.tolist()), tuple(errors * span / 100))


def surface_target(reference: AnySolution, dtype: Any) -> SurfaceTarget:
    """Make a target of a full-volume run that is saved at times after 0.

    Raises:
        InputError: if its surface temperatures are uniform or not finite.
    """
    surface = np.asarray(reference.surface_temperature, float)
    times = tuple(float(t) for t in np.asarray(reference.times))
    if not np.isfinite(surface).all():
        raise InputError("the reference holds temperatures that are not finite")
    # Errors are relative to the range of the surface temperatures.
    if not (np.ptp(surface, axis=1) > 0).any():
        raise InputError(
            "the reference's surface has one temperature at every saved time: there is "
            "nothing to fit; give a case that heats it unevenly"
        )
    area = np.concatenate([s.geometry.fragment_area for s in reference.surfaces])
    span = np.asarray(error_span(jnp.asarray(surface)), float)
    scale = 100 * np.sqrt(area / area.sum())[None] / span[:, None]
    # The sum of squares is then the mean over the times.
    scale = scale / np.sqrt(len(times))
    return SurfaceTarget(times, jnp.asarray(surface, dtype), jnp.asarray(scale, dtype))
