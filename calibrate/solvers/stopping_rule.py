"""Choice of a fit's next action: try a step, refresh the Jacobian, or end.

Steps may stop lowering the loss because the Jacobian was corrected from other points
(see `broyden`). The fit then computes it at the best point and continues from there,
until a refresh is no longer worth its cost.
"""

from typing import Any, Literal

import jax.numpy as jnp

from .checkpoint import StepRecord


STAGNATION_LIMIT = 2
"""Trials without progress that end a fit."""
_NEAR = 0.03
"""Length up to which a rejected trial counts; a longer one is shortened first."""


def next_action(
    steps: list[StepRecord], done: bool, size: int, tolerance: float, dtype: Any
) -> Literal["refresh", "try", "end"]:
    """Choose what follows the steps so far.

    Args:
        steps: history.
        done: the solver's own criterion is met.
        size: number of coordinates.
        tolerance: relative change of the loss that is not worth two more trials.
        dtype: whose rounding the loss cannot fall below.
    """
    if not steps:
        return "refresh"
    # What the solver says of a step that went nowhere does not count.
    if steps[-1].refresh:
        return "try"
    stagnant = _is_stagnant(steps, tolerance, dtype)
    ends = stagnant or done
    # The best point before the trials that ask for an end.
    before = steps[: -STAGNATION_LIMIT if stagnant else -1] if ends else steps
    if not (ends or not steps[-1].accepted) or _best_is_exact(before):
        return "end" if ends else "try"
    # A refresh costs about one run per coordinate. It is not worth that, nor the trials
    # after it, where the last one hardly was.
    last_refresh = max(n for n, step in enumerate(steps) if step.refresh)
    gain = _relative_gain(steps[last_refresh:])
    worth = tolerance * (1 + size / STAGNATION_LIMIT)
    return "end" if gain <= worth else "refresh"


def _is_stagnant(steps: list[StepRecord], tolerance: float, dtype: Any) -> bool:
    last = steps[-STAGNATION_LIMIT:]
    if len(steps) <= STAGNATION_LIMIT or any(s.refresh for s in last):
        return False
    if any(not s.accepted and s.length > _NEAR for s in last):
        return False
    # Rounding of a sum over thousands of residuals.
    resolved = max(16 * float(jnp.finfo(dtype).eps), tolerance)
    return _relative_gain(steps[-1 - STAGNATION_LIMIT :]) <= resolved


def _relative_gain(steps: list[StepRecord]) -> float:
    before, now = steps[0].loss, steps[-1].loss
    return (before - now) / before if before > 0 else 0.0


def _best_is_exact(steps: list[StepRecord]) -> bool:
    return next((s.exact for s in reversed(steps) if s.accepted), True)
