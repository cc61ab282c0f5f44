"""Parts of a scene that exchange heat with nothing: their steady mean is undetermined.

Such a part keeps its heat: it becomes uniform at the mean that it starts with. If a
heat source acts on it there is no steady state.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int
from skimage import measure

from ..arrays import device_array
from ..errors import InputError
from ..geometry.mesh import connected_labels
from ..network.multigrid import MAX_DENSE_SIZE, link_conductance, node_layout
from ..network.network import AbstractNetwork, AbstractNodeNetwork
from ..physics.convection.enclosed_air import AirLaw
from ..physics.time_varying import value_at
from ..scene.compile.groups import BodyGroup
from ..scene.compile.program import Program, State
from ..structures.structure import AbstractStructure
from .heat_rates import add_loads, air_couplings, load_slopes, pair_conductance
from .implicit.jacobian import ImplicitContext, masked_to_nodes


_NET_HEAT_ROUNDING = 1e-5
"""Net heat rate of a component over the sum of magnitudes that counts as zero."""

_MIN_PROBE_TEMPERATURE = 300.0
"""Temperature to which colder states are raised to find loads that remove heat [K]:
at 0 K emission does not."""

_REGULARIZATION = 0.01
"""Fraction of the diagonal that makes a preconditioner regular in a component."""


class IsolatedComponents(Module):
    """Connected components that exchange heat with nothing else."""

    number: tuple[Int[Array, " _"], ...]
    """Component of every entry of each body's state; `count` for none."""
    weight: tuple[Float[Array, " _"], ...]
    """Capacity of each entry over that of its component."""
    mean: Float[Array, " i"]
    """Initial capacity-weighted mean of each component [K]."""
    count: int = eqx.field(static=True)
    bodies: tuple[int, ...] = eqx.field(static=True)
    """Numbers of the bodies that have nodes in one of them."""

    def means(self, states: State) -> Float[Array, " i"]:
        """Return the capacity-weighted mean of each component [K]."""
        weighted = tuple(
            weight.reshape(state.shape) * state
            for state, weight in zip(states, self.weight, strict=True)
        )
        return self._sums(weighted)[:-1]

    def with_initial_means(self, states: State) -> State:
        """Shift each component to the mean that it started with."""
        return self._shifted(states, self.mean - self.means(states))

    def without_means(self, change: State) -> State:
        """Remove the mean change of each component."""
        return self._shifted(change, -self.means(change))

    def _shifted(self, states: State, shift: Float[Array, " i"]) -> State:
        shift = jnp.append(shift, 0)
        return tuple(
            state + shift[number].reshape(state.shape)
            for state, number in zip(states, self.number, strict=True)
        )

    def without_net_heat(self, heat: State) -> State:
        """Remove the net heat rate of each component, which is rounding."""
        total = self._sums(heat).at[-1].set(0)
        return tuple(
            rate - (weight * total[number]).reshape(rate.shape)
            for rate, number, weight in zip(heat, self.number, self.weight, strict=True)
        )

    def _sums(self, values: State) -> Float[Array, " j"]:
        # Of each component; last, those of no component.
        flat = jnp.concatenate([state.reshape(-1) for state in values])
        number = jnp.concatenate(self.number)
        return jax.ops.segment_sum(flat, number, self.count + 1)

    def regularization(self, diagonal: State) -> State:
        """Return what a preconditioner adds to the singular diagonal [W/K]."""
        return tuple(
            jnp.where((number < self.count).reshape(d.shape), _REGULARIZATION * d, 0)
            for number, d in zip(self.number, diagonal, strict=True)
        )


class ProjectedPreconditioner(Module):
    """Preconditioner that changes neither the heat nor the mean of a component.

    A has no curvature along a component's mean: without the projection a search ends
    where rounding first points along it. It is symmetric, since the projection of the
    heat is the transpose of that of the change.
    """

    cycle: Callable[[State], State]
    isolated: IsolatedComponents

    def __call__(self, residual: State) -> State:
        """Return the correction of a residual [W] -> [K]."""
        heat = self.isolated.without_net_heat(residual)
        return self.isolated.without_means(self.cycle(heat))


def find_isolated_components(
    groups: tuple[BodyGroup, ...],
    program: Program,
    context: ImplicitContext,
    states: State,
    time: Float[Array, ""],
) -> IsolatedComponents | None:
    """Find the isolated components of a program; None if there are none.

    `groups` are the bodies of the program, as it joins them.
    """
    # On the host, once per solve: the components do not change with temperature.
    component = _components(groups, program, states, time)
    dtype = states[0].dtype
    probe = jnp.asarray(_MIN_PROBE_TEMPERATURE, dtype)
    warmed = tuple(
        jnp.maximum(state, body.network.state_of(probe - body.node_reference))
        for body, state in zip(program.bodies, states, strict=True)
    )
    # One program instead of one an operation; only signs are used.
    slopes, _ = eqx.filter_jit(load_slopes)(_without_air(program), warmed, time)
    # Of every entry of all states, 0 where no node is [J/K].
    capacities = tuple(
        jnp.broadcast_to(body.network.capacity(), state.shape)
        for body, state in zip(program.bodies, states, strict=True)
    )
    capacity = _flat(masked_to_nodes(capacities, context.nodes)).astype(float)
    # A load whose heat rate falls with temperature removes heat from its component; an
    # entry that is no node has capacity 0 and forms a component of its own.
    loses_heat = np.zeros(len(component), bool)
    loses_heat[component[(_flat(slopes) > 0) | (capacity == 0)]] = True
    starts = np.cumsum([0, *(state.size for state in states)])
    for air in program.airs:
        node = starts[program.group_of(air.body)]
        loses_heat[component[node]] |= float(value_at(air.rate, time)) > 0
    inside = ~loses_heat[component]
    if not inside.any():
        return None
    roots, index = np.unique(component[inside], return_inverse=True)
    number = np.full(len(component), len(roots), np.int32)
    number[inside] = index
    _refuse_heated(program, states=states, time=time, number=number, capacity=capacity)
    total = np.bincount(number, capacity)
    weight = np.where(inside, capacity / np.where(inside, total[number], 1), 0)
    cuts = starts[1:-1]
    components = IsolatedComponents(
        number=tuple(
            device_array(body_number) for body_number in np.split(number, cuts)
        ),
        weight=tuple(
            device_array(body_weight, dtype) for body_weight in np.split(weight, cuts)
        ),
        mean=jnp.zeros(len(roots), dtype),
        count=len(roots),
        bodies=tuple(np.unique(_body_of_entries(program, states)[inside]).tolist()),
    )
    return replace(components, mean=components.means(states))


def _without_air(program: Program) -> Program:
    """The program without the exchange of heat with bodies of air."""
    if program.surface is None or not program.airs:
        return program
    load = program.surface.by_cell
    natural = tuple(
        (number, term)
        for number, term in load.terms.natural
        if not isinstance(term.law, AirLaw)
    )
    load = replace(load, terms=replace(load.terms, natural=natural))
    return replace(program, surface=load, airs=())


def _refuse_heated(program: Program, states: State, time, number, capacity) -> None:
    zero = tuple(jnp.zeros_like(state) for state in states)
    loads, _ = add_loads(
        program, states=states, new=zero, time=time, dt=jnp.ones((), zero[0].dtype)
    )
    # Loads over one second are rates [K/s]; in float64, since net heat is a difference.
    heat = _flat(loads).astype(float) * capacity
    net = np.bincount(number, heat)[:-1]
    magnitude = np.bincount(number, np.abs(heat))[:-1]
    heated = np.flatnonzero(np.abs(net) > _NET_HEAT_ROUNDING * magnitude)
    if not len(heated):
        return
    worst = heated[np.abs(net[heated]).argmax()]
    # The component with most net heat is named, in the user's terms.
    inside = number == worst
    bodies = _body_of_entries(program, states)
    named = ", ".join(str(b) for b in np.unique(bodies[inside]))
    fraction = capacity[inside].sum() / capacity[np.isin(bodies, bodies[inside])].sum()
    raise InputError(
        f"steady: {net[worst]:.3g} W enters body {named} "
        f"({100 * fraction:.3g} % of its capacity) and nothing removes it, so "
        "there is no steady state; give it a term that does, such as Convection, or "
        "use simulate"
    )


def _body_of_entries(program: Program, states: State) -> Int[np.ndarray, " v"]:
    """Number of the body of every entry of all states."""
    of_bodies = jnp.arange(program.body_count)
    return np.concatenate(
        [
            np.broadcast_to(np.asarray(body.at_nodes(of_bodies)), state.size)
            for body, state in zip(program.bodies, states, strict=True)
        ]
    )


def _flat(states: State) -> np.ndarray:
    return np.concatenate([np.asarray(state).reshape(-1) for state in states])


def _components(
    groups: tuple[BodyGroup, ...], program: Program, states: State, time
) -> Int[np.ndarray, " v"]:
    """Label every entry of all states by an entry that conduction connects it to."""
    labels = [
        _body_components(group.structure, body.network.linear)
        for group, body in zip(groups, program.bodies, strict=True)
    ]
    starts = np.cumsum([0, *(label.size for label in labels)])
    flat = np.concatenate(
        [label.reshape(-1) + s for label, s in zip(labels, starts[:-1], strict=True)]
    )
    links = [np.zeros((0, 2), np.int64)]
    for contact in program.contacts:
        ends = []
        for body, address in zip(contact.bodies, contact.address, strict=True):
            host_address = tuple(map(np.asarray, address))
            entry = np.ravel_multi_index(host_address, labels[body].shape)
            ends.append(flat[starts[body] + entry])
        # A contact of conductance 0 connects nothing.
        conducts = np.asarray(pair_conductance(contact, time)) > 0
        links.append(np.stack(ends, axis=1)[conducts])
    for air in air_couplings(program, states, time):
        nodes = np.flatnonzero(_flat(air.into_nodes) > 0)
        ends = [flat[nodes], np.full(len(nodes), flat[starts[air.body]])]
        links.append(np.stack(ends, axis=1))
    return connected_labels(len(flat), np.concatenate(links))[flat]


def _body_components(
    structure: AbstractStructure, network: AbstractNetwork
) -> Int[np.ndarray, "..."]:
    """Label every entry of a state by an entry that conduction connects it to."""
    if isinstance(network, AbstractNodeNetwork):
        layout = node_layout(structure, MAX_DENSE_SIZE)
        links = structure.links()
        conducts = np.asarray(link_conductance(layout, network)) > 0
        pairs = np.stack([links.src, links.dst], axis=1)[conducts]
        return connected_labels(structure.node_count, pairs)
    # Two neighbours on a lattice that have any links are linked to each other.
    linked = np.asarray(network.diagonal()) > 0
    number = np.asarray(measure.label(linked, connectivity=1))
    _, first = np.unique(number, return_index=True)
    alone = np.arange(number.size).reshape(number.shape)
    return np.where(linked, first[number], alone)
