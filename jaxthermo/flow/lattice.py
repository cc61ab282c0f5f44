"""Lattice of nine velocities (D2Q9) and the collision with two relaxation times.

Quantities are in lattice units: lengths in cells, times in steps, the density 1 and the
speed of sound 1 / sqrt(3). The equilibrium is the incompressible one (He and Luo 1997),

    e_i = w_i (r + 3 c_i.u + 9/2 (c_i.u)^2 - 3/2 u.u),
    r = sum f_i,    u = sum c_i f_i,

so that a steady flow has no error of compressibility. Populations are kept as their
deviation from the weights w_i, those of air at rest: r is the density minus 1 and the
pressure is r / 3. In float32 this is worth three digits.

The symmetric and antisymmetric parts of opposite populations relax at different rates
(Ginzburg 2005): the viscosity determines the first, the "magic" product of both
L = (1 / s - 1/2)(1 / a - 1/2) the second. At L = 3/16 the wall of a straight channel
lies exactly half-way between cells, whatever the viscosity.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..arrays import EXACT, Scalar


VELOCITIES = (
    (0, 0),
    (1, 0),
    (0, 1),
    (-1, 0),
    (0, -1),
    (1, 1),
    (-1, 1),
    (-1, -1),
    (1, -1),
)
"""Velocities c_i as (x, y) [cells per step]."""

WEIGHTS = (4 / 9, *[1 / 9] * 4, *[1 / 36] * 4)
OPPOSITE = (0, 3, 4, 1, 2, 7, 8, 5, 6)
MIRRORED = (0, 1, 4, 3, 2, 8, 7, 6, 5)
"""Index of the velocity with the opposite component across the channel."""

SOUND = 3**-0.5
"""Speed of sound [cells per step]."""

MAGIC = 3 / 16
"""Product L of the relaxation times at which straight walls are exact."""

Populations = tuple[Float[Array, "..."], ...]
"""One array for each velocity, with a frame of one cell around the domain."""


class Moments(NamedTuple):
    """Density minus 1, and velocity [cells per step]; of a tracer, value and flux."""

    density: Float[Array, "..."]
    x: Float[Array, "..."]
    y: Float[Array, "..."]


class Rates(NamedTuple):
    """Fractions of the symmetric and antisymmetric deviations that a step removes."""

    symmetric: Scalar
    antisymmetric: Scalar


def flow_rates(viscosity: Scalar, magic: float) -> Rates:
    """Rates of a fluid: its viscosity [cells^2 per step] decides the symmetric one."""
    return Rates(1 / (3 * viscosity + 0.5), 1 / (magic / (3 * viscosity) + 0.5))


def tracer_rates(diffusivity: Scalar, magic: float) -> Rates:
    """Rates of a temperature, whose diffusivity decides the antisymmetric one."""
    return Rates(1 / (magic / (3 * diffusivity) + 0.5), 1 / (3 * diffusivity + 0.5))


def moments(f: Populations) -> Moments:
    """Moments of populations: sums over all, and over those to each side."""
    right = f[5] + f[8]
    left = f[6] + f[7]
    up = f[5] + f[6]
    down = f[7] + f[8]
    density = f[0] + (f[1] + f[2]) + (f[3] + f[4]) + (right + left)
    return Moments(density, (f[1] - f[3]) + (right - left), (f[2] - f[4]) + (up - down))


def _along(velocity: tuple[int, int], m: Moments) -> Float[Array, "..."]:
    """Product c.u for a lattice velocity."""
    # Sums only: XLA would multiply by 1 and -1.
    terms = [
        value if sign > 0 else -value
        for sign, value in zip(velocity, (m.x, m.y), strict=True)
        if sign
    ]
    return sum(terms[1:], terms[0]) if terms else jnp.zeros_like(m.x)


def equilibrium(i: int, m: Moments) -> Float[Array, "..."]:
    """Equilibrium of one population, as the deviation from its weight."""
    c = _along(VELOCITIES[i], m)
    return WEIGHTS[i] * (
        m.density + 3 * c + 4.5 * c * c - 1.5 * (m.x * m.x + m.y * m.y)
    )


def equilibria(m: Moments) -> Populations:
    """Equilibrium of all populations."""
    return tuple(equilibrium(i, m) for i in range(9))


def collided(
    f: Populations, rates: Rates, force: tuple[Scalar, Scalar] | None = None
) -> Populations:
    """Populations after a collision; a force on the fluid is per cell and step.

    With a force the velocity is sum c_i f_i + F / 2 (Guo, Zheng and Shi 2002).
    """
    m = moments(f)
    if force is not None:
        m = Moments(m.density, m.x + force[0] / 2, m.y + force[1] / 2)
    base = m.density - 1.5 * (m.x * m.x + m.y * m.y)
    return _relaxed(f, base=base, m=m, rates=rates, force=force)


def collided_tracer(g: Populations, velocity: Moments, rates: Rates) -> Populations:
    """Populations of a temperature after a collision in a given flow.

    The equilibrium is T e_i with e_i of unit density: a numerical diffusivity of the
    order of the velocity squared is absent.
    """
    # Otherwise XLA would compute them again for every population.
    velocity = Moments(*map(_computed_once, velocity))
    total = _computed_once(sum(g[1:], g[0]))
    flux = Moments(total, total * velocity.x, total * velocity.y)
    base = total - 1.5 * (velocity.x * flux.x + velocity.y * flux.y)
    out: list = [None] * 9
    out[0] = g[0] + rates.symmetric * (WEIGHTS[0] * base - g[0])
    for i in (1, 2, 5, 6):
        c = _along(VELOCITIES[i], flux)
        w = WEIGHTS[i]
        even = w * (base + 4.5 * c * _along(VELOCITIES[i], velocity))
        out[i], out[OPPOSITE[i]] = _pair(
            g[i], backward=g[OPPOSITE[i]], even=even, odd=3 * w * c, rates=rates
        )
    return tuple(out)


def _relaxed(f, base, m: Moments, rates: Rates, force) -> Populations:
    out: list = [None] * 9
    out[0] = f[0] + rates.symmetric * (WEIGHTS[0] * base - f[0])
    for i in (1, 2, 5, 6):
        c = _along(VELOCITIES[i], m)
        w = WEIGHTS[i]
        even = w * (base + 4.5 * c * c)
        odd = 3 * w * c
        forward, backward = _pair(
            f[i], backward=f[OPPOSITE[i]], even=even, odd=odd, rates=rates
        )
        if force is not None:
            x, y = VELOCITIES[i]
            push = 3 * w * (1 - rates.antisymmetric / 2) * (x * force[0] + y * force[1])
            forward = forward + push
            backward = backward - push
        out[i] = forward
        out[OPPOSITE[i]] = backward
    return tuple(out)


def _pair(forward, backward, even, odd, rates: Rates):
    """Two opposite populations relaxed to even +- odd."""
    symmetric = rates.symmetric * (even - 0.5 * (forward + backward))
    antisymmetric = rates.antisymmetric * (odd - 0.5 * (forward - backward))
    return forward + (symmetric + antisymmetric), backward + (symmetric - antisymmetric)


Changes = dict[int, tuple[tuple[int, int], Float[Array, "_ _"]]]
"""Pieces of populations to write: by velocity, the corner and the values."""


def written(
    f: Populations, changes: Changes, read: tuple[Float[Array, "_"], ...] = ()
) -> tuple[Populations, tuple[Float[Array, "_"], ...]]:
    """Populations with pieces written, in place inside of a compiled loop.

    `read` are values that were read from the populations before; they are passed
    through.
    """
    # An array is written in place only where all that reads it comes before, as far as
    # XLA can tell. Here every piece is a part of one vector, and the division by 1
    # keeps XLA from taking that apart. Otherwise every step copies all arrays.
    pieces = [values for _, values in changes.values()]
    vector = jnp.concatenate([values.ravel() for values in (*pieces, *read)])
    vector = vector / lax.optimization_barrier(jnp.ones_like(vector))
    ends = np.cumsum([values.size for values in (*pieces, *read)])
    pieces_written = jnp.split(vector, ends[:-1].tolist())
    out = list(f)
    for (i, (corner, values)), piece_written in zip(
        changes.items(), pieces_written, strict=False
    ):
        piece = piece_written.reshape(values.shape)
        out[i] = lax.dynamic_update_slice(out[i], piece, corner)
    return tuple(out), tuple(pieces_written[len(pieces) :])


def _computed_once(values: Float[Array, "y x"]) -> Float[Array, "y x"]:
    # As in `written`: a division is too costly to be repeated in every loop that reads.
    return values / lax.optimization_barrier(jnp.ones_like(values[:1]))


def textbook_step(
    f: Float[Array, "9 y x"], rates: Rates, force: tuple[Scalar, Scalar] | None = None
) -> Float[Array, "9 y x"]:
    """One step in a periodic box as textbooks write it: the reference of tests."""
    moved = [jnp.roll(f[i], (y, x), axis=(0, 1)) for i, (x, y) in enumerate(VELOCITIES)]
    c = np.asarray(VELOCITIES, f.dtype)
    w = np.asarray(WEIGHTS, f.dtype)
    f = jnp.stack(moved)
    push = jnp.zeros(2, f.dtype) if force is None else jnp.asarray(force, f.dtype)
    u = jnp.einsum("ia,iyx->ayx", c, f, precision=EXACT) + push[:, None, None] / 2
    cu = jnp.einsum("ia,ayx->iyx", c, u, precision=EXACT)
    square = (u * u).sum(0)
    common = f.sum(0) - 1.5 * square
    e = w[:, None, None] * (common[None] + 3 * cu + 4.5 * cu**2)
    back = np.asarray(OPPOSITE)
    deviation = f - e
    even = (deviation + deviation[back]) / 2
    odd = (deviation - deviation[back]) / 2
    kick = 3 * w * (1 - rates.antisymmetric / 2) * (c @ push)
    return f - rates.symmetric * even - rates.antisymmetric * odd + kick[:, None, None]
