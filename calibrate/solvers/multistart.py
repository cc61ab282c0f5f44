"""Several searches that go on together, each by the same compiled step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .linearization import Program
from .search import Search


class Several(NamedTuple):
    """Where they stand."""

    advance: Callable[[Any, Any, Any], Any]
    z: Float[Array, "n p"]
    states: Any
    """Of the solver, arrays only, stacked."""
    done: Bool[np.ndarray, " n"]

    def tried(self) -> Float[Array, "n p"]:
        """The values that the next step will run with."""
        return self.states.y_eval

    def step(self, program: Program) -> "Several":
        """One step of all that are not done; those stay as they are."""
        arrays = eqx.filter(program, eqx.is_array)
        z, states, done = self.advance(self.z, self.states, arrays)
        stays = lambda old, new: jnp.where(
            self.done.reshape((-1,) + (1,) * (new.ndim - 1)), old, new
        )
        moved = jax.tree.map(stays, (self.z, self.states), (z, states))
        return self._replace(
            z=moved[0], states=moved[1], done=self.done | np.asarray(done)
        )


def searched_together(
    search: Search, starts: Float[Array, "n p"], batch: int
) -> Several:
    """One search from several starts.

    Args:
        search: by one method.
        starts: values of each.
        batch: how many of them the memory holds at once.
    """
    points = [search.begin(z) for z in starts]
    _, static = eqx.partition(points[0].state, eqx.is_array)

    @eqx.filter_jit
    def step(z, states, arrays):
        def one(given):
            whole = eqx.combine(given[1], static)
            z, state, done, _ = search.take(given[0], whole, arrays)
            return z, eqx.filter(state, eqx.is_array), done

        return jax.lax.map(one, (z, states), batch_size=batch)

    states = [eqx.filter(point.state, eqx.is_array) for point in points]
    stacked = jax.tree.map(lambda *each: jnp.stack(each), *states)
    return Several(step, starts, stacked, np.zeros(len(points), bool))
