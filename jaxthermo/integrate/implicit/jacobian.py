"""The Jacobian of an implicit stage as an operator, with its preconditioner.

A stage solves eta = base + g f(eta), f from `evaluate_rates`. Its Jacobian, as heat
rates for a change u of the conduction potential (of temperature, where k is constant),

    A u = (C / g + s) / d u - K u + contacts + air,

is symmetric and positive definite: K is the linear network, s the slope of each node's
load [W/K], d = d(phi)/d(eta) of `NonlinearNetwork`, 1 elsewhere. Only the K of
`VaryingLinks` is not quite symmetric. With 1 / g = 0 it is the Jacobian of a steady
state, which is singular for a part that loses no heat. `ImplicitContext` has what else
the solves of a run share.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float, Int

from ...arrays import device_array, taken
from ...errors import InputError
from ...geometry.mesh import connected_labels
from ...network.multigrid import Hierarchy, hierarchy, jacobi
from ...network.multigrid_cycle import AbstractCycle
from ...network.network import AbstractNetwork, inverse
from ...physics.contact.links import ContactLinks, PairNodes
from ...physics.term import AbstractTerm
from ...scene.compile.body_program import BodyProgram
from ...scene.compile.groups import body_groups
from ...scene.compile.memory import Method
from ...scene.compile.program import Compiled, Program, State
from ...scene.scene import Scene
from ...structures.structure import AbstractStructure
from ..heat_rates import (
    AirCoupling,
    air_couplings,
    load_slopes,
    pair_conductance,
    pair_nodes,
    pair_values,
)


class _Components(Module):
    """Connected components of a body's nodes."""

    number: Int[Array, "..."] | None
    """Component of every entry of the state; None if there is one component."""
    count: int = eqx.field(static=True)

    def sums(self, values: Float[Array, "*m"]) -> Float[Array, " p"]:
        """Sum the values of each component."""
        if self.number is None:
            return values.sum()[None]
        number = self.number.reshape(-1)
        return jax.ops.segment_sum(values.reshape(-1), number, self.count)

    def spread(self, values: Float[Array, " p"]) -> Float[Array, "*#m"]:
        """Return the value of its component for every entry of the state."""
        # One component broadcasts, which costs no gather.
        return values[0] if self.number is None else values[self.number]


def _connected_components(structure: AbstractStructure) -> _Components:
    return structure.found("linked_nodes", lambda: _found_components(structure))


def _found_components(structure: AbstractStructure) -> _Components:
    links = structure.links()
    pairs = np.stack([links.src, links.dst], axis=1)
    labels = connected_labels(structure.node_count, pairs)
    distinct, component = np.unique(labels, return_inverse=True)
    if len(distinct) == 1:
        return _Components(None, 1)
    number = np.zeros(structure.state_shape, np.int32)
    number[structure.node_address()] = component
    return _Components(device_array(number), len(distinct))


LINEAR_TOLERANCE = {"float32": 1e-4, "float64": 1e-9}
"""Default residual of a linear solve at every node over its capacity [K]."""

MULTIGRID_STEP_RATIO = 30.0
"""Step over stable step above which multigrid pays (`experiments run multigrid`): a
cycle costs many iterations with the diagonal."""


class ImplicitContext(Module):
    """Everything that implicit stages share, except for the compiled program."""

    hierarchies: tuple[Hierarchy | None, ...]
    """Multigrid levels of each body; None to precondition by the diagonal."""
    components: tuple[_Components, ...]
    nodes: tuple[Bool[Array, "..."] | None, ...]
    """Entries of each body's state that are nodes; None for all."""
    ceilings: tuple[Any, ...]
    """Upper bound of each body's states [K]; infinite where nothing bounds them."""
    floors: tuple[Any, ...]
    """Lower bound of each body's states [K]: the coldest temperature of the scene, or
    0 K where a term does not say how far it cools."""
    tolerance: Any
    """Tolerance of linear solves [K]."""
    above_rounding: bool = eqx.field(static=True)
    """True if linear solves may stop at their rounding: no tolerance was given."""
    linear: bool = eqx.field(static=True)
    """True if one Newton iteration is the solution."""
    varies: bool = eqx.field(static=True)
    """True if a property depends on temperature: steps may have to be shortened."""
    differentiable: bool = eqx.field(static=True, default=False)
    """True if derivatives may be needed, which costs one more residual."""

    @property
    def method(self) -> Method:
        """Kind of steps, for the forecast of memory."""
        return "implicit" if any(self.hierarchies) else "diagonal"


def arranged_for_solves(scene: Scene) -> Scene:
    """Return the scene with its bodies stored as linear solves run fast."""
    bodies = tuple(
        replace(body, structure=body.structure.for_solves()) for body in scene.bodies
    )
    return replace(scene, bodies=bodies)


def implicit_context(
    scene: Scene,
    compiled: Compiled,
    stable_step: float | None,
    max_dt: float,
    tolerance: float | None,
    traced: bool,
) -> ImplicitContext:
    """Prepare the implicit stages of a compiled scene, of steps up to `max_dt` [s].

    `stable_step` is the largest stable explicit step [s]; None if it is traced, and for
    a steady state, whose step is infinite.
    """
    dtype = compiled.receipt.dtype
    program = compiled.program
    groups = body_groups(scene, compiled.classes)
    for body in program.bodies:
        if not body.network.linear.is_symmetric:
            raise InputError(
                f"body {body.numbers[0]} has weights with `non_orthogonal`, whose "
                "conduction is not symmetric and cannot be solved for: simulate() it, "
                "with ForwardEuler() or SuperTimeStepping(), or set non_orthogonal to 0"
            )
    # Columns are stiff, but do not shorten the stable step.
    has_columns = any(body.network.columns is not None for body in program.bodies)
    multigrid = (
        has_columns
        or stable_step is None
        or max_dt > MULTIGRID_STEP_RATIO * stable_step
    )
    hierarchies: tuple[Hierarchy | None, ...] = tuple(
        hierarchy(group.structure, body.network)
        if multigrid and body.network.mesh is None
        else None
        for group, body in zip(groups, program.bodies, strict=True)
    )
    varies = not all(body.network.is_linear for body in program.bodies)
    load = program.surface
    linear = program.enclosure is None and not varies
    linear = linear and (load is None or load.by_cell.terms.is_linear)
    # By the maximum principle no state exceeds the hottest temperature of the scene.
    # Without a loss at the surface Newton's iterates need no bound.
    hottest = jnp.asarray(compiled.temperatures.highest, dtype)
    cooled = frozenset() if load is None else load.cooled_bodies()
    ceilings = tuple(_ceiling(body, hottest, cooled) for body in program.bodies)
    # Terms of a user need not say how far they cool.
    is_bounded = all(
        type(term).forcing is not AbstractTerm.forcing for term in scene.terms
    )
    coldest = jnp.asarray(compiled.temperatures.lowest if is_bounded else 0.0, dtype)
    floors = tuple(
        body.network.state_of(coldest - body.node_reference) for body in program.bodies
    )
    kelvin = LINEAR_TOLERANCE[dtype] if tolerance is None else tolerance
    return ImplicitContext(
        hierarchies=hierarchies,
        components=tuple(_connected_components(group.structure) for group in groups),
        nodes=tuple(_node_mask(group.structure) for group in groups),
        ceilings=ceilings,
        floors=floors,
        tolerance=jnp.asarray(kelvin, dtype),
        above_rounding=tolerance is None,
        linear=linear,
        varies=varies,
        differentiable=traced,
    )


def _ceiling(
    body: BodyProgram, hottest: Float[Array, ""], cooled: frozenset[int]
) -> Float[Array, "*n"]:
    """Upper bound of the states of a group; infinite in bodies that are not cooled."""
    highest = body.network.state_of(hottest - body.node_reference)
    is_cooled = np.array([number in cooled for number in body.numbers])
    if is_cooled.all():
        return highest
    if body.members is None:
        return jnp.full_like(highest, jnp.inf)
    return jnp.where(
        taken(device_array(is_cooled), body.members.of_node), highest, jnp.inf
    )


def _node_mask(structure: AbstractStructure) -> Bool[Array, "..."] | None:
    # A list of nodes has no other entries; a lattice has them outside the body.
    if len(structure.state_shape) == 1:
        return None

    def mask() -> Bool[Array, "..."]:
        is_node = np.zeros(structure.state_shape, bool)
        is_node[structure.node_address()] = True
        return device_array(is_node)

    return structure.found("node_mask", mask)


class _ContactJacobian(Module):
    """Heat rate through the pairs of one contact, linear in the potentials."""

    links: ContactLinks
    slopes: tuple[Float[Array, " p"] | None, Float[Array, " p"] | None]
    """Temperature that acts on the links by the potential of each body; None for 1."""

    def temperatures(self, u: State) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Values of both nodes of every pair that act on its link [K]."""
        first, second = (
            values if slope is None else slope * values
            for values, slope in zip(
                pair_values(self.links, u), self.slopes, strict=True
            )
        )
        return first, second


class _Jacobian(Module):
    """The operator A of all bodies."""

    networks: tuple[AbstractNetwork, ...]
    diagonal: State
    """(C / g + s) / d [W/K]."""
    contacts: tuple[_ContactJacobian, ...]
    airs: tuple[AirCoupling, ...]
    """Exchange with bodies of air, linear in the potentials."""
    time: Float[Array, ""]

    @property
    def is_symmetric(self) -> bool:
        """True for conjugate gradients."""
        slopes = [slope for contact in self.contacts for slope in contact.slopes]
        varies = any(slope is not None for slope in slopes)
        has_symmetric_airs = all(air.is_symmetric for air in self.airs)
        is_symmetric = all(network.is_symmetric for network in self.networks)
        return not varies and has_symmetric_airs and is_symmetric

    def mv(self, u: State) -> State:
        """Return A u [W]."""
        image = [
            d * v - network.face_heat_rate(v)
            for d, network, v in zip(self.diagonal, self.networks, u, strict=True)
        ]
        # References are 0, since u is a difference of temperatures.
        zero = jnp.zeros((), u[0].dtype)
        for contact in self.contacts:
            links = contact.links
            nodes = PairNodes(contact.temperatures(u), (zero, zero))
            flow = links.heat(self.time, nodes).rate
            for side, sign in ((0, 1), (1, -1)):
                body = links.bodies[side]
                address = links.address[side]
                image[body] = image[body].at[address].add(sign * flow)
        for air in self.airs:
            for number, (into_node, into_air, v) in enumerate(
                zip(air.into_nodes, air.into_air, u, strict=True)
            ):
                image[number] = image[number] - into_node * u[air.body][0]
                image[air.body] = image[air.body] - (into_air * v).sum()
        return tuple(image)

    def magnitude(self, u: State) -> State:
        """Return |A| |u|, to which the rounding of A u is relative [W]."""
        size = jax.tree.map(jnp.abs, u)
        # sum_j G (|u_j| + |u_i|), from conduction between |u|.
        image = [
            (d + 2 * network.diagonal()) * v + network.face_heat_rate(v)
            for d, network, v in zip(self.diagonal, self.networks, size, strict=True)
        ]
        for contact in self.contacts:
            links = contact.links
            pair_sum = pair_conductance(links, self.time) * sum(
                contact.temperatures(size)
            )
            for body, address in zip(links.bodies, links.address, strict=True):
                image[body] = image[body].at[address].add(pair_sum)
        for air in self.airs:
            for number, (into_node, into_air, v) in enumerate(
                zip(air.into_nodes, air.into_air, size, strict=True)
            ):
                image[number] = image[number] + into_node * size[air.body][0]
                image[air.body] = image[air.body] + (into_air * v).sum()
        return tuple(image)


class _DeflatedPreconditioner(Module):
    """Preconditioner M, with the mean of each component solved for exactly.

    With s = A 1 [W/K], for each component

        z = 1 c + Q^T M Q r,    c = sum r / sum s,    Q r = r - s c.

    Source: Mandel, Communications in Numerical Methods in Engineering 9 (1993) 233-241.
    """

    cycle: AbstractCycle
    components: _Components
    row_sums: Float[Array, "..."]
    """s, of the body by itself [W/K]."""

    def __call__(self, residual: Float[Array, "*m"]) -> Float[Array, "*m"]:
        # Where a component loses hardly any heat, as by emission near 0 K in a step of
        # 1e12 s, the balance has next to no curvature along its mean: less than the
        # rounding of a multigrid cycle.
        components = self.components
        s = self.row_sums
        inverse_sum = inverse(components.sums(s))
        mean = inverse_sum * components.sums(residual)
        z = self.cycle(residual - s * components.spread(mean))
        return z + components.spread(mean - inverse_sum * components.sums(s * z))


class _BlockPreconditioner(Module):
    """Preconditioner of each body by itself, contacts on the diagonal only."""

    blocks: tuple[_DeflatedPreconditioner, ...]

    def __call__(self, residual: State) -> State:
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

    def node_conductance(self) -> State:
        """Sum of all conductances of every node, for changes of the potential [W/K]."""
        operator = self.operator
        return tuple(
            diagonal + network.diagonal()
            for diagonal, network in zip(
                operator.diagonal, operator.networks, strict=True
            )
        )


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
    slopes, _ = load_slopes(program, states, time)
    networks = tuple(body.network for body in program.bodies)
    # Jacobians of conduction, and the slope d where a conductivity varies.
    conduction, potential = zip(
        *(n.linearized(state) for n, state in zip(networks, states, strict=True)),
        strict=True,
    )
    diagonal = masked_to_nodes(
        tuple(
            _over(network.capacity() * (rate + slope), d)
            for network, slope, d in zip(networks, slopes, potential, strict=True)
        ),
        context.nodes,
    )
    # Divided by d, the unknown is the potential, whose conduction is linear and
    # symmetric also where the conductivity of one material depends on temperature.
    operator = _Jacobian(
        networks=conduction,
        diagonal=diagonal,
        contacts=tuple(
            _linearized_contact(
                program, contact=contact, states=states, potential=potential, time=time
            )
            for contact in program.contacts
        ),
        airs=tuple(
            replace(air, into_air=tuple(map(_over, air.into_air, potential)))
            for air in air_couplings(program, states, time)
        ),
        time=time,
    )
    # Cycles know no links between bodies: contacts enter by their diagonal only [W/K].
    with_contacts = list(diagonal)
    for contact in operator.contacts:
        links = contact.links
        conductance = pair_conductance(links, time)
        ends = zip(links.bodies, links.address, contact.slopes, strict=True)
        for body, address, slope in ends:
            flow = conductance if slope is None else slope * conductance
            with_contacts[body] = with_contacts[body].at[address].add(flow)
    row_sums = tuple(with_contacts)
    regular_diagonal = row_sums
    if regularization is not None:
        regular_diagonal = jax.tree.map(
            jnp.add, regular_diagonal, regularization(regular_diagonal)
        )
    cycles = tuple(
        jacobi(network.linear, body_diagonal)
        if levels is None
        else levels.cycle(body_diagonal)
        for network, levels, body_diagonal in zip(
            networks, context.hierarchies, regular_diagonal, strict=True
        )
    )
    blocks = tuple(map(_DeflatedPreconditioner, cycles, context.components, row_sums))
    capacity = tuple(
        jnp.broadcast_to(network.capacity(), state.shape)
        for network, state in zip(networks, states, strict=True)
    )
    return Linearization(
        operator=operator,
        preconditioner=_BlockPreconditioner(blocks),
        potential_slopes=potential,
        capacity=capacity,
        nodes=context.nodes,
    )


def _linearized_contact(
    program: Program,
    contact: ContactLinks,
    states: State,
    potential: tuple[Float[Array, "..."] | None, ...],
    time: Float[Array, ""],
) -> _ContactJacobian:
    nodes = pair_nodes(program, contact, states)
    if nodes.varying is None:
        return _ContactJacobian(contact, (None, None))
    tangent = contact.tangent(time, nodes)
    # Contacts act on temperatures, not on the potential.
    slopes = []
    for body, address, ratio in zip(
        contact.bodies, contact.address, tangent.ratio, strict=True
    ):
        per_potential = potential[body]
        if per_potential is not None:
            network = program.bodies[body].network
            state = states[body]
            _, per_state = jax.jvp(
                network.temperature, (state,), (jnp.ones_like(state),)
            )
            ratio = ratio * taken(per_state * inverse(per_potential), address)
        slopes.append(ratio)
    return _ContactJacobian(tangent.links, (slopes[0], slopes[1]))


def masked_to_nodes(
    values: State, nodes: tuple[Bool[Array, "..."] | None, ...]
) -> State:
    """Return values with 0 where there is no node."""
    return tuple(
        state if is_node is None else jnp.where(is_node, state, 0)
        for state, is_node in zip(values, nodes, strict=True)
    )


def _over(values, slope):
    return values if slope is None else values * inverse(slope)
