"""Exact preconditioning of the mean temperature of each component of a body."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...geometry.mesh import connected_labels
from ...network.multigrid_cycle import AbstractCycle
from ...network.network import inverse
from ...structures.structure import AbstractStructure


class Components(eqx.Module):
    """Connected components of a body's nodes."""

    number: Int[Array, "..."] | None
    """Component of every entry of the state; None if there is one component."""
    count: int = eqx.field(static=True)

    def sums(self, values: Float[Array, "*m"]) -> Float[Array, " p"]:
        """Sum the values of each component."""
        if self.number is None:
            return values.sum()[None]
        flat, number = values.reshape(-1), self.number.reshape(-1)
        return jax.ops.segment_sum(flat, number, self.count)

    def spread(self, values: Float[Array, " p"]) -> Float[Array, "*#m"]:
        """Return the value of its component for every entry of the state."""
        # One component broadcasts, which costs no gather.
        return values[0] if self.number is None else values[self.number]


def connected_components(structure: AbstractStructure) -> Components:
    """Find the connected components of a body."""
    links = structure.links()
    pairs = np.stack([links.src, links.dst], axis=1)
    labels = connected_labels(structure.node_count, pairs)
    distinct, component = np.unique(labels, return_inverse=True)
    if len(distinct) == 1:
        return Components(None, 1)
    number = np.zeros(structure.state_shape, np.int32)
    number[structure.node_address()] = component
    return Components(jnp.asarray(number), len(distinct))


class DeflatedPreconditioner(eqx.Module):
    """Preconditioner M, with the mean of each component solved for exactly.

    With s = A 1 [W/K], for each component

        z = 1 c + Q^T M Q r,    c = sum r / sum s,    Q r = r - s c.

    Source: Mandel, Communications in Numerical Methods in Engineering 9 (1993) 233-241.
    """

    cycle: AbstractCycle
    components: Components
    row_sums: Float[Array, "..."]
    """s, of the body by itself [W/K]."""

    def __call__(self, residual: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Return the correction z of a residual r [W] -> [K]."""
        # Where a component loses hardly any heat, as by emission near 0 K in a step of
        # 1e12 s, the balance has next to no curvature along its mean: less than the
        # rounding of a multigrid cycle.
        components, s = self.components, self.row_sums
        inverse_sum = inverse(components.sums(s))
        mean = inverse_sum * components.sums(residual)
        z = self.cycle(residual - s * components.spread(mean))
        return z + components.spread(mean - inverse_sum * components.sums(s * z))
