"""Multigrid of any network: what an implicit step or a steady state preconditions with.

Made in two steps: the levels, which depend on the conductances alone, once; and for
every diagonal m (another time step, another air) the cycle, which is cheap.
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


MOST_AT_ONCE = 256
"""Values of a state that are solved at once, on the coarsest level."""


class Hierarchy(eqx.Module):
    """A network and ever coarser ones of the same body."""

    networks: tuple[AbstractNetwork, ...]
    """From fine to coarse."""
    transfers: tuple[AbstractTransfer, ...]
    """From each to the next."""

    def prepared(self, m: Float[Array, "..."]) -> MultigridCycle:
        """The cycle that approximates (diag(m) - K)^-1.

        Args:
            m: a state, 0 or more; 0 where there is no node [W/K].
        """
        levels = []
        fine = zip(self.networks[:-1], self.transfers, strict=True)
        for network, transfer in fine:
            levels.append(level(network, m))
            m = transfer.total(m)
        last = self.networks[-1]
        # More nodes are left only where no two of them are linked.
        few = m.size <= MOST_AT_ONCE
        solve = dense_solve(last, m) if few else jacobi(last, m)
        return MultigridCycle(tuple(levels), self.transfers, solve)


def jacobi(network: AbstractNetwork, m: Float[Array, "..."]) -> JacobiCycle:
    """The inverse of the diagonal of diag(m) - K.

    Args:
        network: K.
        m: a state, 0 or more [W/K].
    """
    return JacobiCycle(inverse(m + network.diagonal()))


def hierarchy(structure: AbstractStructure, network: AbstractNetwork) -> Hierarchy:
    """The levels of a body.

    Conductances may be traced. Of a network that varies with temperature, K is as at
    the reference.

    Args:
        structure: of the body.
        network: made of it.
    """
    network = network.linear
    if isinstance(network, AbstractNodeNetwork):
        layout = node_layout(structure, MOST_AT_ONCE)
        return Hierarchy(*_node_levels(layout, network))
    return Hierarchy(*_lattice_levels(network, MOST_AT_ONCE))


# One small program each, instead of hundreds of single operations to compile.
_node_levels = eqx.filter_jit(node_levels)
_lattice_levels = eqx.filter_jit(lattice_levels)
