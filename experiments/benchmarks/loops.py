"""Time loops of a planned run, and of the same scene in numba, ready to be timed."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numba
import numpy as np

import jaxthermo as jt
from jaxthermo.integrate.run.plan import (
    Plan,
    StepTable,
    step_table,
)
from jaxthermo.integrate.run.simulate import first_loop, run_plan, take_steps
from jaxthermo.integrate.stepper import in_place
from jaxthermo.timing import timed_call

from ..front.linear_body import LinearBody, Run, linear_body
from ..front.numba_loops import explicit_run, rkl2_run


NUMBA = f"numba, {numba.get_num_threads()} threads"
"""Name of the peer; XLA takes the same cores."""


def only_first(table: StepTable, count: int) -> StepTable:
    """So many steps in the first interval of the first save, and no others."""
    none = jnp.zeros_like(table.steps)
    return table._replace(steps=none.at[0, 0].set(count))


def loop_of(plan: Plan, steps: int | None = None) -> Callable[[], Any]:
    """Steps of a plan and the reading of its surface, as one compiled call.

    All of them, or so many of the first length, in a program that is the same for all.
    """
    table = step_table(plan)
    table = table if steps is None else only_first(table, steps)

    def run() -> Any:
        # The loop uses up its state: each call makes one, as a run does.
        loop = first_loop(plan, table)
        return in_place(take_steps, loop.theta)(loop.arguments, loop.theta)

    return run


def numba_explicit(scene: jt.Scene, end: float, save_at=None) -> Run:
    """The explicit loop of a full volume's scene in numba, in its faster layout."""
    body = linear_body(scene, end, save_at)
    return _faster(body, explicit_run)


def numba_rkl2(scene: jt.Scene, end: float, dt: float, save_at=None) -> Run:
    """The same with steps of RKL2 up to `dt` [s]."""
    body = linear_body(scene, end, save_at)
    return _faster(body, lambda body: rkl2_run(body, dt))


def _faster(body: LinearBody, make: Callable[[LinearBody], Run]) -> Run:
    runs = [make(body.with_layout(layout)) for layout in ("compact", "dense")]
    for run in runs:
        run.call()
    return min(runs, key=lambda run: timed_call(run.call)[1])


def largest_difference(plan: Plan, peer: Run) -> float:
    """Largest difference of a plan's surface temperatures from its peer's [K]."""
    surface = np.asarray(run_plan(plan).surface_temperature, float)
    # A run without times to save has saved its end.
    return float(np.abs(surface[-1] - peer.call()[-1]).max())
