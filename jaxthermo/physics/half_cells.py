"""Conduction between nodes and the surface where k depends on temperature.

Between a node of temperature T and its surface of temperature T_s flow

    q = G (F(T_s) - F(T)),    F(T) = integral of k / k(reference) dT    [W],

G the conductance at the reference [W/K]: exact for steady conduction in the half cell,
however steep k is.

Source: Carslaw and Jaeger, Conduction of Heat in Solids (1959), section 1.6.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from equinox import Module
from jaxtyping import Array, Float

from ..network.group_order import GroupOrder, apart, together
from ..network.network import AbstractNetwork
from .flux_law import PerCell


Rates = dict[int, PerCell]
"""Values of the terms of each mechanism, by its number."""


class Extremes(NamedTuple):
    """Extremes of k(T) / k(reference) of a body [-]."""

    lowest: Float[Array, ""]
    highest: Float[Array, ""]


class Solved(NamedTuple):
    """Solution of the balance; the heat rates agree with each other to rounding."""

    excess: PerCell
    """Temperature of each surface above its node's [K]."""
    rates: Rates
    """Heat rate of each natural term that is not imposed [W]."""
    conducted: PerCell
    """Heat rate from each surface to its node [W]."""


class Linearized(NamedTuple):
    """The balance near an excess, where conductivities vary."""

    missing: PerCell
    """Heat rate that the node takes beyond that of all terms [W]."""
    slope: PerCell
    """Its slope [W/K]."""
    rates: Rates
    """Heat rates of the nonlinear laws [W]."""
    slopes: Rates
    """Their slopes [W/K]."""
    conducted: PerCell
    """Heat rate from the surface to its node [W]."""
    conductance: PerCell
    """Its slope [W/K]."""


class VaryingHalfCells(Module):
    """k(T) / k(reference) of surface cells, of one body after the other."""

    networks: tuple[AbstractNetwork, ...]
    fractions: tuple[Float[Array, "q _"] | None, ...]
    """Fractions of k at the reference by material and axis, for each body."""
    counts: tuple[int, ...] = eqx.field(static=True)
    """Number of cells of each body."""
    order: GroupOrder | None = None
    """Order of the cells, where it is not that of the bodies."""

    def at(self, theta: PerCell) -> PerCell:
        """Values at temperatures above the references [-]."""
        bodies = zip(self.networks, self._apart(theta), self.fractions, strict=True)
        return self._joined(
            [
                network.relative_conductivity(body_theta, fractions)
                for network, body_theta, fractions in bodies
            ]
        )

    def mean(self, first: PerCell, second: PerCell) -> PerCell:
        """Means between two temperatures above the references [-]."""
        bodies = zip(
            self.networks,
            self._apart(first),
            self._apart(second),
            self.fractions,
            strict=True,
        )
        return self._joined(
            [
                network.mean_relative_conductivity(body_first, body_second, fractions)
                for network, body_first, body_second, fractions in bodies
            ]
        )

    def _apart(self, values: PerCell) -> list[Float[Array, " _"]]:
        return apart(values, self.counts, self.order)

    def _joined(self, values: Sequence[Float[Array, "..."]]) -> PerCell:
        pairs = zip(values, self.counts, strict=True)
        return together([jnp.broadcast_to(v, (n,)) for v, n in pairs], self.order)


def varying_half_cells(
    networks: Sequence[AbstractNetwork],
    fractions: Sequence[Float[Array, "q _"] | None],
    counts: Sequence[int],
    order: GroupOrder | None = None,
) -> VaryingHalfCells | None:
    """Return the conduction of the cells of some bodies; None where k is constant."""
    if not any(network.conductivity_varies for network in networks):
        return None
    return VaryingHalfCells(
        networks=tuple(networks),
        fractions=tuple(fractions),
        counts=tuple(counts),
        order=order,
    )
