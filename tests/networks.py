"""Networks of small bodies, and everything that they say, for tests of operators."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxthermo.network.link_operator import LinkNetwork
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform


@eqx.filter_jit
def outputs_of(network, state, address, dt):
    """Everything a network says, at the nodes of an address, from one program."""

    def at_nodes(values):
        return values[address] if values.shape == state.shape else values

    step = network.euler_step(state, dt)
    return {
        "heat_rate": at_nodes(network.heat_rate(state)),
        "face_heat_rate": at_nodes(network.face_heat_rate(state)),
        "euler_step": at_nodes(step),
        "diagonal": at_nodes(network.diagonal()),
        "all capacities": at_nodes(network.capacity()),
        "capacity": network.capacity_at(address),
        "max_rate": network.max_rate(),
        "total_capacity": network.total_capacity(),
        "stored": network.stored(state),
        "stored after": network.stored(step),
    }


def state_of(structure, values):
    """State with these values at its nodes, in their order."""
    state = np.zeros(structure.state_shape)
    state[structure.node_address()] = values
    return jax.device_put(state)


def address_of(structure):
    """Position of all nodes in a state."""
    return tuple(map(jax.device_put, structure.node_address()))


def outputs_at_nodes(structure, network, values, dt=0.1):
    """Everything a network says of a state with these values at its nodes."""
    state = state_of(structure, values)
    return outputs_of(network, state, address_of(structure), jnp.array(dt))


def one_material(structure, conductivity, heat):
    """Network of one material in float64."""
    return assemble_uniform(structure, conductivity, heat, jnp.float64)


def two_materials(structure, conductivities, heat):
    """Network whose nodes have one of two conductivities in turn."""
    painted = np.arange(structure.node_count, dtype=np.int32) % 2
    return _assemble_mixed(
        structure, painted, jnp.array(conductivities), jnp.array([heat, heat])
    )


def pairs_of(structure, conductance, node_capacity):
    """The links of a structure as plain pairs that are all equal."""
    links = structure.links()
    return LinkNetwork(
        src=jax.device_put(links.src),
        dst=jax.device_put(links.dst),
        conductance=jax.device_put(np.full(len(links.src), conductance)),
        node_capacity=jax.device_put(np.full(structure.node_count, node_capacity)),
    )


def rates_by_hand(solid, values, conductances):
    """Conduction into every node [W], and the conductances of each, one by one.

    Links along x, y and z have these conductances [W/K].
    """
    cells = [tuple(cell) for cell in np.argwhere(solid)]
    number = {cell: n for n, cell in enumerate(cells)}
    rate = np.zeros(len(cells))
    diagonal = np.zeros(len(cells))
    for cell, n in number.items():
        for conductance, step in zip(conductances, np.eye(3, dtype=int), strict=True):
            for sign in (-1, 1):
                neighbour = number.get(tuple(np.add(cell, sign * step)))
                if neighbour is not None:
                    rate[n] += conductance * (values[neighbour] - values[n])
                    diagonal[n] += conductance
    return rate, diagonal
