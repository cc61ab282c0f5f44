"""Frame of cells around the domain: what walls, inlet and outlet give to the fluid.

Before every step the frame is filled with the populations that enter the fluid from
it; a step then treats all cells alike.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Scalar
from .lattice import (
    MIRRORED,
    OPPOSITE,
    SOUND,
    VELOCITIES,
    WEIGHTS,
    Moments,
    Populations,
    equilibrium,
    moments,
    written,
)


UPWARD = tuple(i for i, (_, y) in enumerate(VELOCITIES) if y > 0)
DOWNWARD = tuple(i for i, (_, y) in enumerate(VELOCITIES) if y < 0)
RIGHTWARD = tuple(i for i, (x, _) in enumerate(VELOCITIES) if x > 0)
LEFTWARD = tuple(i for i, (x, _) in enumerate(VELOCITIES) if x < 0)

# Pressure that the outlet tends to, 0, and how fast: waves as long as the channel and
# longer see a wall of constant pressure, shorter ones pass. Poinsot and Lele (1992)
# recommend 0.25.
_OUTLET_STIFFNESS = 0.1


class Outlet(NamedTuple):
    """Density minus 1, and velocity, in the column behind the outlet."""

    density: Float[Array, "1"]
    x: Float[Array, " y"]
    y: Float[Array, " y"]


def filled_ends(
    f: Populations,
    entering: dict[int, Float[Array, " n"]] | None,
    outlet: Outlet | None = None,
) -> tuple[Populations, Outlet | None]:
    """Populations with the columns that enter at both ends; None for periodic ends.

    The outlet, which is read of the same populations, is passed through.
    """
    last = f[0].shape[1] - 2
    if entering is None:
        changes = {i: ((0, 0), f[i][:, last : last + 1]) for i in RIGHTWARD}
        changes |= {i: ((0, last + 1), f[i][:, 1:2]) for i in LEFTWARD}
    else:
        column = {i: 0 if i in RIGHTWARD else last + 1 for i in entering}
        changes = {i: ((0, column[i]), new[:, None]) for i, new in entering.items()}
    f, read = written(f, changes, outlet or ())
    return f, Outlet(*read) if read else None


def filled_walls(f: Populations, walls: str, ends: str) -> Populations:
    """Populations with the rows beyond the walls; the frame's columns are filled."""
    top = f[0].shape[0] - 2
    changes = {}
    for group, frame, inner, other in (
        (UPWARD, 0, 1, top),
        (DOWNWARD, top + 1, top, 1),
    ):
        for i in group:
            ahead = VELOCITIES[i][0]
            # In the corner the inlet has given its own.
            given = ends == "open" and ahead > 0
            if walls == "periodic":
                row, start = f[i][other : other + 1], 0
            elif walls == "slip":
                row, start = f[MIRRORED[i]][inner : inner + 1, given:], int(given)
            else:
                # What left a cell comes back to it.
                row = f[OPPOSITE[i]][inner : inner + 1, 1 + given : -1]
                start = 1 + given - ahead
            changes[i] = (frame, start), row
    return written(f, changes)[0]


def _beside_inlet(f: Populations, i: int) -> Float[Array, " n"]:
    """Populations opposite to i in the cells that i enters from the inlet's column."""
    rows = f[0].shape[0]
    to = (np.arange(rows) + VELOCITIES[i][1] - 1) % (rows - 2) + 1
    return f[OPPOSITE[i]][:, 1][to]


def inlet(
    f: Populations, speed: Float[Array, ""], profile: Float[Array, " _"]
) -> dict[int, Float[Array, " n"]]:
    """Populations that enter at the inlet: bounced back from a wall that moves in."""
    rows = len(profile)
    found = {}
    for i in RIGHTWARD:
        # The flow that is brought in is then exactly that of the profile.
        to = np.clip(np.arange(rows + 2) - 1 + VELOCITIES[i][1], 0, rows - 1)
        found[i] = _beside_inlet(f, i) + 6 * WEIGHTS[i] * speed * profile[to]
    return found


def tracer_inlet(g: Populations) -> dict[int, Float[Array, " n"]]:
    """Populations of a temperature of 0 at the inlet."""
    return {i: -_beside_inlet(g, i) for i in RIGHTWARD}


def tracer_outlet(g: Populations) -> dict[int, Float[Array, " n"]]:
    """Populations of a temperature without a gradient along x at the outlet."""
    return {i: g[i][:, -2] for i in LEFTWARD}


def first_outlet(speed: Float[Array, ""], profile: Float[Array, " _"]) -> Outlet:
    """The outlet at the start, with the flow of the inlet."""
    u = speed * profile
    return Outlet(jnp.zeros_like(u[:1]), u, jnp.zeros_like(u))


def outlet_step(
    f: Populations, at: Outlet, walls: str, viscosity: Scalar
) -> tuple[Outlet, dict[int, Float[Array, " n"]]]:
    """The outlet a step on, and the populations that enter from it.

    The mean over the column leaves as plane waves do in an unbounded fluid, by
    characteristics along x (Poinsot and Lele 1992; for a lattice Izquierdo and Fueyo
    2008). The incompressible equilibrium has the mass u and the momentum r c^2 + u^2,
    hence with s = sqrt(u^2 + c^2) and the friction F = nu d2u/dy2

        d(u - (u - s) r)/dt = -(u + s) d(u - (u - s) r)/dx + F,    leaving,
        d(u - (u + s) r)/dt = k c r / length,                      entering.

    Deviations from the mean are carried by the flow, du/dt = -u du/dx, at an even
    pressure: a wake or vortex is no wave of sound, and waves oblique enough to vary
    along the column decay on their way where the channel is narrower than their length.
    """
    near, far = (moments(tuple(a[1:-1, column] for a in f)) for column in (-2, -3))
    u = jnp.maximum(at.x, 0)
    mean = at.x.mean()
    root = jnp.sqrt(mean * mean + SOUND**2)
    ahead, back = mean + root, mean - root
    wave = lambda m: m.x.mean() - back * m.density.mean()
    leaving = _arriving(ahead, here=wave(at), near=wave(near), far=wave(far)) - wave(at)
    leaving += viscosity * _curvature(at.x, walls).mean()
    length = f[0].shape[1] - 2
    entering = _OUTLET_STIFFNESS * SOUND / length * at.density.mean()
    change = (leaving - entering) / (ahead - back)
    carried = _arriving(u, here=at.x, near=near.x, far=far.x)
    after = Outlet(
        at.density + change,
        carried + (mean + leaving + back * change - carried.mean()),
        _arriving(u, here=at.y, near=near.y, far=far.y),
    )
    # The deviation from equilibrium is that of the last column of fluid.
    even = jnp.broadcast_to(after.density, after.x.shape)
    here = Moments(even, after.x, after.y)
    column = {
        i: f[i][1:-1, -2] + equilibrium(i, here) - equilibrium(i, near)
        for i in LEFTWARD
    }
    return after, {i: jnp.pad(new, 1, mode="edge") for i, new in column.items()}


def _arriving(speed, here, near, far):
    """Value that arrives in a step at that speed: a parabola through three columns."""
    return (
        here * (1 - speed) * (2 - speed) / 2
        + near * speed * (2 - speed)
        + far * speed * (speed - 1) / 2
    )


def _curvature(u: Float[Array, " y"], walls: str) -> Float[Array, " y"]:
    """Second difference of the velocity along the channel, across it."""
    if walls == "no_slip":
        # Parabolas that vanish on the walls.
        below, above = u[1:2] / 3 - 2 * u[:1], u[-2:-1] / 3 - 2 * u[-1:]
    else:
        below, above = (u[-1:], u[:1]) if walls == "periodic" else (u[:1], u[-1:])
    padded = jnp.concatenate([below, u, above])
    return padded[2:] - 2 * u + padded[:-2]
