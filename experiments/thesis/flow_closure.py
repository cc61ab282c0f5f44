"""The flow around a warm rod, round or square, beside what its local number is set to.

The thesis gives every surface the heat transfer of a cylinder at the angle of its
normal to the wind. Here the same rods stand in a computed flow. Nusselt numbers are of
the round rod's diameter or the square one's width, in air.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxthermo.flow.body import body_links
from jaxthermo.flow.lattice import VELOCITIES
from jaxthermo.flow.measures import mean_nusselt, nusselt_shape
from jaxthermo.flow.run import FlowRun, simulate_flow
from jaxthermo.flow.wake_runs import PRANDTL, wake_channel, wake_run, wake_setup
from jaxthermo.physics.convection.cross_flow import local_nusselt
from jaxthermo.physics.convection.nusselt import churchill_bernstein, profile


DEGREES = np.arange(0.0, 180.5, 3.0)
"""Angles from the front."""
FACES = {"front": 0.0, "each side": 90.0, "rear": 180.0}
"""Faces of a square rod, and the angle of their normals from the wind [degrees]."""

# Diameter of the round rod as large as a square one, over its width: the thesis leaves
# the length of what is no cylinder open, and the package takes this one.
_AS_LARGE = 2 / np.sqrt(np.pi)


# Cosines of the flow's number: at these sizes of the lattice more are noise.
_COSINES = 4


class RoundRod(NamedTuple):
    """Numbers around a round rod by the flow and by the local number."""

    reynolds: float
    run: FlowRun
    flow: Float[np.ndarray, " a"]
    """At `DEGREES`, of four cosines."""
    closure: Float[np.ndarray, " a"]
    flow_mean: float
    closure_mean: float
    correlation_mean: float
    """Average of Churchill and Bernstein."""

    @property
    def rms(self) -> float:
        """RMS difference around the rod over the mean of the flow [-]."""
        return float(np.sqrt(np.mean((self.closure - self.flow) ** 2))) / self.flow_mean


class SquareRod(NamedTuple):
    """Numbers of the faces of a square rod, which faces the wind."""

    reynolds: float
    run: FlowRun
    flow: dict[str, float]
    closure: dict[str, float]

    @property
    def means(self) -> tuple[float, float]:
        """Means over the four faces by flow and closure."""
        mean = lambda n: (n["front"] + 2 * n["each side"] + n["rear"]) / 4
        return mean(self.flow), mean(self.closure)


@jax.jit
def _local_number(degrees, reynolds):
    cosine = jnp.cos(jnp.radians(degrees))
    every = lambda value: jnp.full(cosine.shape, value)
    return local_nusselt(cosine, every(reynolds), every(PRANDTL), profile)


def local_number(degrees: np.ndarray, reynolds: float) -> np.ndarray:
    """Local Nusselt numbers that the thesis' model gives to normals."""
    with jax.enable_x64(True):
        return np.asarray(_local_number(degrees, reynolds))


def round_rod(reynolds: float, cells: int, passes: float) -> RoundRod:
    """Compute the flow around a round rod of so many cells, for so many passes."""
    setup = wake_setup(reynolds, cells, heated=True)._replace(passes=passes)
    run = wake_run(reynolds, setup, heated=True)
    mean = mean_nusselt(run)
    cosines = 1 + np.zeros_like(DEGREES)
    for k, factor in enumerate(nusselt_shape(run, _COSINES), start=1):
        cosines += factor * np.cos(k * np.radians(DEGREES))
    given = jnp.asarray(reynolds), jnp.asarray(PRANDTL)
    return RoundRod(
        reynolds,
        run,
        mean * cosines,
        local_number(DEGREES, reynolds),
        mean,
        # Evenly spaced angles average every cosine to 0.
        float(local_number(np.arange(64) * 360.0 / 64, reynolds).mean()),
        float(churchill_bernstein(*given)),
    )


def square_rod(reynolds: float, cells: int, passes: float) -> SquareRod:
    """Compute the flow around a square rod of so many cells, for so many passes."""
    setup = wake_setup(reynolds, cells, heated=True)
    channel = wake_channel(reynolds, setup, heated=True)
    middle = channel.body.centre
    at = np.indices(channel.shape) + 0.5
    away = [np.abs(at[1 - axis] - middle[axis]) for axis in (0, 1)]
    channel = replace(channel, body=np.maximum(*away) < cells / 2)
    steps = round(passes * channel.shape[1] / float(channel.speed))
    run = simulate_flow(channel, steps, average_from=0.9)
    closed = local_number(np.array(list(FACES.values())), _AS_LARGE * reynolds)
    closed = closed / _AS_LARGE
    return SquareRod(
        reynolds,
        run,
        _faces(run),
        dict(zip(FACES, closed.tolist(), strict=True)),
    )


def _faces(run: FlowRun) -> dict[str, float]:
    """Nusselt numbers of the faces of a square body of whole cells."""
    channel = run.channel
    assert run.link_heat is not None and channel.diffusivity is not None
    links = body_links(channel.body, channel.shape)
    along, across = _hit(np.asarray(links.solid))
    heat = run.link_heat.astype(float)
    # What leaves over an edge belongs to both of its faces.
    edge = np.isclose(np.abs(along), np.abs(across))
    part = np.where(edge, 0.5, 1.0)
    ends = (np.abs(along) > np.abs(across)) | edge
    sides = (np.abs(across) > np.abs(along)) | edge
    sums = {
        "front": (heat * part)[ends & (along < 0)].sum(),
        "each side": (heat * part)[sides].sum() / 2,
        "rear": (heat * part)[ends & (along > 0)].sum(),
    }
    return {name: float(s) / float(channel.diffusivity) for name, s in sums.items()}


def _hit(solid: Bool[np.ndarray, "y x"]) -> tuple[np.ndarray, np.ndarray]:
    """Places where links meet the surface, from the body's middle [cells]."""
    row, column = np.indices(solid.shape)
    ways = np.array(VELOCITIES[1:])[:, :, None, None]
    from_middle = lambda index, size: index - (size - 1) / 2
    return (
        from_middle(column, solid.shape[1]) + ways[:, 0] / 2,
        from_middle(row, solid.shape[0]) + ways[:, 1] / 2,
    )
