"""What acts on a body's surface in the time loop."""

import abc

import equinox as eqx
from jaxtyping import Array, Float, Int

from ...network.network import AbstractNetwork, Address, slot_sums
from ...physics.surface_energy_balance import SurfaceTerms


class AbstractLoad(eqx.Module):
    """What acts on a body's surface in the time loop."""

    @property
    @abc.abstractmethod
    def places(self) -> "SurfaceLoad":
        """The same, place by place."""

    @abc.abstractmethod
    def nodes_of(self, state: Float[Array, "..."]) -> Float[Array, " m"]:
        """Of a state, the nodes that it takes."""

    @abc.abstractmethod
    def apply_heat(
        self,
        new: Float[Array, "..."],
        network: AbstractNetwork,
        nodes: Float[Array, " m"],
        time: Float[Array, ""],
        dt: Float[Array, ""],
        radiated: Float[Array, " p"] | None = None,
        emits: bool = False,
    ) -> tuple[Float[Array, "..."], Float[Array, " c"]]:
        """`new` with the heat of one step, and what each entry brings [W].

        Args:
            new: the state so far.
            network: of the body.
            nodes: temperatures before the step, above the reference [K].
            time: of the loads [s].
            dt: the step [s].
            radiated: to each place by what it sees [W/m^2].
            emits: whether its own emission is not yet taken off that.
        """

    def stiffness(
        self, hottest: Float[Array, ""], end: float, relative: Float[Array, ""]
    ) -> Float[Array, " m"]:
        """What it adds to each node's conductances in the stable step [W/K].

        Args:
            hottest: that surfaces can get [K].
            end: of the run [s].
            relative: the largest conductivity over that at the reference.
        """
        places = self.places
        most = places.terms.stiffness(hottest, end, relative)
        return slot_sums(most, places.slots)


class SurfaceLoad(AbstractLoad):
    """What acts on a body's surface in the time loop.

    Fragments of one node on which the same terms act are one place; a fragment on which
    nothing acts has none. Some more at the end, without share, make their number even
    (`load.even_size`). Places are summed by gathering, and every node is then written
    once, which is several times faster than adding to it in turn.
    """

    address: Address
    """Of the nodes that have such places, each once, in the order of the state."""
    capacity: Float[Array, "*m"]
    """Of those nodes [J/K]; one number if all have the same."""
    node: Int[Array, " p"]
    """Of each place, its node among them."""
    slots: tuple[Int[Array, " m"], ...]
    """Of each node, its k-th place; where it has fewer, one without share or none."""
    terms: SurfaceTerms
    """On the places."""

    @property
    def places(self) -> "SurfaceLoad":
        """Itself."""
        return self

    def nodes_of(self, state: Float[Array, "..."]) -> Float[Array, " m"]:
        """Those at `address`."""
        return state.at[self.address].get(mode="promise_in_bounds")

    def at_places(
        self, network: AbstractNetwork, nodes: Float[Array, " m"]
    ) -> tuple[SurfaceTerms, Float[Array, " p"]]:
        """What acts on the places, and the temperatures of their nodes [K]."""
        here = self.here(nodes)
        return self.terms.conducting(network.relative_conductivity(here)), here

    def here(self, nodes: Float[Array, " m"]) -> Float[Array, " p"]:
        """Values of the places' nodes."""
        return nodes.at[self.node].get(mode="promise_in_bounds")

    def apply_heat(
        self,
        new: Float[Array, "..."],
        network: AbstractNetwork,
        nodes: Float[Array, " m"],
        time: Float[Array, ""],
        dt: Float[Array, ""],
        radiated: Float[Array, " p"] | None = None,
        emits: bool = False,
    ) -> tuple[Float[Array, "..."], Float[Array, " c"]]:
        """`new` with the heat of one step, and what each entry brings [W]."""
        terms, here = self.at_places(network, nodes)
        if radiated is not None:
            terms = terms.radiating(radiated, emits)
        heat, by_entry = terms.heat(time, here)
        return self.add(new, dt, heat), by_entry

    def add(
        self, new: Float[Array, "..."], dt: Float[Array, ""], heat: Float[Array, " p"]
    ) -> Float[Array, "..."]:
        """`new` with the heat rates of all places [W] over `dt` [s]."""
        return self.add_nodes(new, dt, slot_sums(heat, self.slots))

    def add_nodes(
        self, new: Float[Array, "..."], dt: Float[Array, ""], heat: Float[Array, " m"]
    ) -> Float[Array, "..."]:
        """The same with those of the nodes at `address`.

        The state stays three-dimensional here: flattening it for the scatter would make
        XLA compute the whole stencil with flat indices, slowly.
        """
        return new.at[self.address].add(
            dt * heat / self.capacity,
            mode="promise_in_bounds",
            indices_are_sorted=True,
            unique_indices=True,
        )
