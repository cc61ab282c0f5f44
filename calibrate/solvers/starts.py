"""Several starts from a seeded design, and what the misfits are there."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from .linearization import Program, residuals


def design(count: int, size: int, spread: float, seed: int) -> Float[np.ndarray, "n p"]:
    """Points about the start, which is the first of them.

    Normally distributed by a scrambled Sobol' sequence: even for few points.

    Args:
        count: of points.
        size: of a point.
        spread: standard deviation, in free numbers.
        seed: of the scrambling.
    """
    if count == 1:
        return np.zeros((1, size))
    sampler = qmc.MultivariateNormalQMC(
        np.zeros(size), spread**2 * np.eye(size), rng=np.random.default_rng(seed)
    )
    # Sobol' points are balanced by powers of 2.
    power = 1 << max(count - 2, 0).bit_length()
    drawn = np.asarray(sampler.random(power))[: count - 1]
    return np.concatenate([np.zeros((1, size)), drawn])


def losses(
    program: Program, points: Float[Array, "n p"], at_once: int
) -> Float[Array, " n"]:
    """Half of the sum of squares at every point; infinite where it is not finite.

    Args:
        program: of the fit.
        points: to try.
        at_once: how many runs the memory holds.
    """

    def one(z):
        found = 0.5 * (residuals(program, z)[0] ** 2).sum()
        return jnp.where(jnp.isfinite(found), found, jnp.inf)

    return jax.lax.map(one, points, batch_size=max(1, min(at_once, len(points))))
