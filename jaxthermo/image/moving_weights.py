"""Weights of fragments in pixels whose surface points move a little."""

import equinox as eqx
import jax
from jaxtyping import Array, Float, Int


class MovingWeights(eqx.Module):
    """Weights of the fragments at p points, linear in how far each point moves.

        w(u) = w + u_1 dw/du_1 + u_2 dw/du_2,

    with the distances u along two directions of the surface [m].
    """

    row: Int[Array, " n"]
    """Index of the point of each weight, ascending."""
    fragment: Int[Array, " n"]
    weight: Float[Array, " n"]
    slope: Float[Array, "2 n"]
    """Change of the weight along both directions [1/m]."""
    shift: Float[Array, "p 2"]
    """Distances u that the points have moved [m]."""

    def means(self, values: Float[Array, "s k"]) -> Float[Array, "p k"]:
        """Weighted means of the fragments' values at each point."""
        moved = (self.shift[self.row] * self.slope.T).sum(axis=1)
        contributions = (self.weight + moved)[:, None] * values[self.fragment]
        count = len(self.shift)
        return jax.ops.segment_sum(
            contributions, self.row, count, indices_are_sorted=True
        )
