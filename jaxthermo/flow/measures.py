"""Numbers of a flow around a cylinder: forces, frequency, wake, heat transfer."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from .body import RoundBody, body_links, link_angles
from .channel import Channel
from .run import FlowRun


_STEADY = 0.01
"""Range of the lift over the drag below which a flow is steady [-]."""


class _Line(NamedTuple):
    """Velocity along x on a line, over the inlet's mean speed."""

    at: Float[np.ndarray, " n"]
    """Distance [diameters]."""
    ratio: Float[np.ndarray, " n"]
    """u / U [-]."""


def _cylinder(channel: Channel) -> RoundBody:
    if not isinstance(channel.body, RoundBody):
        raise TypeError("numbers of a cylinder, of a channel without one")
    return channel.body


def _at_row(values: Float[Any, "y x"], row: float) -> Float[Any, " x"]:
    """Values between two rows of cells, counted from the middle of the first."""
    low = int(np.floor(row))
    fraction = row - low
    return (1 - fraction) * values[low] + fraction * values[low + 1]


def force_coefficient(channel: Channel, force: Any) -> Any:
    """Coefficient 2 F / (U^2 D) of drag or lift, with the mean speed of the inlet."""
    return 2 * force / (channel.speed**2 * _cylinder(channel).diameter)


def strouhal(run: FlowRun) -> float:
    """Number f D / U of the lift's frequency f, over whole periods of the mean's time.

    NaN for a steady flow, or one with fewer than two periods.
    """
    lift = run.lift[run.averaged].astype(float)
    step = run.step[run.averaged]
    if np.ptp(lift) < _STEADY * np.abs(run.drag[run.averaged]).max():
        return float("nan")
    lift = lift - (lift.max() + lift.min()) / 2
    rises = np.flatnonzero((lift[:-1] <= 0) & (lift[1:] > 0))
    if len(rises) < 3:
        return float("nan")
    fraction = -lift[rises] / (lift[rises + 1] - lift[rises])
    times = step[rises] + fraction * (step[rises + 1] - step[rises])
    period = (times[-1] - times[0]) / (len(times) - 1)
    channel = run.channel
    return float(_cylinder(channel).diameter / (period * channel.speed))


def centreline(run: FlowRun) -> _Line:
    """Mean velocity behind the cylinder, by the distance from its rear."""
    channel = run.channel
    body = _cylinder(channel)
    u = _at_row(run.mean.x, body.centre[1] - 0.5)
    x = np.arange(channel.shape[1]) + 0.5 - body.centre[0] - body.diameter / 2
    behind = x > 0
    ratio = np.asarray(u, float)[behind] / float(channel.speed)
    return _Line(x[behind] / body.diameter, ratio)


def across(run: FlowRun, distance: float) -> _Line:
    """Mean velocity across the wake at a distance behind the rear [diameters]."""
    channel = run.channel
    body = _cylinder(channel)
    column = body.centre[0] + (distance + 0.5) * body.diameter - 0.5
    u = _at_row(run.mean.x.T, column)
    y = np.arange(channel.shape[0]) + 0.5 - body.centre[1]
    return _Line(y / body.diameter, np.asarray(u, float) / float(channel.speed))


def recirculation_length(run: FlowRun) -> float:
    """Length of the bubble of reversed mean flow, from the rear [diameters]."""
    line = centreline(run)
    ends = np.flatnonzero((line.ratio[:-1] < 0) & (line.ratio[1:] >= 0))
    if not len(ends):
        return 0.0
    i = int(ends[-1])
    fraction = -line.ratio[i] / (line.ratio[i + 1] - line.ratio[i])
    return float(line.at[i] + fraction * (line.at[i + 1] - line.at[i]))


def pressure_difference(run: FlowRun) -> float:
    """Pressure at the front minus that at the rear, over the square of the speed.

    Extrapolated along the middle from three cells to the surface.
    """
    body = _cylinder(run.channel)
    line = _at_row(run.mean.pressure.astype(float), body.centre[1] - 0.5)
    pressures = []
    for side in (-1, 1):
        surface = body.centre[0] + side * body.diameter / 2 - 0.5
        first = int(np.floor(surface)) if side < 0 else int(np.ceil(surface))
        cells = first + side * np.arange(3)
        curve = np.polyfit((cells - surface).astype(float), line[cells], 2)
        pressures.append(float(curve[-1]))
    return (pressures[0] - pressures[1]) / float(run.channel.speed) ** 2


def mean_nusselt(run: FlowRun) -> float:
    """Mean Nusselt number of the cylinder, over the samples of the mean."""
    if run.channel.diffusivity is None:
        raise TypeError("a Nusselt number, of a flow without temperatures")
    heat = float(run.heat[run.averaged].astype(float).mean())
    return heat / (np.pi * float(run.channel.diffusivity))


def nusselt_shape(run: FlowRun, harmonics: int = 8) -> Float[np.ndarray, " k"]:
    """Coefficients c_k of the local over the mean Nusselt number, 1 + sum c_k cos(k t).

    The angle t is from the front. Heat over the links is projected on the cosines,
    which needs no interpolation next to the surface.
    """
    body = _cylinder(run.channel)
    if run.link_heat is None:
        raise TypeError("a Nusselt number, of a flow without temperatures")
    angle = link_angles(body, body_links(body, run.channel.shape))
    heat = run.link_heat.astype(float)
    k = np.arange(1, harmonics + 1)[:, None, None, None]
    return 2 * (heat * np.cos(k * angle)).sum((1, 2, 3)) / heat.sum()
