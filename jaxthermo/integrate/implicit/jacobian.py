"""The derivative of an implicit step's balance, as a symmetric operator.

A stage looks for eta = base + g f(eta), with f of `rates`. Its derivative, in heat
rates for a change u of what drives conduction (of temperature, where k is constant),

    A u = (C / g + s) / d u - K u + contacts,

is symmetric and positive definite: K is the linear network, s the slope of each node's
load [W/K], d = d(phi)/d(eta) of `NonlinearNetwork`, 1 elsewhere. With 1 / g = 0 it is
that of a steady state, which is singular where nothing holds a part.
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


class Jacobian(eqx.Module):
    """A of all bodies."""

    networks: tuple[AbstractNetwork, ...]
    diagonal: State
    """(C / g + s) / d [W/K]."""
    contacts: tuple[ContactLinks, ...]
    time: Float[Array, ""]

    def mv(self, u: State) -> State:
        """A u [W]."""
        image = [
            own * each - network.face_heat_rate(each)
            for own, network, each in zip(self.diagonal, self.networks, u, strict=True)
        ]
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

    def with_contacts(self) -> State:
        """The diagonal with what contacts add to it."""
        found = list(self.diagonal)
        zero = jnp.zeros((), found[0].dtype)
        for contact in self.contacts:
            one = jnp.ones_like(contact.area)
            flow = contact.heat_rate(self.time, (one, 0 * one), (zero, zero))
            for body, address in zip(contact.bodies, contact.address, strict=True):
                found[body] = found[body].at[address].add(flow)
        return tuple(found)


class BlockPreconditioner(eqx.Module):
    """A preconditioner that knows no contact but on the diagonal."""

    cycles: tuple[DeflatedPreconditioner, ...]

    def __call__(self, residual: State) -> State:
        """Of every body."""
        return tuple(c(r) for c, r in zip(self.cycles, residual, strict=True))


class Linearization(NamedTuple):
    """What a step of Newton's method solves with."""

    operator: Jacobian
    preconditioner: Callable[[State], State]
    steepness: tuple[Float[Array, "..."] | None, ...]
    """d of every body; None for 1."""
    capacity: State
    """Of every node [J/K]."""
    nodes: tuple[Bool[Array, "..."] | None, ...]
    """Where each body's state has nodes; None for everywhere."""


def linearize(
    program: Program,
    context: ImplicitContext,
    states: State,
    rate: Float[Array, ""],
    time: Float[Array, ""],
    regularization: Callable[[State], State] | None = None,
) -> Linearization:
    """At given states.

    Args:
        program: of the scene.
        context: for it.
        states: of the bodies.
        rate: one over the stage's step, 0 for a steady state [1/s].
        time: of the loads [s].
        regularization: of the diagonal to what the preconditioner adds to it, since A
            may be singular [W/K].
    """
    slopes = load_slopes(program, states, time).change
    networks = tuple(body.network.linear for body in program.bodies)
    steepness = tuple(map(_steepness, program.bodies, states))
    diagonal = masked_to_nodes(
        tuple(
            _over(network.capacity() * (rate + slope), steep)
            for network, slope, steep in zip(networks, slopes, steepness, strict=True)
        ),
        context.nodes,
    )
    operator = Jacobian(networks, diagonal, program.contacts, time)
    whole = sums = operator.with_contacts()
    if regularization is not None:
        whole = jax.tree.map(jnp.add, whole, regularization(whole))
    parts = zip(networks, context.hierarchies, whole, strict=True)
    plain = tuple(
        jacobi(network, m) if levels is None else levels.cycle(m)
        for network, levels, m in parts
    )
    cycles = tuple(map(DeflatedPreconditioner, plain, context.components, sums))
    capacity = tuple(
        jnp.broadcast_to(network.capacity(), state.shape)
        for network, state in zip(networks, states, strict=True)
    )
    return Linearization(
        operator, BlockPreconditioner(cycles), steepness, capacity, context.nodes
    )


def masked_to_nodes(
    values: State, nodes: tuple[Bool[Array, "..."] | None, ...]
) -> State:
    """Values with 0 where there is no node."""
    masked = lambda v, here: v if here is None else jnp.where(here, v, 0)
    return tuple(map(masked, values, nodes))


def _steepness(body, state) -> Float[Array, "..."] | None:
    network = body.network
    if not isinstance(network, NonlinearNetwork):
        return None
    return jax.jvp(network.potential, (state,), (jnp.ones_like(state),))[1]


def _over(values, steep):
    return values if steep is None else values * inverse(steep)
