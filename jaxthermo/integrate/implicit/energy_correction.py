"""Heat that bodies hold and heat that was brought to them, made one to the last digit.

States and the heat of the mechanisms are found apart. They differ by what the solve
left over, and by rounding of the rates, which a long step multiplies. So every body b
is made lambda_b warmer than was found, and every mechanism brings what it then would,
which is the step's own balance with one temperature a body:

    (C_b + g sum_e s_e) lambda_b - g sum_{e to c} s_e lambda_c = missing_b,

s_e the slopes of loads and contacts [W/K], g the step of the last stage. What a solve
leaves is given in kelvin, and no lambda is larger: the maximum principle is kept as far
as the solve keeps it. Nodes that have not moved at all stay as they are.
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
    """States that hold exactly the heat that was brought, and that heat [J].

    Args:
        program: of the scene.
        before: the states at the start of the step.
        after: as found.
        heat: that each entry of the ledger brought, as found [J].
        g: step of the last stage [s].
        time: of its loads [s].
    """
    own, pairs = jax.lax.stop_gradient(_slopes(program, after, time))
    capacity = [body.network.capacity() for body in program.bodies]
    went = jax.tree.map(jnp.subtract, after, before)
    moving = tuple((each != 0).astype(heat.dtype) for each in went)
    excess = lambda heat, states: (
        _brought(program, heat)
        - jnp.stack(
            [
                precise_sum(c * (new - old))
                for c, new, old in zip(capacity, states, before, strict=True)
            ]
        )
    )
    holding = jnp.stack(
        [precise_sum(c * m) for c, m in zip(capacity, moving, strict=True)]
    )
    total = jnp.stack([body.network.total_capacity() for body in program.bodies])
    # Where nothing moved, nothing will; it must not be divided by.
    holding = jnp.where(holding > 0, holding, total)
    shed, links = _by_body(program, own, pairs)
    warmer = solve_dominant(holding + g * shed, g * links, excess(heat, after))
    heat = heat - g * _response(program, own, pairs, warmer)
    found = tuple(
        new + extra * m for new, extra, m in zip(after, warmer, moving, strict=True)
    )
    # What is rounding by now, loads take that go by temperature at all.
    left = excess(heat, found) * inverse(shed)
    return found, heat - _response(program, own, 0 * pairs, left)


def _brought(program: Program, heat: Float[Array, " c"]) -> Float[Array, " b"]:
    return into_bodies(heat, program.entries, len(program.bodies))


def _by_body(
    program: Program, own: Float[Array, " c"], pairs: Float[Array, " c"]
) -> tuple[Float[Array, " b"], Float[Array, "b b"]]:
    """Slopes of what each body sheds, and of what passes between two [W/K]."""
    bodies = len(program.bodies)
    shed = jnp.zeros(bodies, own.dtype)
    links = jnp.zeros((bodies, bodies), own.dtype)
    for n, entry in enumerate(program.entries):
        if entry.other is None:
            shed = shed.at[entry.body].add(own[n])
        else:
            links = links.at[entry.body, entry.other].add(pairs[n])
    return shed, links + links.T


def _response(program, own, pairs, warmer) -> Float[Array, " c"]:
    """What the entries bring less for bodies so much warmer [W]."""
    each = [
        own[n] * warmer[entry.body]
        if entry.other is None
        else pairs[n] * (warmer[entry.other] - warmer[entry.body])
        for n, entry in enumerate(program.entries)
    ]
    return jnp.stack(each) if each else jnp.zeros(0, warmer.dtype)


def _slopes(
    program: Program, states: State, time: Float[Array, ""]
) -> tuple[Float[Array, " c"], Float[Array, " c"]]:
    """-d(entry)/d(state) of loads on one body, and of contacts [W/K], 0 or more."""
    own = load_slopes(program, states, time).entries
    pairs = jnp.zeros_like(own)
    zero = jnp.zeros((), own.dtype)
    for contact in program.contacts:
        one = jnp.ones_like(contact.area)
        flow = contact.heat_rate(time, (one, 0 * one), (zero, zero))
        pairs = pairs.at[contact.entry].set(precise_sum(flow))
    return own, pairs


def solve_dominant(
    excess: Float[Array, " b"], links: Float[Array, "b b"], right: Float[Array, " b"]
) -> Float[Array, " b"]:
    """The solution of (excess_i + sum_j links_ij) x_i - sum_j links_ij x_j = right_i.

    Gauss's elimination without a subtraction: diagonals are kept as what they exceed
    their rows by, so that links however strong lose no digit.

    Args:
        excess: positive.
        links: symmetric, 0 or more, with 0 on the diagonal.
        right: the right-hand side.

    Source: Grassmann, Taksar, Heyman, Operations Research 33 (1985) 1107-1116.
    """
    count = len(excess)
    later = np.arange(count)
    for k in range(count):
        after = jnp.asarray((later > k).astype(excess.dtype))
        pivot = excess[k] + (links[k] * after).sum()
        factor = after * links[:, k] / pivot
        excess = excess + factor * excess[k]
        right = right + factor * right[k]
        grown = links + factor[:, None] * (links[k] * after)[None]
        links = grown * (1 - jnp.eye(count, dtype=excess.dtype))
    found = jnp.zeros_like(right)
    for k in reversed(range(count)):
        after = jnp.asarray((later > k).astype(excess.dtype))
        pivot = excess[k] + (links[k] * after).sum()
        found = found.at[k].set((right[k] + (links[k] * after * found).sum()) / pivot)
    return found
