"""Coefficients of every place by a speed that changes with time."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..time_varying import value_at


SMALL_SPEED = 1e-6
"""Added under the root [m/s], for its slope at 0."""

Speeds = Float[Array, "*v"] | Float[np.ndarray, "*v"] | float


def speed_root(speed: Speeds) -> Speeds:
    """The fourth root of a speed [m/s], lifted off 0 and less what that adds."""
    return (speed + SMALL_SPEED) ** 0.25 - SMALL_SPEED**0.25


def speed_nodes(highest: Speeds, count: int, dtype: Any) -> Any:
    """Speeds [m/s] from 0 to the highest, even in their fourth root."""
    root = np.linspace(0, 1, count).astype(dtype) * speed_root(highest)
    nodes = (root + SMALL_SPEED**0.25) ** 4 - SMALL_SPEED
    # The first may round to less than 0.
    return nodes * (nodes > 0)


OVERSHOOT = 1.25
"""Most that the cubic between nodes makes of their largest absolute value."""


class SpeedTable(eqx.Module):
    """Values by speed, with a smooth cubic (Catmull and Rom) between the nodes.

    The nodes are even in the fourth root of the speed: a heat transfer coefficient goes
    with its square or more, without a bend at 0.
    """

    table: Float[Any, "v n m"]
    """The nodes', with one more on each side for the slopes at the ends."""
    highest: Any
    """[m/s]; above, the last value holds."""
    speed: Callable
    """Of time [s], [m/s]; below 0 it counts as 0."""

    def __call__(self, time: Float[Array, ""]) -> Float[Array, "n m"]:
        """The values at `time` [s]."""
        inner = self.table.shape[0] - 2
        speed = value_at(self.speed, time)
        speed = jnp.where(speed > 0, speed, 0)
        share = speed_root(speed) / speed_root(jnp.asarray(self.highest, time.dtype))
        place = jnp.clip(share, 0, 1) * (inner - 1)
        first = jnp.clip(jnp.floor(place), 0, inner - 2)
        t = place - first
        weights = [
            t * (t * (2 - t) - 1),
            t * t * (3 * t - 5) + 2,
            t * (t * (4 - 3 * t) + 1),
            t * t * (t - 1),
        ]
        # Row 0 is the node below zero.
        rows = jax.lax.dynamic_slice_in_dim(
            jnp.asarray(self.table), first.astype(jnp.int32), 4
        )
        return jnp.tensordot(jnp.stack(weights) / 2, rows, 1)


def speed_table(
    values: Float[Any, "v n m"], highest: Any, speed: Callable
) -> SpeedTable:
    """From the values at the `speed_nodes`."""
    own = np if isinstance(values, np.ndarray) else jnp
    below, above = 2 * values[0] - values[1], 2 * values[-1] - values[-2]
    table = own.concatenate([below[None], values, above[None]])
    return SpeedTable(table, highest, speed)
