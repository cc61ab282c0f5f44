"""Correction of a step so that stored heat equals the heat of the ledger.

States and the heat of the mechanisms are computed separately. They differ by what the
linear solve leaves, and by rounding of the rates, which a long step multiplies. Every
body b is therefore made lambda_b warmer, and every mechanism brings what it then would:
the balance of the step with one temperature per body,

    (C_b + g sum_e s_e) lambda_b - g sum_{e to c} s_e lambda_c = missing_b,

s_e the slopes of loads and contacts [W/K], g the step of the last stage. The tolerance
of a solve is in kelvin, and no lambda is larger: the maximum principle holds as far as
the solve satisfies it.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...network.network import inverse, precise_sum
from ...scene.compile.program import Program, State
from ..run.ledger import into_bodies
from .residual import load_slopes


def correct_energy(
    program: Program,
    before: State,
    after: State,
    heat: Float[Array, " c"],
    g: Float[Array, ""],
    time: Float[Array, ""],
) -> tuple[State, Float[Array, " c"]]:
    """Return states that hold exactly the heat of the ledger, and that heat [J]."""
    # The slopes only distribute a rest of the size of rounding: so small, too, is what
    # their derivatives would add.
    loads, contacts = jax.lax.stop_gradient(_slopes(program, after, time))
    capacity = [body.network.capacity() for body in program.bodies]
    difference = jax.tree.map(jnp.subtract, after, before)
    # Nodes that have not changed at all stay as they are, bit by bit.
    changed = tuple((each != 0).astype(heat.dtype) for each in difference)
    missing = lambda heat, states: (
        into_bodies(heat, program.entries, len(program.bodies))
        - jnp.stack(
            [
                precise_sum(c * (new - old))
                for c, new, old in zip(capacity, states, before, strict=True)
            ]
        )
    )
    holding = jnp.stack(
        [precise_sum(c * m) for c, m in zip(capacity, changed, strict=True)]
    )
    total = jnp.stack([body.network.total_capacity() for body in program.bodies])
    # Where nothing changed nothing will; only a division by zero must be avoided.
    holding = jnp.where(holding > 0, holding, total)
    loss, links = _by_body(program, loads, contacts)
    warmer = solve_dominant(holding + g * loss, g * links, missing(heat, after))
    heat = heat - g * _response(program, loads, contacts, warmer)
    states = tuple(
        new + extra * m for new, extra, m in zip(after, warmer, changed, strict=True)
    )
    # The rest is rounding; loads that depend on temperature take it.
    rest = missing(heat, states) * inverse(loss)
    return states, heat - _response(program, loads, 0 * contacts, rest)


def _by_body(
    program: Program, loads: Float[Array, " c"], contacts: Float[Array, " c"]
) -> tuple[Float[Array, " b"], Float[Array, "b b"]]:
    """Sum the slopes of each body's loads, and of each pair's contacts [W/K]."""
    bodies = len(program.bodies)
    loss = jnp.zeros(bodies, loads.dtype)
    links = jnp.zeros((bodies, bodies), loads.dtype)
    for n, entry in enumerate(program.entries):
        if entry.other is None:
            loss = loss.at[entry.body].add(loads[n])
        else:
            links = links.at[entry.body, entry.other].add(contacts[n])
    return loss, links + links.T


def _response(program, loads, contacts, warmer) -> Float[Array, " c"]:
    """Return the decrease of each entry's heat rate for warmer bodies [W]."""
    each = [
        loads[n] * warmer[entry.body]
        if entry.other is None
        else contacts[n] * (warmer[entry.other] - warmer[entry.body])
        for n, entry in enumerate(program.entries)
    ]
    return jnp.stack(each) if each else jnp.zeros(0, warmer.dtype)


def _slopes(
    program: Program, states: State, time: Float[Array, ""]
) -> tuple[Float[Array, " c"], Float[Array, " c"]]:
    """Return -d(entry)/d(state) of loads and of contacts, 0 or more [W/K]."""
    loads = load_slopes(program, states, time).entries
    contacts = jnp.zeros_like(loads)
    zero = jnp.zeros((), loads.dtype)
    for contact in program.contacts:
        one = jnp.ones_like(contact.area)
        flow = contact.heat_rate(time, (one, 0 * one), (zero, zero))
        contacts = contacts.at[contact.entry].set(precise_sum(flow))
    return loads, contacts


def solve_dominant(
    excess: Float[Array, " b"], links: Float[Array, "b b"], right: Float[Array, " b"]
) -> Float[Array, " b"]:
    """Solve (excess_i + sum_j links_ij) x_i - sum_j links_ij x_j = right_i.

    Gaussian elimination in which each diagonal is stored as what it exceeds the sum of
    its row by, so that strong links lose no digit.

    Source: Grassmann, Taksar, Heyman, Operations Research 33 (1985) 1107-1116.
    """
    # No difference occurs: `excess` is positive, `links` is symmetric, 0 or more, and 0
    # on the diagonal.
    count = len(excess)
    index = np.arange(count)
    for k in range(count):
        later = jnp.asarray((index > k).astype(excess.dtype))
        pivot = excess[k] + (links[k] * later).sum()
        factor = later * links[:, k] / pivot
        excess = excess + factor * excess[k]
        right = right + factor * right[k]
        links = links + factor[:, None] * (links[k] * later)[None]
        links = links * (1 - jnp.eye(count, dtype=excess.dtype))
    x = jnp.zeros_like(right)
    for k in reversed(range(count)):
        later = jnp.asarray((index > k).astype(excess.dtype))
        pivot = excess[k] + (links[k] * later).sum()
        x = x.at[k].set((right[k] + (links[k] * later * x).sum()) / pivot)
    return x
