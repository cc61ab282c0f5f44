"""Conduction where k and c_p depend on temperature, on any network of one material.

Kirchhoff's transform: with phi = integral of k / k_0 dT from the reference, the flux
between two nodes is k_0 A / L (phi_j - phi_i), exactly: the linear network at the
reference, applied to phi. Enthalpy: with eta = integral of c / c_0 dT,

    C_0 d eta_i / dt = sum_j G_0 (phi_j - phi_i),

so that the heat stored is sum C_0 eta to rounding, however steep c is: a peak that
stands for a latent heat cannot be stepped over. The state is eta [K].

Source: Carslaw and Jaeger, Conduction of Heat in Solids, 1.6; the enthalpy method,
Eyres et al., Phil. Trans. R. Soc. A 240 (1946) 1-57.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .kirchhoff_transform import Primitive
from .network import AbstractNetwork, inverse


ROWS = 4
"""That a state without rows of its own is taken in."""


def _apart(
    function: Callable[[Array], Array], state: Float[Array, "*m"]
) -> Float[Array, "*m"]:
    """A function of every node, in a loop that makes it an array.

    Written out, XLA would compute it anew for every neighbour that reads it.
    """
    if state.ndim > 1:
        return jax.lax.map(function, state)
    padded = jnp.pad(state, (0, -len(state) % ROWS))
    return jax.lax.map(function, padded.reshape(ROWS, -1)).reshape(-1)[: len(state)]


class NonlinearNetwork(AbstractNetwork):
    """A linear network at the reference, with the integrals of what varies."""

    base: AbstractNetwork
    """With k and c_p as they are at the reference."""
    heat: Primitive | None
    """Of c_p; None where it does not vary, and the state is the temperature."""
    conduction: Primitive | None
    """Of k; None where it does not vary."""

    @property
    def linear(self) -> AbstractNetwork:
        """The network at the reference, which conducts phi."""
        return self.base

    @property
    def symmetric(self) -> bool:
        """As the network at the reference is."""
        return self.base.symmetric

    def temperature(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Above the reference [K], of a state or of any part of one."""
        return state if self.heat is None else self.heat.inverse(state)

    def state_of(self, theta: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """The state of nodes at temperatures above the reference [K]."""
        return theta if self.heat is None else self.heat(theta)

    def heat_rate(self, state: Float[Array, "..."]) -> Float[Array, "..."]:
        """Conduction into each node [W]."""
        return self.base.heat_rate(_apart(self.potential, state))

    def potential(self, state: Float[Array, "*m"]) -> Float[Array, "*m"]:
        """Phi, what drives conduction at the reference [K]."""
        theta = self.temperature(state)
        return theta if self.conduction is None else self.conduction(theta)

    def euler_step(
        self, state: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """Eta + dt / C_0 * (conduction into each node)."""
        return state + dt * inverse(self.base.capacity()) * self.heat_rate(state)

    def relative_conductivity(self, theta: Float[Array, "*m"]) -> Float[Array, "*#m"]:
        """k(T) / k_0 at temperatures above the reference [-]."""
        if self.conduction is None:
            return jnp.ones((), theta.dtype)
        return self.conduction.slope(theta)

    def largest_relative_conductivity(self) -> Float[Array, ""]:
        """At any temperature [-]."""
        one = jnp.ones((), self.total_capacity().dtype)
        return one if self.conduction is None else self.conduction.largest()

    def least_relative_capacity(self) -> Float[Array, ""]:
        """At any temperature [-]."""
        one = jnp.ones((), self.total_capacity().dtype)
        return one if self.heat is None else self.heat.least()

    def largest_relative_diffusivity(self) -> Float[Array, ""]:
        """The largest k / c_p of its table over that at the reference [-].

        Between two knots it is the ratio of two lines, so it is largest at a knot.
        """
        parts = [p for p in (self.heat, self.conduction) if p is not None]
        ratio = jnp.ones((), self.total_capacity().dtype)
        if not parts:
            return ratio
        knots = jnp.concatenate([part.knot for part in parts])
        if self.conduction is not None:
            ratio = self.conduction.slope(knots)
        if self.heat is not None:
            ratio = ratio / self.heat.slope(knots)
        return ratio.max()

    def diagonal(self) -> Float[Array, "..."]:
        """Sum of the conductances of each node at the reference [W/K]."""
        return self.base.diagonal()

    def capacity(self) -> Float[Array, "..."]:
        """Of each node at the reference, C_0 [J/K]."""
        return self.base.capacity()

    def largest_rate(self) -> Float[Array, ""]:
        """Over all nodes, at the temperature of the largest k / c_p [1/s]."""
        return self.base.largest_rate() * self.largest_relative_diffusivity()

    def total_capacity(self) -> Float[Array, ""]:
        """Of the body at the reference [J/K]."""
        return self.base.total_capacity()

    def stored(self, state: Float[Array, "..."]) -> Float[Array, ""]:
        """Heat above the reference temperature, sum of C_0 eta [J]."""
        return self.base.stored(state)
