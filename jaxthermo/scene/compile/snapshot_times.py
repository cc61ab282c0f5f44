"""When a scene is taken anew: as often as bodies and sources say that they move.

Between two moments everything stands where it is halfway between them, which is exact
to second order in their distance for whatever moves smoothly.
"""

from ..scene import Scene


SOURCE_SNAPSHOTS = 64
"""How often a source that moves by a plain function of time is taken anew in a run."""


def snapshot_times(scene: Scene, end: float) -> tuple[float, ...]:
    """Increasing times from 0, each the start of a time in which nothing moves [s]."""
    times = {0.0}
    for body in scene.bodies:
        times |= {t for t in body.pose.snapshot_times(end) if 0 < t < end}
    if any(term.moves for term in scene.terms):
        times |= {end * k / SOURCE_SNAPSHOTS for k in range(SOURCE_SNAPSHOTS)}
    return tuple(sorted(times))


def middles(starts: tuple[float, ...], end: float) -> tuple[float, ...]:
    """Halfway from each start to the next one or the end [s]."""
    stops = (*starts[1:], max(end, starts[-1]))
    return tuple((a + b) / 2 for a, b in zip(starts, stops, strict=True))
