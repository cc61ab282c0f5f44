"""What a fit does next: try on, find its derivatives anew where it is, or end.

Where steps no longer lower the loss, that may be by derivatives that were kept from
points before (see `secant`). So no fit ends by those: it first looks, where it is.
"""

from typing import Any, Literal

import jax.numpy as jnp

from .progress import Step


STILL, NEAR = 2, 0.03
"""Trials without progress that end a fit: no more is to be had in this precision. One
that was refused counts if it was as near as this, in free numbers: a search that tried
too far goes back first."""


def next_of(
    steps: list[Step], done: bool, tolerance: float, dtype: Any
) -> Literal["look", "try", "end"]:
    """What comes after some steps.

    Args:
        steps: so far.
        done: whether the solver asks for no more.
        tolerance: relative, of the loss.
        dtype: whose rounding the loss cannot get below.
    """
    if not steps:
        return "look"
    if steps[-1].look:
        return "try"
    still = settled(steps, tolerance, dtype)
    if still or done:
        return "end" if _held_fresh(steps[: -STILL if still else -1]) else "look"
    refused = not steps[-1].accepted
    return "look" if refused and not _held_fresh(steps) else "try"


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
    before, now = steps[-1 - STILL].loss, steps[-1].loss
    return before - now <= max(16 * float(jnp.finfo(dtype).eps), tolerance) * before


def _held_fresh(steps: list[Step]) -> bool:
    """Whether the derivatives at the best point were found there."""
    return next((s.fresh for s in reversed(steps) if s.accepted), True)
