"""Rates that limit the explicit steps of a scene, by group of bodies."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int

from ...arrays import namespace
from ...network.columns import STABLE_FRACTION


class StableRates(Module):
    """Largest explicit rates of the groups of a scene [1/s]."""

    at_nodes: Float[Array, " g"]
    """Largest sum of conductances outside columns over the capacity of a node."""
    with_columns: Float[Array, " g"]
    """The same with loads on the cells of columns spread by these."""
    has_columns: tuple[bool, ...] = eqx.field(static=True)
    """True for each group with columns."""
    stiffest: Int[Array, " g"]
    """Number in the scene of the body whose node has the largest rate."""

    def step(self, groups: tuple[int, ...]) -> Float[Any, ""]:
        """Largest stable explicit step of some groups [s]; infinite without a limit."""
        # Up to this step every node's weight in its own next temperature is positive,
        # so that temperatures stay within their bounds; or, if that is longer, columns
        # spread what loads on their thin cells add.
        xp = namespace(self)
        index = np.array(groups)
        largest = xp.asarray(self.at_nodes)[index].max()
        if any(self.has_columns[group] for group in groups):
            with_columns = xp.asarray(self.with_columns)[index].max()
            largest = xp.minimum(largest / STABLE_FRACTION, with_columns)
        return xp.where(largest > 0, 1 / xp.where(largest > 0, largest, 1), xp.inf)

    @property
    def stiffest_body(self) -> Int[Any, ""]:
        """Number in the scene of the body that limits the stable step."""
        xp = namespace(self)
        steps = [self.step((group,)) for group in range(len(self.has_columns))]
        return xp.asarray(self.stiffest)[xp.stack(steps).argmin()]


def largest_rates(rates: Sequence[StableRates]) -> StableRates:
    """Largest rates of the snapshots of a scene."""
    if len(rates) == 1:
        return rates[0]
    rows = jax.tree.map(lambda *values: jnp.stack(values), *rates)
    stiffest = jnp.take_along_axis(rows.stiffest, rows.at_nodes.argmax(0)[None], axis=0)
    return StableRates(
        at_nodes=rows.at_nodes.max(axis=0),
        with_columns=rows.with_columns.max(axis=0),
        has_columns=rows.has_columns,
        stiffest=stiffest[0],
    )
