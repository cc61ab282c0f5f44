"""Emission at any temperature and step: from the sun's (S06), from near 0 K (S07)."""

from collections.abc import Iterator

import jaxthermo as jt

from .bodies import block
from .case import Case, Row
from .methods import LONG, adaptive, explicit, implicit, too_long
from .solved import Limits, judged, stable_step


AROUND = 300.0
METAL = jt.Material(200.0, density=2700.0, specific_heat=900.0, emissivity=1.0)
EDGE = 1e-3
"""Of a voxel [m]: of a cube that 1 s is long for."""
MOST_NEWTON = 20
STEPS = (1.0, 1e4, 1e8, 1e12)
LIMITS = Limits(
    # Two roundings of 5800 K in float32.
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-11, "float32": 1e-4},
)


def cube(start, dtype: str = "float64", around: float = AROUND) -> jt.Scene:
    """A metal cube in an enclosure.

    Args:
        start: its temperature [K].
        dtype: of the scene.
        around: temperature of the enclosure [K].
    """
    body = jt.Body(jt.FullVolume(block(2, 2, 2, EDGE)), METAL, temperature=start)
    return jt.Scene((body,), (jt.Surroundings(around),), dtype=dtype)


def _from(start: float) -> Iterator[Row]:
    bounds = (min(start, AROUND), max(start, AROUND))
    for dtype in ("float64", "float32"):
        scene = cube(start, dtype)
        stable = stable_step(scene)
        what = f"{start:g} K in {AROUND:g} K"
        methods = [
            *explicit(stable),
            *(m for dt in STEPS for m in implicit(dt, f"{dt:g} s", 1)),
            adaptive(1e3, error=0.1),
        ]
        for method in methods:
            # Newton's steps are counted over all stages: one for backward Euler.
            one = method.name.startswith(("BackwardEuler", "CrankNicolson"))
            most = MOST_NEWTON if one else None
            yield judged(what, scene, method, bounds, LIMITS, most)
        yield too_long(what, scene, LONG)


def from_the_sun() -> Iterator[Row]:
    """S06."""
    return _from(5800.0)


def from_near_zero() -> Iterator[Row]:
    """S07."""
    return _from(1e-3)


CASES = (
    Case(
        "S06",
        "emission from 5800 K into 300 K, steps of 1 to 1e12 s",
        "at most 20 steps of Newton's method; ends within [300, 5800] K",
        "maximum principle; undamped Newton from the hot side takes 14 to 16 steps",
        from_the_sun,
    ),
    Case(
        "S07",
        "emission from 1 mK in 300 K, steps of 1 to 1e12 s",
        "at most 20 steps of Newton's method; ends within [0.001, 300] K",
        "maximum principle; undamped Newton takes 104 steps from there",
        from_near_zero,
    ),
)
