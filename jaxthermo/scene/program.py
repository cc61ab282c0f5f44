"""A compiled scene: all that the solver needs, and nothing else."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..network.network import AbstractNetwork, Address
from ..physics.balance import SurfaceTerms
from ..structures.surface_map import BoundMap
from .receipt import Receipt
from .surface import SolvedSurface


State = tuple[Float[Array, "..."], ...]
"""Temperature above the reference at every node, one array a body [K]."""


class SurfaceLoad(eqx.Module):
    """What acts on a body's surface in the time loop.

    Fragments of one node on which the same terms act are one place; a fragment on which
    nothing acts has none. Places are summed by gathering, and every node is then
    written once, which is several times faster than adding to it in turn.
    """

    address: Address
    """Of the nodes that have such places, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Of those nodes [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Of each place, its node among them."""
    slots: tuple[Int[Array, " m"], ...]
    """Of each node, its k-th place; one past the last where it has fewer."""
    terms: SurfaceTerms
    """On the places."""

    def _by_node(self, values: Float[Array, " p"]) -> Float[Array, " m"]:
        padded = jnp.append(values, jnp.zeros(1, values.dtype))
        gather = lambda slot: padded.at[slot].get(mode="promise_in_bounds")
        return sum((gather(slot) for slot in self.slots[1:]), gather(self.slots[0]))

    def warm(
        self,
        new: Float[Array, "..."],
        theta: Float[Array, "..."],
        time: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> tuple[Float[Array, "..."], Float[Array, " c"]]:
        """`new` with the heat of one step from `theta`, and each mechanism's rate [W].

        The state stays three-dimensional here: flattening it for the scatter would make
        XLA compute the whole stencil with flat indices, slowly.
        """
        nodes = theta.at[self.address].get(mode="promise_in_bounds")
        here = nodes.at[self.node].get(mode="promise_in_bounds")
        heat, by_mechanism = self.terms.heat(time, here)
        rise = dt * self._by_node(heat) / self.capacity
        warmed = new.at[self.address].add(
            rise,
            mode="promise_in_bounds",
            indices_are_sorted=True,
            unique_indices=True,
        )
        return warmed, by_mechanism

    def stiffness(self, hottest: Float[Array, ""], end: float) -> Float[Array, " m"]:
        """What it adds to each node's conductances in the stable step [W/K]."""
        return self._by_node(self.terms.stiffness(hottest, end))


class SurfaceReading(eqx.Module):
    """How the temperature of every fragment is read."""

    address: Address
    """Of the nodes that have surface, each once, in the order of the state."""
    node: Int[Array, " s"]
    """Of each fragment, its node among them."""
    terms: SurfaceTerms
    """On the fragments."""
    surface_map: BoundMap

    def read(
        self, theta: Float[Array, "..."], time: Float[Array, ""] | None
    ) -> Float[Array, " s"]:
        """Of every fragment above the reference [K].

        Args:
            theta: the state.
            time: of the loads [s]; None where none has acted yet.
        """
        nodes = theta.at[self.address].get(mode="promise_in_bounds")
        below = nodes.at[self.node].get(mode="promise_in_bounds")
        excess = None
        if self.surface_map.needs_excess and time is not None:
            excess = self.terms.surface_excess(time, below)
        return self.surface_map.read(theta, nodes, below, self.node, excess)


class BodyProgram(eqx.Module):
    """One body: its network, what acts on its surface, and how that is read."""

    network: AbstractNetwork
    reference: Float[Array, ""]
    """What the state counts from [K]."""
    load: SurfaceLoad | None
    """None if nothing acts on this body."""
    reading: SurfaceReading


class Program(eqx.Module):
    """All that the solver needs, and nothing else."""

    bodies: tuple[BodyProgram, ...]
    mechanisms: tuple[str, ...] = eqx.field(static=True)
    knots: tuple[float, ...] = eqx.field(static=True)
    """Times the solver lands on besides the save times [s]."""
    sampled: bool = eqx.field(static=True)
    """Whether some value is a function of time, known only where it is evaluated."""


class Compiled(eqx.Module):
    """A program with its initial state, surfaces and receipt."""

    program: Program
    state: State
    surfaces: tuple[SolvedSurface, ...]
    hottest: Any
    """end [s] -> highest temperature that emission must be stable at [K]."""
    receipt: Receipt = eqx.field(static=True)
