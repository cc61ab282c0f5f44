"""Columns: chains of nodes through a depth, eliminated in every explicit step.

A column is a chain of cells, the outermost first, whose last cell is linked to a node,
its hub; columns may share a hub. Thin cells conduct so well among each other that their
links would make explicit steps short. With the conduction A of the columns alone [1/s],

    R = (I - s A)^-1    and    P = 2 R - R^2 = I - (s A)^2 + ...

turn the rise f of an explicit step, of all conduction and all loads, into R f (Euler)
or P f (RKL2). Since 1^T C A = 0 neither changes the heat of a rise; where f is 0
nothing changes; and the products R A and P A are bounded by 1 / s and 2 / s, however
thin the cells are. R f with s = dt is Euler's method, implicit in the columns and
explicit in all else. P f differs from f in second order, so that RKL2 stays of second
order for any s in proportion to the step.

With capacities C_l [J/K] and conductances G_l [W/K] from cell l to the next, a cell and
all before it act on the next one as a capacity,

    D_0 = C_0,    D_{l+1} = C_{l+1} + D_l s G_l / (D_l + s G_l),

all of it positive: no digit is lost however stiff the links are.

Sources: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.7
(W-methods); Grassmann, Taksar, Heyman, Operations Research 33 (1985) 1107-1116 (an
elimination without subtractions).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Bool, Float, Int

from ..arrays import added, taken


FILTER_TIME = 1.25
"""s of P in stable steps of all else [-]."""

STABLE_FRACTION = 0.9
"""Fraction of the stable step of all else that the columns leave [-].

For A and any symmetric B with rates up to b the rates of P (A + B) are at most the
largest value of (1 + 2 z) / (1 + z)^2 (z / s + b) over z >= 0, since B <= b I. With
s = 1.25 dt and b = 2 * 0.9 / dt that is below 2 / dt, the limit of an Euler step.
"""

_LOADED_FRACTION = 1.68
"""Limit of (b + l) dt with loads on cells, see `Columns.load_rate` [-].

Rates of P (A + B + S), with S the loads, are below 2 / dt where (2 / dt) P^-1 - A - B -
S is positive. With z = s A the convex function 2 P^-1 - 0.8 z = 2 (1 + z)^2 / (1 + 2 z)
- 0.8 z is above its tangent at z = 2, 1.68 + 0.16 z = 1.68 + 0.2 dt A.
"""

_SPREAD = 0.2
"""Fraction of the conduction of columns that spreads loads on their cells [-]."""

_BISECTIONS = 30
"""Halvings of the interval of a rate: to 1e-9 of the loads over the capacity."""


class _Split(NamedTuple):
    """Values of the cells of all columns, and of all other nodes."""

    cells: Float[Array, "m c"]
    others: Float[Array, " n"]


class Columns(Module):
    """Conduction of the columns of a body, whose nodes come first in a state."""

    conductance: Float[Array, "m c"]
    """From each cell to the next one, and from the last to the hub [W/K]."""
    hub: Int[Array, " c"] | None
    """Hub of each column, counted from the first node behind all columns, sorted; None
    where the columns have one each, in their order."""
    node_capacity: Float[Array, " n"]
    """Heat capacity of every node of the body [J/K]."""

    def split(self, state: Float[Array, " n"]) -> _Split:
        """The state of the cells and of the nodes behind them."""
        count = self.conductance.size
        cells = state[:count].reshape(self.conductance.shape)
        return _Split(cells=cells, others=state[count:])

    def at_hubs(self, others: Float[Array, " n"]) -> Float[Array, " c"]:
        """Values of the hub of each column."""
        if self.hub is None:
            return others[: self.conductance.shape[1]]
        return taken(others, self.hub)

    def to_hubs(
        self, others: Float[Array, " n"], values: Float[Array, " c"]
    ) -> Float[Array, " n"]:
        """Values of the nodes behind the columns, with those of columns added."""
        if self.hub is None:
            count = self.conductance.shape[1]
            return others.at[:count].add(values)
        return added(others, self.hub, values, is_sorted=True)

    def scaled(self, ratio: Float[Array, ""]) -> "Columns":
        """Columns that conduct by a ratio better [-]."""
        return Columns(
            conductance=ratio * self.conductance,
            hub=self.hub,
            node_capacity=self.node_capacity,
        )

    def heat_rate(self, state: Float[Array, " n"]) -> Float[Array, " n"]:
        """Conduction of the columns into every node [W]."""
        cells, others = self.split(state)
        inner = jnp.concatenate([cells[1:], self.at_hubs(others)[None]])
        outward = self.conductance * (inner - cells)
        into_cells = outward - jnp.pad(outward[:-1], ((1, 0), (0, 0)))
        into_others = self.to_hubs(jnp.zeros_like(others), -outward[-1])
        return jnp.concatenate([into_cells.reshape(-1), into_others])

    def diagonal(self) -> Float[Array, " n"]:
        """Sum of the conductances of each node in its columns [W/K]."""
        of_cells = self.conductance + jnp.pad(self.conductance[:-1], ((1, 0), (0, 0)))
        others = jnp.zeros_like(self.split(self.node_capacity).others)
        of_others = self.to_hubs(others, self.conductance[-1])
        return jnp.concatenate([of_cells.reshape(-1), of_others])

    def stable_rate(
        self, rate: Float[Array, ""], stiffness: Float[Array, " n"]
    ) -> Float[Array, ""]:
        """1 over the stable step with loads on cells, which the columns spread [1/s].

        The largest sum of conductances outside the columns over the capacity of a node
        is `rate` [1/s], half of b. `stiffness` is a diagonal matrix that is no less
        than what loads add to the balances of the cells [W/K].
        """
        return (2 * rate + self._load_rate(stiffness)) / _LOADED_FRACTION

    def _load_rate(self, stiffness: Float[Array, " n"]) -> Float[Array, ""]:
        """Largest rate l of loads less a fifth of the conduction of columns [1/s].

        The largest eigenvalue of S - 0.2 A: the least l for which elimination of l C -
        S + 0.2 C A has positive pivots only.
        """
        conductance = _SPREAD * self.conductance
        capacity = self.split(self.node_capacity)
        load = self.split(stiffness).cells

        def is_above(rate: Float[Array, ""]) -> Bool[Array, ""]:
            def eliminate(passed, cell):
                heat, link = cell
                total = heat + passed
                pivot = total + link
                return total * link / jnp.where(pivot > 0, pivot, 1), pivot > 0

            cells = rate * capacity.cells - load
            passed, are_positive = jax.lax.scan(
                eliminate, jnp.zeros_like(cells[0]), (cells, conductance)
            )
            hubs = self.to_hubs(rate * capacity.others, passed)
            return are_positive.all() & (hubs >= 0).all()

        def halve(_, bounds):
            low, high = bounds
            middle = (low + high) / 2
            above = is_above(middle)
            return jnp.where(above, low, middle), jnp.where(above, middle, high)

        high = (load / capacity.cells).max()
        bounds = (jnp.zeros_like(high), high)
        return jax.lax.fori_loop(0, _BISECTIONS, halve, bounds)[1]

    def factored(self, span: Float[Array, ""]) -> "ColumnFactors":
        """Factors of I - s A for a span of time s [s]."""
        capacity = self.split(self.node_capacity)

        def eliminate(total, cell):
            conductance, cell_capacity = cell
            total = cell_capacity + total
            pivot = 1 / (total + conductance)
            ratio = conductance * pivot
            return total * ratio, (ratio, pivot)

        passed, (ratio, pivot) = jax.lax.scan(
            eliminate,
            jnp.zeros_like(self.conductance[0]),
            (span * self.conductance, capacity.cells),
        )
        others = self.to_hubs(capacity.others, passed)
        return ColumnFactors(self, ratio=ratio, pivot=pivot, others=others)


class ColumnFactors(Module):
    """Factors of I - s A; both products leave the heat of a rise unchanged."""

    columns: Columns
    ratio: Float[Array, "m c"]
    """Fraction of a cell's heat that goes on to the next [-]."""
    pivot: Float[Array, "m c"]
    """Rise of a cell for its heat where the next one is held [K/J]."""
    others: Float[Array, " n"]
    """Capacity of each node behind the columns, with what its columns add [J/K]."""

    def backward(self, rise: Float[Array, " n"]) -> Float[Array, " n"]:
        """R f, the rise of a step that is implicit in the columns."""
        return self.solved(self.columns.node_capacity * rise)

    def solved(self, heat: Float[Array, " n"]) -> Float[Array, " n"]:
        """Rise x [K] of (C - s C A) x = heat [J]."""
        columns = self.columns
        cells, others = columns.split(heat)

        def inward(passed, cell):
            heat, ratio = cell
            heat = heat + passed
            return ratio * heat, heat

        none = jnp.zeros_like(cells[0])
        passed, heat = jax.lax.scan(inward, none, (cells, self.ratio))
        of_others = columns.to_hubs(others, passed) / self.others

        def outward(inner, cell):
            heat, ratio, pivot = cell
            outer = heat * pivot + ratio * inner
            return outer, outer

        _, of_cells = jax.lax.scan(
            outward,
            columns.at_hubs(of_others),
            (heat, self.ratio, self.pivot),
            reverse=True,
        )
        return jnp.concatenate([of_cells.reshape(-1), of_others])

    def filtered(self, rise: Float[Array, " n"]) -> Float[Array, " n"]:
        """P f, which differs from the rise f in second order of the span of time."""
        once = self.backward(rise)
        return once + self.backward(rise - once)
