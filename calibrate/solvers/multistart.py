"""Several starts: a seeded design, their losses, and searches that step together."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.stats import qmc

from .search import Objective, Search, residuals


def start_points(
    count: int, size: int, spread: float, seed: int
) -> Float[np.ndarray, "n p"]:
    """Start points around 0, which is the first of them.

    Normally distributed by a scrambled Sobol' sequence, which is even for few points.
    """
    if count == 1:
        return np.zeros((1, size))
    sampler = qmc.MultivariateNormalQMC(
        np.zeros(size), spread**2 * np.eye(size), rng=np.random.default_rng(seed)
    )
    # Sobol' points are balanced in powers of 2.
    power = 1 << max(count - 2, 0).bit_length()
    drawn = np.asarray(sampler.random(power))[: count - 1]
    return np.concatenate([np.zeros((1, size)), drawn])


@eqx.filter_jit
def losses(
    objective: Objective, points: Float[Array, "n p"], batch: int
) -> Float[Array, " n"]:
    """Half of the sum of squares at each point; infinite where it is not finite."""

    def loss(z):
        found = 0.5 * (residuals(z, objective)[0] ** 2).sum()
        # A start whose run diverges is left out, not an error.
        return jnp.where(jnp.isfinite(found), found, jnp.inf)

    return jax.lax.map(loss, points, batch_size=max(1, min(batch, len(points))))


class BatchedSearch:
    """Searches from several starts, each advanced by the same compiled step."""

    def __init__(self, search: Search, starts: Float[Array, "n p"], batch: int):
        """Start from each point, stepping `batch` of them at once."""
        states = [search.start(z) for z in starts]
        arrays = [eqx.filter(state, eqx.is_array) for state in states]
        # Programs in the states are the same for all starts.
        static = eqx.filter(states[0], eqx.is_array, inverse=True)
        self.z = starts
        self.done: Bool[np.ndarray, " n"] = np.zeros(len(starts), bool)
        self._states: Any = jax.tree.map(lambda *each: jnp.stack(each), *arrays)

        @eqx.filter_jit
        def advance(z, states, objective):
            def single(given):
                state = eqx.combine(given[1], static)
                z, state, done = search.advance(given[0], state, objective)
                return z, eqx.filter(state, eqx.is_array), done

            return jax.lax.map(single, (z, states), batch_size=batch)

        self._advance = advance

    @property
    def trials(self) -> Float[Array, "n p"]:
        """Points that the next step evaluates."""
        return self._states.y_eval

    def step(self, objective: Objective) -> None:
        """Advance the searches that are not done."""
        z, states, done = self._advance(self.z, self._states, objective)

        # All searches step, finished ones for nothing: shapes cannot depend on values.
        def keep_finished(old, new):
            finished = self.done.reshape((-1,) + (1,) * (new.ndim - 1))
            return jnp.where(finished, old, new)

        pair = (self.z, self._states), (z, states)
        self.z, self._states = jax.tree.map(keep_finished, *pair)
        self.done = self.done | np.asarray(done)
