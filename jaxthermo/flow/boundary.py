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


_UPWARD = tuple(i for i, (_, y) in enumerate(VELOCITIES) if y > 0)
_DOWNWARD = tuple(i for i, (_, y) in enumerate(VELOCITIES) if y < 0)
_RIGHTWARD = tuple(i for i, (x, _) in enumerate(VELOCITIES) if x > 0)
_LEFTWARD = tuple(i for i, (x, _) in enumerate(VELOCITIES) if x < 0)

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
    """Populations with the columns that enter at both ends.

    `entering` is None for periodic ends. The outlet, which is read from the same
    populations, is passed through.
    """
    last = f[0].shape[1] - 2
    if entering is None:
        changes = {i: ((0, 0), f[i][:, last : last + 1]) for i in _RIGHTWARD}
        changes |= {i: ((0, last + 1), f[i][:, 1:2]) for i in _LEFTWARD}
    else:
        column = {i: 0 if i in _RIGHTWARD else last + 1 for i in entering}
        changes = {i: ((0, column[i]), new[:, None]) for i, new in entering.items()}
    f, read = written(f, changes, outlet or ())
    return f, Outlet(*read) if read else None


def filled_walls(f: Populations, walls: str, ends: str) -> Populations:
    """Populations with the rows beyond the walls; the frame's columns are filled."""
    top = f[0].shape[0] - 2
    changes = {}
    for group, frame, inner, opposite in (
        (_UPWARD, 0, 1, top),
        (_DOWNWARD, top + 1, top, 1),
    ):
        for i in group:
            ahead = VELOCITIES[i][0]
            # In the corner the populations are those of the inlet.
            is_from_inlet = ends == "open" and ahead > 0
            if walls == "periodic":
                row = f[i][opposite : opposite + 1]
                start = 0
            elif walls == "slip":
                row = f[MIRRORED[i]][inner : inner + 1, is_from_inlet:]
                start = int(is_from_inlet)
            else:
                # What left a cell comes back to it.
                row = f[OPPOSITE[i]][inner : inner + 1, 1 + is_from_inlet : -1]
                start = 1 + is_from_inlet - ahead
            changes[i] = ((frame, start), row)
    return written(f, changes)[0]


def _next_to_inlet(f: Populations, i: int) -> Float[Array, " n"]:
    """Populations opposite to i in the cells that i enters from the inlet's column."""
    rows = f[0].shape[0]
    to = (np.arange(rows) + VELOCITIES[i][1] - 1) % (rows - 2) + 1
    return f[OPPOSITE[i]][:, 1][to]


def inlet(
    f: Populations, speed: Float[Array, ""], profile: Float[Array, " _"]
) -> dict[int, Float[Array, " n"]]:
    """Populations that enter at the inlet: bounced back from a wall that moves in."""
    rows = len(profile)
    entering = {}
    for i in _RIGHTWARD:
        # The flow that enters is then exactly that of the profile.
        to = np.clip(np.arange(rows + 2) - 1 + VELOCITIES[i][1], 0, rows - 1)
        entering[i] = _next_to_inlet(f, i) + 6 * WEIGHTS[i] * speed * profile[to]
    return entering


def tracer_inlet(g: Populations) -> dict[int, Float[Array, " n"]]:
    """Populations of a temperature of 0 at the inlet."""
    return {i: -_next_to_inlet(g, i) for i in _RIGHTWARD}


def tracer_outlet(g: Populations) -> dict[int, Float[Array, " n"]]:
    """Populations of a temperature without a gradient along x at the outlet."""
    return {i: g[i][:, -2] for i in _LEFTWARD}


def first_outlet(speed: Float[Array, ""], profile: Float[Array, " _"]) -> Outlet:
    """The outlet at the start, with the flow of the inlet."""
    u = speed * profile
    return Outlet(jnp.zeros_like(u[:1]), u, jnp.zeros_like(u))


def outlet_step(
    f: Populations, at: Outlet, walls: str, viscosity: Scalar
) -> tuple[Outlet, dict[int, Float[Array, " n"]]]:
    """The outlet after a step, and the populations that enter from it.

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
    near = moments(tuple(a[1:-1, -2] for a in f))
    far = moments(tuple(a[1:-1, -3] for a in f))
    u = jnp.maximum(at.x, 0)
    mean = at.x.mean()
    root = jnp.sqrt(mean * mean + SOUND**2)
    ahead = mean + root
    back = mean - root

    def wave(m: Moments | Outlet) -> Float[Array, ""]:
        return m.x.mean() - back * m.density.mean()

    leaving = _arriving(ahead, value=wave(at), near=wave(near), far=wave(far)) - wave(
        at
    )
    leaving += viscosity * _curvature(at.x, walls).mean()
    length = f[0].shape[1] - 2
    entering = _OUTLET_STIFFNESS * SOUND / length * at.density.mean()
    change = (leaving - entering) / (ahead - back)
    carried = _arriving(u, value=at.x, near=near.x, far=far.x)
    next_outlet = Outlet(
        at.density + change,
        carried + (mean + leaving + back * change - carried.mean()),
        _arriving(u, value=at.y, near=near.y, far=far.y),
    )
    # The deviation from equilibrium is that of the last column of fluid.
    even = jnp.broadcast_to(next_outlet.density, next_outlet.x.shape)
    next_moments = Moments(even, next_outlet.x, next_outlet.y)
    column = {
        i: f[i][1:-1, -2] + equilibrium(i, next_moments) - equilibrium(i, near)
        for i in _LEFTWARD
    }
    return next_outlet, {i: jnp.pad(new, 1, mode="edge") for i, new in column.items()}


def _arriving(speed, value, near, far):
    """Value that arrives in a step at that speed: a parabola through three columns."""
    return (
        value * (1 - speed) * (2 - speed) / 2
        + near * speed * (2 - speed)
        + far * speed * (speed - 1) / 2
    )


def _curvature(u: Float[Array, " y"], walls: str) -> Float[Array, " y"]:
    """Second difference of the velocity along the channel, across it."""
    if walls == "no_slip":
        # Parabolas that vanish on the walls.
        below = u[1:2] / 3 - 2 * u[:1]
        above = u[-2:-1] / 3 - 2 * u[-1:]
    elif walls == "periodic":
        below = u[-1:]
        above = u[:1]
    else:
        below = u[:1]
        above = u[-1:]
    padded = jnp.concatenate([below, u, above])
    return padded[2:] - 2 * u + padded[:-2]
