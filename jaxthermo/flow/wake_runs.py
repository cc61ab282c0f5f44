"""Mean flows behind one cylinder at several Reynolds numbers: what wakes are fitted to.

The cylinder stands in a wide channel with slip walls, which at these widths is nearly
unbounded. Up to Re 40 the flow is steady; above about 47 it sheds vortices, and the
mean over whole periods counts. Above Re 190 a real wake is three-dimensional.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..atomic import write_text
from .body import RoundBody
from .channel import Channel
from .flow import FlowProgram, FlowState, initial_state
from .measures import across, centreline
from .run import FlowProgress, FlowRun, simulate_flow


PRANDTL = 0.71
STEADY_REYNOLDS = (10.0, 20.0, 40.0)
SHEDDING_REYNOLDS = (60.0, 80.0, 100.0, 150.0)

# Mach number 0.14, with a cylinder's speed-up below 0.25.
_SPEED = 0.08

_ALONG = np.concatenate(
    [np.arange(0.1, 1.0, 0.1), np.arange(1.0, 5.0, 0.25), np.arange(5.0, 20.5, 0.5)]
)
_STATIONS = (1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0)
_ACROSS = np.arange(0.0, 4.01, 0.2)


class WakeSetup(NamedTuple):
    """Size of a run in diameters, cells across the cylinder, and how long it takes."""

    cells: int
    height: float
    upstream: float
    downstream: float
    passes: float
    """Duration, in times that the inlet's flow takes from end to end."""


_STEADY_SETUP = WakeSetup(
    cells=16, height=60.0, upstream=18.0, downstream=15.0, passes=4.0
)
_SHEDDING_SETUP = WakeSetup(
    cells=16, height=40.0, upstream=14.0, downstream=22.0, passes=6.0
)
_HEATED_SETUP = WakeSetup(
    cells=16, height=30.0, upstream=10.0, downstream=8.0, passes=6.0
)
"""For the heat transfer, which needs no long wake."""


class WakeProfile(NamedTuple):
    """Mean velocity u / U behind a cylinder at points (x, y) in diameters."""

    reynolds: float
    x: Float[np.ndarray, " n"]
    """From the rear [diameters]."""
    y: Float[np.ndarray, " n"]
    """From the middle [diameters]."""
    ratio: Float[np.ndarray, " n"]


def wake_channel(reynolds: float, setup: WakeSetup, heated: bool = False) -> Channel:
    """The channel of a run."""
    cells = setup.cells
    height = round(setup.height * cells)
    length = round((setup.upstream + setup.downstream) * cells)
    viscosity = _SPEED * cells / reynolds
    return Channel(
        (height, length),
        speed=_SPEED,
        viscosity=viscosity,
        body=RoundBody((setup.upstream * cells, height / 2), float(cells)),
        walls="slip",
        diffusivity=viscosity / PRANDTL if heated else None,
    )


def disturbed_state(program: FlowProgram) -> FlowState:
    """Inlet's flow with a puff to one side: a wake would stay symmetric for long."""
    height, length = program.shape
    y, x = np.indices(program.shape) / height - 0.5
    x = x + 0.5 - 0.5 * length / height
    puff = 0.2 * np.exp(-40 * (x * x + y * y))
    along = (
        program.speed
        * program.profile[:, None]
        * jnp.ones((1, length), program.speed.dtype)
    )
    across = program.speed * jnp.asarray(puff, along.dtype)
    return initial_state(program, (along, across))


def wake_setup(
    reynolds: float, cells: int | None = None, heated: bool = False
) -> WakeSetup:
    """Set-up of the flow at a Reynolds number; `cells` is None for its own lattice."""
    sheds = reynolds > max(STEADY_REYNOLDS)
    setup = _SHEDDING_SETUP if sheds else _STEADY_SETUP
    setup = _HEATED_SETUP if heated else setup
    return setup if cells is None else setup._replace(cells=cells)


def wake_run(
    reynolds: float,
    setup: WakeSetup | None = None,
    heated: bool = False,
    progress: Callable[[FlowProgress], None] | None = None,
) -> FlowRun:
    """The run at a Reynolds number, with temperatures if `heated`."""
    setup = setup or wake_setup(reynolds, heated=heated)
    channel = wake_channel(reynolds, setup, heated)
    sheds = reynolds > max(STEADY_REYNOLDS)
    return simulate_flow(
        channel,
        round(setup.passes * channel.shape[1] / _SPEED),
        average_from=0.5 if sheds else 0.9,
        start=disturbed_state if sheds else initial_state,
        progress=progress,
    )


def wake_profile(run: FlowRun, reynolds: float) -> WakeProfile:
    """Mean velocity of a run along the middle and across, both halves averaged."""
    line = centreline(run)
    # Points close to the outlet are not used.
    last = line.at[-1] - 3.0
    along = _ALONG[(last > _ALONG) & (line.at[0] <= _ALONG)]
    pieces = [(along, 0 * along, np.interp(along, line.at, line.ratio))]
    for distance in (at for at in _STATIONS if at < last):
        line_across = across(run, distance)
        inside = _ACROSS[line_across.at[-1] > _ACROSS]
        sides = [
            np.interp(s * inside, line_across.at, line_across.ratio) for s in (1, -1)
        ]
        pieces.append((distance + 0 * inside, inside, np.mean(sides, axis=0)))
    x, y, ratio = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return WakeProfile(reynolds=reynolds, x=x, y=y, ratio=ratio)


def write_profiles(path: Path, profiles: Iterable[WakeProfile]) -> None:
    """Write profiles as a CSV file."""
    lines = ["Re,x_over_D_from_rear,y_over_D,u_over_U"]
    for profile in profiles:
        for x, y, ratio in zip(profile.x, profile.y, profile.ratio, strict=True):
            lines.append(f"{profile.reynolds:g},{x:.4g},{y:.4g},{ratio:.5f}")
    write_text(path, "\n".join(lines) + "\n")
