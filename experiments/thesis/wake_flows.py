"""The thesis' five flows, computed once for all of its figures of them."""

from functools import cache
from typing import Any, NamedTuple

from jaxthermo.flow.run import FlowRun

from .wake import SETUPS, Setup, Tail, compute_flow, measure_flow, tail_of


THESIS_HEIGHT, HEIGHT, QUICK_HEIGHT = 300, 150, 75
"""Cells across the narrow channel: the thesis', ours, and in the reduced size, where
the cylinder is 10 cells wide: with 9 the fastest flow becomes unstable."""


class WakeFlow(NamedTuple):
    """One flow with what is measured of it."""

    setup: Setup
    run: FlowRun
    tail: Tail
    row: dict[str, Any]


@cache
def wake_flow(setup: Setup, quick: bool) -> WakeFlow:
    """One of the flows, in the reduced size if asked for."""
    run = compute_flow(setup, QUICK_HEIGHT if quick else HEIGHT, None)
    tail = tail_of(setup, run)
    return WakeFlow(setup, run, tail, measure_flow(tail, run))


def narrow_and_wide(quick: bool) -> tuple[WakeFlow, WakeFlow]:
    """The fastest flow in both channels."""
    narrow, wide, *_ = SETUPS
    return wake_flow(narrow, quick), wake_flow(wide, quick)


def four_speeds(quick: bool) -> tuple[WakeFlow, ...]:
    """The flows in the wide channel, the fastest first."""
    return tuple(wake_flow(setup, quick) for setup in SETUPS[1:])


def chosen(quick: bool) -> tuple[tuple[str, str], ...]:
    """Choices that all of these flows share, and that the thesis leaves open."""
    height = QUICK_HEIGHT if quick else HEIGHT
    return (
        ("cells", f"{height} across the narrow channel; the thesis {THESIS_HEIGHT}"),
        ("cylinder", "2/15 of the narrow channel's height, 1/5 from the inlet"),
        (
            "speed and viscosity",
            "speed 1.0 has Re 100 by the undisturbed middle; slower ones in proportion",
        ),
        ("inlet and walls", "a long channel's parabola, no slip; free outlet"),
    )
