"""Flows that several tests share."""

import functools

from jaxthermo.flow.body import RoundBody
from jaxthermo.flow.channel import Channel
from jaxthermo.flow.run import simulate_flow


def schaefer_turek(diameter, reynolds, speed):
    """The benchmark's channel: 2.2 x 0.41 m, a cylinder of 0.1 m at (0.2, 0.2) m."""
    return Channel(
        (round(4.1 * diameter), 22 * diameter),
        speed=speed,
        viscosity=speed * diameter / reynolds,
        body=RoundBody((2.0 * diameter, 2.0 * diameter), float(diameter)),
        inlet="poiseuille",
        walls="no_slip",
    )


@functools.cache
def small_steady():
    """2D-1 with 20 cells across the cylinder, and the progress that it reports."""
    channel = schaefer_turek(20, 20.0, 0.05)
    seen = []
    run = simulate_flow(channel, 9000, average_from=0.9, progress=seen.append)
    return run, seen
