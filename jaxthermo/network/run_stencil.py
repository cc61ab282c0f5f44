"""Full volume in runs of voxels along z, conducted by loops that numba compiles.

    C_i dT_i/dt = G sum_j w_ij (T_j - T_i),    C_i = C V_i,

with the conductance G of a whole link and the capacity C of a whole voxel; w_ij and V_i
differ from 1 at the surface alone. `RowNetwork` conducts likewise, with arrays.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import taken
from ..native.runs import Runs, conducted
from .network import AbstractNetwork, Address, listed_or_default, precise_sum
from .self_adjoint_primitive import Operator, computed_once, conduct


def _spread(
    state: Float[Array, " n"], factor: Float[Array, ""], runs: Runs
) -> Float[Array, " n"]:
    change = conducted(state, keep=jnp.zeros_like(factor), ratio=factor, runs=runs)
    return change.at[runs.node].multiply(runs.volume, unique_indices=True)


def _pull(values, state, factor, runs):
    spread = conduct(_RUNS, state=values, factors=jnp.ones_like(factor), layout=runs)
    return (computed_once(spread) * state).sum()


_RUNS = Operator(
    change=_spread, step=_spread, inside=lambda values, _: values, pull=_pull
)


@jax.custom_jvp
def _step(
    state: Float[Array, " n"], ratio: Float[Array, ""], runs: Runs
) -> Float[Array, " n"]:
    return conducted(state, keep=jnp.ones_like(ratio), ratio=ratio, runs=runs)


@_step.defjvp
def _along(primals, tangents):
    # The change times the volumes is conduction, which is its own transpose.
    state, ratio, runs = primals
    along_state, along_ratio, _ = tangents
    change = conduct(_RUNS, state=along_state, factors=ratio, layout=runs)
    change += conduct(_RUNS, state=state, factors=along_ratio, layout=runs)
    change = change.at[runs.node].divide(runs.volume, unique_indices=True)
    return _step(state, ratio, runs), along_state + change


class RunStencil(AbstractNetwork):
    """One material in runs: one conductance, one capacity, and rows at the surface."""

    conductance: Float[Array, ""]
    """Conductance of a whole link, k * pitch [W/K]."""
    whole_capacity: Float[Array, ""]
    """Heat capacity of a whole voxel, rho c_p pitch^3 [J/K]."""
    runs: Runs
    row_weight: Float[Array, " m"]
    """Sum of the relative conductances of each node in a row [-]."""
    node_count: int = eqx.field(static=True)

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        return conduct(_RUNS, state=state, factors=self.conductance, layout=self.runs)

    @override
    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        return _step(state, dt * (self.conductance / self.whole_capacity), self.runs)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        diagonal = jnp.full(self.node_count, 6 * self.conductance)
        row_diagonal = self.conductance * self.row_weight
        return diagonal.at[self.runs.node].set(row_diagonal, unique_indices=True)

    @override
    def capacity(self) -> Float[Array, "..."]:
        capacity = jnp.full(self.node_count, self.whole_capacity)
        row_capacity = self.whole_capacity * self.runs.volume
        return capacity.at[self.runs.node].set(row_capacity, unique_indices=True)

    @override
    def capacity_at(self, address: Address) -> Float[Array, "*m"]:
        return self.whole_capacity * listed_or_default(
            address[0].astype(jnp.int32),
            listed=self.runs.node,
            values=self.runs.volume,
            default=1.0,
        )

    @override
    def max_rate(self) -> Float[Array, ""]:
        inside = 6 if len(self.runs.runs) else 0
        largest_weight = jnp.maximum((self.row_weight / self.runs.volume).max(), inside)
        return largest_weight * self.conductance / self.whole_capacity

    @override
    def total_capacity(self) -> Float[Array, ""]:
        row_excess = precise_sum(self.runs.volume - 1)
        return self.whole_capacity * (self.node_count + row_excess)

    @override
    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        row_state = taken(state, self.runs.node)
        excess = precise_sum((self.runs.volume - 1) * row_state)
        return self.whole_capacity * (precise_sum(state) + excess)
