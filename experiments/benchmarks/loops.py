"""Time loops of a planned run, and of the same scene in numba, ready to be timed."""

from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numba
import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.integrate.run.plan import (
    Plan,
    StepTable,
    step_table,
)
from jaxthermo.integrate.run.simulate import first_loop, run_plan, take_steps
from jaxthermo.integrate.stepper import in_place
from jaxthermo.timing import Spans, timed_call

from ..front.linear_body import LinearBody, Run, linear_body
from ..front.numba_loops import explicit_run, rkl2_run
from ..harness.measurement import Measurement, compared


NUMBA = f"numba, {numba.get_num_threads()} threads"
"""Name of the peer; XLA takes the same cores."""

_COPY = "copy"


def kernel_rows(
    name: str,
    spans: Spans,
    *,
    bound: float,
    notes: Mapping[str, str],
    slower_forms: Mapping[str, str],
) -> list[Measurement]:
    """Our loops compared with numba's, and the first of them with slower forms.

    Args:
        name: of what is measured.
        spans: times of an item [s], of "numba" and of those named below.
        bound: speed relative to numba that is required.
        notes: on our loops "ours" and "kernels".
        slower_forms: their names, and that of "copy", which no loop is faster than.
    """
    labels = {"ours": name, "kernels": f"{name}, kernels of numba"}
    rows = []
    for form, note in notes.items():
        numba_spans = {NUMBA: spans["numba"]}
        rows += compared(
            name=labels[form],
            ours=spans[form],
            peers=numba_spans,
            bound=bound,
            note=note,
        )
    for form, peer in slower_forms.items():
        peers = {peer: spans[form]}
        rows += compared(
            name=name, ours=spans["ours"], peers=peers, overhead=form == _COPY
        )
    return rows


def per_item(spans: Spans, counts: Mapping[str, int]) -> Spans:
    """Times of an item [s] from those of calls of several items each."""
    return {
        name: [span / count for span in spans[name]] for name, count in counts.items()
    }


def _only_first(table: StepTable, count: int) -> StepTable:
    """So many steps in the first interval of the first save, and no others."""
    none = jnp.zeros_like(table.steps)
    return table._replace(steps=none.at[0, 0].set(count))


def loop_of(plan: Plan, steps: int | None = None) -> Callable[[], Any]:
    """Steps of a plan and the reading of its surface, as one compiled call.

    All of them, or a number of the first length, in a program that is the same for all.
    """
    table = step_table(plan)
    table = table if steps is None else _only_first(table, steps)

    def run() -> Any:
        # The loop uses up its state: each call makes one, as a run does.
        loop = first_loop(plan, table)
        return in_place(take_steps, loop.theta)(loop.arguments, loop.theta)

    return run


def numba_explicit(scene: jt.Scene, end: float, save_at=None) -> Run:
    """The explicit loop of a full volume's scene in numba, in its faster layout."""
    body = linear_body(scene, end, save_at)
    return _faster(body, explicit_run)


def numba_rkl2(scene: jt.Scene, end: float, dt: float) -> Run:
    """The same with steps of RKL2 up to `dt` [s]."""
    body = linear_body(scene, end)
    return _faster(body, lambda body: rkl2_run(body, dt))


def _faster(body: LinearBody, make: Callable[[LinearBody], Run]) -> Run:
    runs = [make(body.with_layout(layout)) for layout in ("compact", "dense")]
    for run in runs:
        run.call()
    return min(runs, key=lambda run: timed_call(run.call)[1])


def last_surface(plan: Plan) -> Float[np.ndarray, " s"]:
    """Surface temperatures at the end of a plan [K]."""
    return np.asarray(run_plan(plan).surface_temperature[-1], float)
