"""The Jacobian of an implicit stage as a symmetric operator, with its preconditioner.

A stage solves eta = base + g f(eta), f from `evaluate_rates`. Its Jacobian, as heat
rates for a change u of the conduction potential (of temperature, where k is constant),

    A u = (C / g + s) / d u - K u + contacts,

is symmetric and positive definite: K is the linear network, s the slope of each node's
load [W/K], d = d(phi)/d(eta) of `NonlinearNetwork`, 1 elsewhere. With 1 / g = 0 it is
that of a steady state, which is singular for a part that loses no heat.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...network.multigrid import jacobi
from ...network.network import AbstractNetwork, inverse
from ...network.nonlinear import NonlinearNetwork
from ...physics.contact.links import ContactLinks
from ...scene.compile.program import Program, State
from .context import ImplicitContext
from .deflation import DeflatedPreconditioner
from .residual import load_slopes


class _Jacobian(eqx.Module):
    """The operator A of all bodies."""

    networks: tuple[AbstractNetwork, ...]
    diagonal: State
    """(C / g + s) / d [W/K]."""
    contacts: tuple[ContactLinks, ...]
    time: Float[Array, ""]

    def mv(self, u: State) -> State:
        """Return A u [W]."""
        image = [
            d * v - network.face_heat_rate(v)
            for d, network, v in zip(self.diagonal, self.networks, u, strict=True)
        ]
        # References are 0, since u is a difference of temperatures.
        zero = jnp.zeros((), u[0].dtype)
        for contact in self.contacts:
            first, second = (
                u[body].at[address].get(mode="promise_in_bounds")
                for body, address in zip(contact.bodies, contact.address, strict=True)
            )
            flow = contact.heat_rate(self.time, (first, second), (zero, zero))
            for side, sign in ((0, 1), (1, -1)):
                body, address = contact.bodies[side], contact.address[side]
                image[body] = image[body].at[address].add(sign * flow)
        return tuple(image)

    def diagonal_with_contacts(self) -> State:
        """Return the diagonal, contacts included [W/K]."""
        found = list(self.diagonal)
        zero = jnp.zeros((), found[0].dtype)
        for contact in self.contacts:
            one = jnp.ones_like(contact.area)
            flow = contact.heat_rate(self.time, (one, 0 * one), (zero, zero))
            for body, address in zip(contact.bodies, contact.address, strict=True):
                found[body] = found[body].at[address].add(flow)
        return tuple(found)


class _BlockPreconditioner(eqx.Module):
    """Preconditioner of each body by itself, contacts on the diagonal only."""

    blocks: tuple[DeflatedPreconditioner, ...]

    def __call__(self, residual: State) -> State:
        """Return the correction of every body."""
        return tuple(m(r) for m, r in zip(self.blocks, residual, strict=True))


class Linearization(NamedTuple):
    """Everything that one Newton iteration solves with."""

    operator: _Jacobian
    preconditioner: Callable[[State], State]
    potential_slopes: tuple[Float[Array, "..."] | None, ...]
    """d of every body; None for 1."""
    capacity: State
    """Capacity of every node [J/K]."""
    nodes: tuple[Bool[Array, "..."] | None, ...]
    """Entries of each body's state that are nodes; None for all."""


def linearize(
    program: Program,
    context: ImplicitContext,
    states: State,
    rate: Float[Array, ""],
    time: Float[Array, ""],
    regularization: Callable[[State], State] | None = None,
) -> Linearization:
    """Linearize the balance of a stage of rate 1 / g [1/s], 0 for a steady state.

    `regularization` returns what the preconditioner adds to the diagonal where A may be
    singular [W/K].
    """
    slopes = load_slopes(program, states, time).change
    networks = tuple(body.network.linear for body in program.bodies)
    potential = tuple(map(_potential_slope, program.bodies, states))
    diagonal = masked_to_nodes(
        tuple(
            _over(network.capacity() * (rate + slope), d)
            for network, slope, d in zip(networks, slopes, potential, strict=True)
        ),
        context.nodes,
    )
    # Divided by d, the unknown is the potential, whose conduction is linear and
    # symmetric also where the conductivity depends on temperature.
    operator = _Jacobian(networks, diagonal, program.contacts, time)
    # Cycles know no links between bodies: contacts enter by their diagonal only.
    whole = row_sums = operator.diagonal_with_contacts()
    if regularization is not None:
        whole = jax.tree.map(jnp.add, whole, regularization(whole))
    parts = zip(networks, context.hierarchies, whole, strict=True)
    cycles = tuple(
        jacobi(network, m) if levels is None else levels.cycle(m)
        for network, levels, m in parts
    )
    blocks = tuple(map(DeflatedPreconditioner, cycles, context.components, row_sums))
    capacity = tuple(
        jnp.broadcast_to(network.capacity(), state.shape)
        for network, state in zip(networks, states, strict=True)
    )
    return Linearization(
        operator, _BlockPreconditioner(blocks), potential, capacity, context.nodes
    )


def masked_to_nodes(
    values: State, nodes: tuple[Bool[Array, "..."] | None, ...]
) -> State:
    """Return values with 0 where there is no node."""
    masked = lambda v, is_node: v if is_node is None else jnp.where(is_node, v, 0)
    return tuple(map(masked, values, nodes))


def _potential_slope(body, state) -> Float[Array, "..."] | None:
    network = body.network
    if not isinstance(network, NonlinearNetwork):
        return None
    return jax.jvp(network.potential, (state,), (jnp.ones_like(state),))[1]


def _over(values, slope):
    return values if slope is None else values * inverse(slope)
