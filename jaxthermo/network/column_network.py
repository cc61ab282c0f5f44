"""Network of a body with columns: their links apart from those of all else."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int
from typing_extensions import override

from .columns import Columns
from .network import AbstractNetwork, AbstractNodeNetwork


class ColumnNetwork(AbstractNodeNetwork):
    """Columns, and the links of all else; equal to all links in one `RowNetwork`."""

    others: AbstractNetwork
    """Links outside the columns. Its nodes are the last ones of the body: all of them,
    or only those behind the columns where cells have no other links."""
    conductance: Float[Array, "m c"]
    """See `Columns`."""
    hub: Int[Array, " c"] | None
    """See `Columns`."""
    node_capacity: Float[Array, " n"]
    by_link: Float[Array, " e"]
    """Conductance of every link, in the order of the structure [W/K]."""

    @property
    @override
    def columns(self) -> Columns:
        return Columns(
            conductance=self.conductance,
            hub=self.hub,
            node_capacity=self.node_capacity,
        )

    def _behind(self, values: Float[Array, " k"]) -> Float[Array, " n"]:
        """Values of the last nodes, and zeros before them."""
        before = self.node_capacity.shape[0] - values.shape[0]
        return jnp.pad(values, (before, 0))

    @override
    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        count = self.others.capacity().shape[0]
        inside = self.others.heat_rate(state[state.shape[0] - count :])
        return self.columns.heat_rate(state) + self._behind(inside)

    @override
    def diagonal(self) -> Float[Array, "..."]:
        return self.columns.diagonal() + self.explicit_diagonal()

    @override
    def explicit_diagonal(self) -> Float[Array, "..."]:
        return self._behind(self.others.diagonal())

    @override
    def max_rate(self) -> Float[Array, ""]:
        return self.others.max_rate()
