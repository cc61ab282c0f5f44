"""What a fit does next: try on, find its derivatives anew where it is, or end.

Where steps no longer lower the loss, that may be by derivatives that were kept from
points before (see `secant`). So a fit then looks, where it is, and tries on from there,
until a look is no longer worth what it costs.
"""

from typing import Any, Literal

import jax.numpy as jnp

from .checkpoint import Step


STILL, NEAR = 2, 0.03
"""Trials without progress that end a fit: no more is to be had in this precision. One
that was refused counts if it was as near as this, in free numbers: a search that tried
too far goes back first."""


def next_of(
    steps: list[Step], done: bool, size: int, tolerance: float, dtype: Any
) -> Literal["look", "try", "end"]:
    """What comes after some steps.

    Args:
        steps: so far.
        done: whether the solver asks for no more.
        size: how many free numbers there are.
        tolerance: of the loss, relative: a change that is not worth two more trials.
        dtype: whose rounding the loss cannot get below.
    """
    if not steps:
        return "look"
    if steps[-1].look:
        return "try"
    still = settled(steps, tolerance, dtype)
    ends = still or done
    base = steps[: -STILL if still else -1] if ends else steps
    doubts = (ends or not steps[-1].accepted) and not _held_fresh(base)
    if not doubts:
        return "end" if ends else "try"
    # Another look costs about a run for each number. It is not worth that, nor what
    # may come of it, where the last one hardly was.
    gained = _gained(steps[_last_look(steps) :])
    return "end" if gained <= tolerance * (1 + size / STILL) else "look"


def settled(steps: list[Step], tolerance: float, dtype: Any) -> bool:
    """Whether trials no longer change the loss.

    Args:
        steps: so far.
        tolerance: relative, of the loss.
        dtype: whose rounding they cannot get below.
    """
    last = steps[-STILL:]
    if len(steps) <= STILL or any(s.look for s in last):
        return False
    if any(not s.accepted and s.reach > NEAR for s in last):
        return False
    least = max(16 * float(jnp.finfo(dtype).eps), tolerance)
    return _gained(steps[-1 - STILL :]) <= least


def _gained(steps: list[Step]) -> float:
    """What the first one's loss fell by, relative."""
    before, now = steps[0].loss, steps[-1].loss
    return (before - now) / before if before > 0 else 0.0


def _last_look(steps: list[Step]) -> int:
    return max(n for n, step in enumerate(steps) if step.look)


def _held_fresh(steps: list[Step]) -> bool:
    """Whether the derivatives at the best point were found there."""
    return next((s.fresh for s in reversed(steps) if s.accepted), True)
