"""What a run is compared with: a full volume's surface, or frames of a camera.

Every target turns surface temperatures into misfits whose squares sum to about 1 where
model and data differ by one unit: 1 % of the error of `surface_error`, or one standard
deviation of a pixel's noise.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxthermo.errors import InputError
from jaxthermo.integrate.run.parametric_run import Answer
from jaxthermo.integrate.surface_error import AnySolution, error_span
from jaxthermo.scene.scene import Scene


class AbstractTarget(eqx.Module):
    """Data of one case."""

    @property
    @abc.abstractmethod
    def known_sd(self) -> float | None:
        """Standard deviation that noise gives a misfit; None if it is not known."""

    @property
    @abc.abstractmethod
    def moments(self) -> tuple[float, ...]:
        """Which saved times it needs [s]."""

    @abc.abstractmethod
    def misfit(self, scene: Scene, answer: Answer) -> Float[Array, "t r"]:
        """Of a run, a row a saved time."""


class SurfaceTarget(AbstractTarget):
    """The surface of a reference run: a misfit of 1 is an error of 1 %.

        r_ts = 100 sqrt(a_s / sum a) (T_ts - T_ref,ts) / span_t / sqrt(times),

    whose squares sum to the mean over the times of the squared error in percent.
    """

    times: tuple[float, ...] = eqx.field(static=True)
    reference: Float[Array, "t s"]
    """[K]"""
    scale: Float[Array, "t s"]
    """[1/K]"""

    @property
    def known_sd(self) -> float | None:
        """None: what is left is the model's error, not noise."""
        return None

    @property
    def moments(self) -> tuple[float, ...]:
        """As saved."""
        return self.times

    def misfit(self, scene: Scene, answer: Answer) -> Float[Array, "t r"]:
        """Of every fragment at every time."""
        del scene
        return (answer.surface - self.reference) * self.scale


def surface_target(reference: AnySolution, dtype: Any) -> SurfaceTarget:
    """From a run of the full volume.

    Args:
        reference: saved at times after 0.
        dtype: of the fitted scene.

    Raises:
        InputError: if its surface has one temperature only.
    """
    surface = np.asarray(reference.surface_temperature, float)
    times = tuple(float(t) for t in np.asarray(reference.times))
    if not np.isfinite(surface).all():
        raise InputError("the reference holds temperatures that are not finite")
    if not (np.ptp(surface, axis=1) > 0).any():
        raise InputError(
            "the reference's surface has one temperature at every saved time: there is "
            "nothing to fit; give a case that heats it unevenly"
        )
    area = np.concatenate([s.geometry.fragment_area for s in reference.surfaces])
    span = np.asarray(error_span(jnp.asarray(surface)), float)
    scale = 100 * np.sqrt(area / area.sum())[None] / span[:, None]
    scale = scale / np.sqrt(len(times))
    return SurfaceTarget(times, jnp.asarray(surface, dtype), jnp.asarray(scale, dtype))
