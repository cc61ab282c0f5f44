"""Preconditioner of a network with columns: a cycle between two solves of these.

Thin cells conduct so well in a column that no sweep over single nodes removes what
differs within it. With L = diag(m + 2 D) - K_c, of the conduction K_c of the columns
and the sums D of all other conductances, and a cycle M,

    z_1 = L^-1 r,    z_2 = z_1 + M (r - A z_1),    z = z_2 + L^-1 (r - A z_2).

A = diag(m) - K <= L, since links outside the columns add at most 2 D, so that both
solves reduce every error, and the map is symmetric. Without links between the cells, as
in a skin, the solves are exact but for the nodes behind them.
"""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import override

from .columns import ColumnFactors, Columns
from .multigrid_cycle import AbstractCycle
from .network import AbstractNetwork


class _ColumnCycle(AbstractCycle):
    """A cycle for (diag(m) - K)^-1, with the columns solved before and after it."""

    network: AbstractNetwork
    m: Float[Array, " n"]
    """[W/K]"""
    factors: ColumnFactors
    """Factors of L."""
    cycle: AbstractCycle

    def _residual(
        self, r: Float[Array, " n"], z: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        return r - (self.m * z - self.network.heat_rate(z))

    @override
    def __call__(self, r: Float[Array, "..."]) -> Float[Array, "..."]:
        z = self.factors.solved(r)
        z = z + self.cycle(self._residual(r, z))
        return z + self.factors.solved(self._residual(r, z))


def column_cycle(
    network: AbstractNetwork,
    columns: Columns,
    m: Float[Array, " n"],
    cycle: AbstractCycle,
) -> _ColumnCycle:
    """Wrap a cycle of a network with columns, for m [W/K]."""
    diagonal = m + 2 * network.explicit_diagonal()
    factors = replace(columns, node_capacity=diagonal).factored(jnp.ones((), m.dtype))
    return _ColumnCycle(network=network, m=m, factors=factors, cycle=cycle)
