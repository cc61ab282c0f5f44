"""Multigrid preconditioner of any network, for implicit steps and steady states.

It is built in two steps: once the levels, which depend on the conductances alone; and
for every diagonal m (another time step, another air) the cycle, which is cheap.
"""

import equinox as eqx
from jaxtyping import Array, Float

from ..structures.structure import AbstractStructure
from .multigrid_cycle import (
    AbstractTransfer,
    JacobiCycle,
    MultigridCycle,
    dense_solve,
    level,
)
from .multigrid_lattice import lattice_levels
from .multigrid_nodes import node_layout, node_levels
from .network import AbstractNetwork, AbstractNodeNetwork, inverse


MAX_DENSE_SIZE = 256
"""Largest number of values of a state that is solved directly."""


class Hierarchy(eqx.Module):
    """Network and successively coarser ones of the same body."""

    networks: tuple[AbstractNetwork, ...]
    """Networks from fine to coarse."""
    transfers: tuple[AbstractTransfer, ...]
    """Transfers from each network to the next."""

    def cycle(self, m: Float[Array, "..."]) -> MultigridCycle:
        """Cycle that approximates (diag(m) - K)^-1; m [W/K] is 0 without a node."""
        levels = []
        fine = zip(self.networks[:-1], self.transfers, strict=True)
        for network, transfer in fine:
            levels.append(level(network, m))
            m = transfer.restrict(m)
        last = self.networks[-1]
        # The coarsest level is larger only if none of its nodes are linked.
        few = m.size <= MAX_DENSE_SIZE
        solve = dense_solve(last, m) if few else jacobi(last, m)
        return MultigridCycle(tuple(levels), self.transfers, solve)


def jacobi(network: AbstractNetwork, m: Float[Array, "..."]) -> JacobiCycle:
    """Inverse of the diagonal of diag(m) - K, with m [W/K] 0 or more."""
    return JacobiCycle(inverse(m + network.diagonal()))


def hierarchy(structure: AbstractStructure, network: AbstractNetwork) -> Hierarchy:
    """Levels of a body, from its structure and the network K of this structure.

    Conductances may be traced. If they depend on the temperature, K is taken at the
    reference.
    """
    network = network.linear
    if isinstance(network, AbstractNodeNetwork):
        layout = node_layout(structure, MAX_DENSE_SIZE)
        return Hierarchy(*_node_levels(layout, network))
    return Hierarchy(*_lattice_levels(network, MAX_DENSE_SIZE))


# One small program each, instead of hundreds of single operations to compile.
_node_levels = eqx.filter_jit(node_levels)
_lattice_levels = eqx.filter_jit(lattice_levels)
