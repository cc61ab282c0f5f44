"""The means of the connected parts of a body, which preconditioners solve for apart.

Where hardly anything holds a part, as emission near 0 K over a step of 1e12 s, the
balance has next to no curvature along it: less than what a cycle rounds to.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...geometry.connectivity import connected_labels
from ...network.multigrid_cycle import AbstractCycle
from ...network.network import inverse
from ...structures.structure import AbstractStructure


class Components(eqx.Module):
    """Which nodes of a body hang together."""

    number: Int[Array, "..."] | None
    """The part of every value of a state; None if there is one."""
    count: int = eqx.field(static=True)

    def sums(self, values: Float[Array, "*m"]) -> Float[Array, " p"]:
        """Of each part."""
        if self.number is None:
            return values.sum()[None]
        flat, number = values.reshape(-1), self.number.reshape(-1)
        return jax.ops.segment_sum(flat, number, self.count)

    def spread(self, each: Float[Array, " p"]) -> Float[Array, "*#m"]:
        """What each part has, at its nodes."""
        return each[0] if self.number is None else each[self.number]


def connected_components(structure: AbstractStructure) -> Components:
    """The connected parts of a body.

    Args:
        structure: of the body.
    """
    links = structure.links()
    pairs = np.stack([links.src, links.dst], axis=1)
    roots = connected_labels(structure.node_count, pairs)
    found, own = np.unique(roots, return_inverse=True)
    if len(found) == 1:
        return Components(None, 1)
    number = np.zeros(structure.state_shape, np.int32)
    number[structure.node_address()] = own
    return Components(jnp.asarray(number), len(found))


class DeflatedPreconditioner(eqx.Module):
    """A preconditioner M that solves for the means of the parts by themselves.

    With s = A 1 [W/K], of each part

        z = 1 c + Q^T M Q r,    c = sum r / sum s,    Q r = r - s c.

    Source: Mandel, Communications in Numerical Methods in Engineering 9 (1993) 233-241.
    """

    cycle: AbstractCycle
    parts: Components
    diagonal: Float[Array, "..."]
    """s, of the body by itself."""

    def __call__(self, residual: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Z [K]."""
        parts, s = self.parts, self.diagonal
        share = inverse(parts.sums(s))
        mean = share * parts.sums(residual)
        z = self.cycle(residual - s * parts.spread(mean))
        return z + parts.spread(mean - share * parts.sums(s * z))
