"""Components of a scene that no heat leaves, whose steady mean is not determined.

Such a part keeps what it has: it evens out at the mean that it starts with. If heat is
brought to it there is no steady state.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from skimage import measure

from ...errors import InputError
from ...geometry.connectivity import connected_labels
from ...network.multigrid import MAX_DENSE_SIZE
from ...network.multigrid_nodes import link_conductance, node_layout
from ...network.network import AbstractNetwork, AbstractNodeNetwork, Address
from ...scene.compile.program import Program, State
from ...scene.scene import Scene
from ...structures.structure import AbstractStructure
from ..implicit.context import ImplicitContext
from ..implicit.jacobian import masked_to_nodes
from ..implicit.residual import load_slopes
from ..run.heat_rates import add_loads


ROUNDING = 1e-5
"""Of the heat that comes to an island and goes: less is as good as none."""

PROBED = 300.0
"""The least temperature at which it is asked what carries heat off [K]: at 0 K
emission does not."""

HELD = 0.01
"""Of the diagonal: enough for a preconditioner to be one inside an island."""


class IsolatedComponents(eqx.Module):
    """Connected parts that exchange heat with nothing else."""

    number: tuple[Int[Array, " _"], ...]
    """Of every value of each body's state; `count` where it is in none."""
    weight: tuple[Float[Array, " _"], ...]
    """Capacity of each over that of its island [-]."""
    mean: Float[Array, " i"]
    """What each island holds at the start over its capacity [K]."""
    count: int = eqx.field(static=True)

    def means(self, states: State) -> Float[Array, " i"]:
        """What each island holds over its capacity [K]."""
        weighed = tuple(
            weight.reshape(state.shape) * state
            for state, weight in zip(states, self.weight, strict=True)
        )
        return self._sums(weighed)[:-1]

    def settled(self, states: State) -> State:
        """States in which every island holds what it held."""
        shift = jnp.append(self.mean - self.means(states), 0)
        return tuple(
            state + shift[number].reshape(state.shape)
            for state, number in zip(states, self.number, strict=True)
        )

    def without_mean(self, change: State) -> State:
        """Changes that leave every island what it holds."""
        mean = jnp.append(self.means(change), 0)
        return tuple(
            each - mean[number].reshape(each.shape)
            for each, number in zip(change, self.number, strict=True)
        )

    def balanced(self, heat: State) -> State:
        """Heat rates that bring nothing to any island in all: what did is rounding."""
        total = self._sums(heat).at[-1].set(0)
        return tuple(
            each - (weight * total[number]).reshape(each.shape)
            for each, number, weight in zip(heat, self.number, self.weight, strict=True)
        )

    def _sums(self, values: State) -> Float[Array, " j"]:
        """In each island, and in none."""
        flat = jnp.concatenate([each.reshape(-1) for each in values])
        number = jnp.concatenate(self.number)
        return jax.ops.segment_sum(flat, number, self.count + 1)

    def regularization(self, diagonal: State) -> State:
        """What islands are held by where A is preconditioned [W/K]."""
        return tuple(
            jnp.where((number < self.count).reshape(own.shape), HELD * own, 0)
            for number, own in zip(self.number, diagonal, strict=True)
        )


class ProjectedPreconditioner(eqx.Module):
    """A preconditioner that moves no heat into an island, nor its mean.

    A has no curvature along an island: without this a search ends where rounding first
    points there. Symmetric, as what is taken from the heat is the transpose of what is
    taken from the change.
    """

    cycle: Callable[[State], State]
    islands: IsolatedComponents

    def __call__(self, residual: State) -> State:
        """Of every body."""
        return self.islands.without_mean(self.cycle(self.islands.balanced(residual)))


def find_isolated_components(
    scene: Scene,
    program: Program,
    context: ImplicitContext,
    states: State,
    time: Float[Array, ""],
) -> IsolatedComponents | None:
    """Those of a scene; None if heat leaves every part of it.

    Args:
        scene: bodies and terms.
        program: of the scene.
        context: for it.
        states: at the start.
        time: of the loads [s].

    Raises:
        InputError: if heat is brought to one, or taken from it.
    """
    part = _parts(scene, program, time)
    slopes = load_slopes(program, _warm(program, states), time).change
    capacity = _capacity(program, context, states)
    leads_out = np.zeros(len(part), bool)
    leads_out[part[(_flat(slopes) > 0) | (capacity == 0)]] = True
    inside = ~leads_out[part]
    if not inside.any():
        return None
    roots, own = np.unique(part[inside], return_inverse=True)
    number = np.full(len(part), len(roots), np.int32)
    number[inside] = own
    _refuse_heated(program, states, time, number, capacity)
    total = np.bincount(number, capacity)
    weight = np.where(inside, capacity / np.where(inside, total[number], 1), 0)
    cuts, dtype = np.cumsum([s.size for s in states])[:-1], states[0].dtype
    found = IsolatedComponents(
        number=tuple(jnp.asarray(each) for each in np.split(number, cuts)),
        weight=tuple(jnp.asarray(each, dtype) for each in np.split(weight, cuts)),
        mean=jnp.zeros(len(roots), dtype),
        count=len(roots),
    )
    return replace(found, mean=found.means(states))


def _refuse_heated(program: Program, states: State, time, number, capacity) -> None:
    """Refuse heat that comes to an island, which no temperature balances."""
    still = tuple(jnp.zeros_like(state) for state in states)
    loads, _ = add_loads(program, states, still, time, jnp.ones((), still[0].dtype))
    heat = _flat(loads).astype(float) * capacity
    into = np.bincount(number, heat)[:-1]
    moved = np.bincount(number, np.abs(heat))[:-1]
    wrong = np.flatnonzero(np.abs(into) > ROUNDING * moved)
    if not len(wrong):
        return
    island = wrong[np.abs(into[wrong]).argmax()]
    here = number == island
    bodies = np.repeat(np.arange(len(states)), [state.size for state in states])
    named = ", ".join(str(b) for b in np.unique(bodies[here]))
    share = capacity[here].sum() / capacity[np.isin(bodies, bodies[here])].sum()
    raise InputError(
        f"steady: {into[island]:.3g} W is brought to body {named} "
        f"({100 * share:.3g} % of its capacity) and nothing carries it off, so there "
        "is no steady state; give it a term that does, such as Convection, or use "
        "simulate"
    )


def _warm(program: Program, states: State) -> State:
    """States that are nowhere so cold that emission carries nothing off."""
    probed = lambda body, dtype: jnp.asarray(PROBED, dtype) - body.reference
    return tuple(
        jnp.maximum(state, body.network.state_of(probed(body, state.dtype)))
        for body, state in zip(program.bodies, states, strict=True)
    )


def _capacity(program: Program, context: ImplicitContext, states: State):
    """Of every value of all states, 0 where there is no node [J/K]."""
    each = tuple(
        jnp.broadcast_to(body.network.capacity(), state.shape)
        for body, state in zip(program.bodies, states, strict=True)
    )
    return _flat(masked_to_nodes(each, context.nodes)).astype(float)


def _flat(states: State) -> np.ndarray:
    return np.concatenate([np.asarray(state).reshape(-1) for state in states])


def _parts(scene: Scene, program: Program, time) -> Int[np.ndarray, " v"]:
    """Of every value of all states, the first one that heat reaches it from."""
    own = [
        _own_parts(body.structure, part.network.linear)
        for body, part in zip(scene.bodies, program.bodies, strict=True)
    ]
    starts = np.cumsum([0, *(part.size for part in own)])
    label = np.concatenate(
        [part.reshape(-1) + start for part, start in zip(own, starts[:-1], strict=True)]
    )
    bridges = [np.zeros((0, 2), np.int64)]
    for contact in program.contacts:
        one, zero = jnp.ones_like(contact.area), jnp.zeros((), contact.area.dtype)
        passes = np.asarray(contact.heat_rate(time, (one, 0 * one), (zero, zero))) > 0
        ends = [
            label[starts[body] + np.ravel_multi_index(_host(address), own[body].shape)]
            for body, address in zip(contact.bodies, contact.address, strict=True)
        ]
        bridges.append(np.stack(ends, axis=1)[passes])
    return connected_labels(len(label), np.concatenate(bridges))[label]


def _own_parts(
    structure: AbstractStructure, network: AbstractNetwork
) -> Int[np.ndarray, "..."]:
    """Of every value of a state, the first one that conduction reaches it from."""
    if isinstance(network, AbstractNodeNetwork):
        layout, links = node_layout(structure, MAX_DENSE_SIZE), structure.links()
        conducts = np.asarray(link_conductance(layout, network)) > 0
        pairs = np.stack([links.src, links.dst], axis=1)[conducts]
        return connected_labels(structure.node_count, pairs)
    # Two neighbours on a lattice that have any links are linked to each other.
    linked = np.asarray(network.diagonal()) > 0
    number = np.asarray(measure.label(linked, connectivity=1))
    _, first = np.unique(number, return_index=True)
    alone = np.arange(number.size).reshape(number.shape)
    return np.where(linked, first[number], alone)


def _host(address: Address) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(index) for index in address)
