"""One scene by one solver: bounds at every node, energy, effort and time."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.integrate.implicit.jacobian import LINEAR_TOLERANCE
from jaxthermo.integrate.run.plan import (
    initial_state,
    plan_run,
    save_intervals,
    step_table,
)
from jaxthermo.integrate.run.simulate import make_solution, take_steps_jit
from jaxthermo.integrate.run.solution import result_name
from jaxthermo.integrate.solvers import AbstractSolver

from ..harness.case import PASS, REPORTED, Bound, Row, broken


Bounds = tuple[float, float]
"""Between which the maximum principle holds every temperature [K]."""


class Limits(NamedTuple):
    """Limits by the dtype of a scene."""

    overshoot: dict[str, float]
    """[K]"""
    energy: dict[str, float]
    """Largest energy residual over the heat that moved [-], by dtype."""


LIMITS = Limits(
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-12, "float32": 1e-4},
)
"""Measured on a chain of 200 alternating cells at Fo up to 1e6, and rounded up."""


class Method(NamedTuple):
    """A solver and the end of its run."""

    name: str
    solver: AbstractSolver
    end: float
    """[s]"""
    bounds: str = "kept"
    """`kept` to rounding, `bounded` by the range of the data, or `reported`."""


class _Ran(NamedTuple):
    """A run with the temperatures of its nodes."""

    solution: jt.Solution
    nodes: tuple[np.ndarray, ...]
    """Temperatures of every body's at the end [K]."""
    compile_s: float
    run_s: float

    @property
    def result(self) -> str:
        """Name of its `RESULTS`."""
        return result_name(self.solution.result)

    def beyond(self, bounds: Bounds) -> float:
        """Largest excess of any node or fragment over the bounds [K]."""
        low, high = bounds
        values = [*self.nodes, np.asarray(self.solution.surface_temperature, float)]
        ends = [end for v in values for end in (v.max() - high, low - v.min())]
        # Not `max`, which would lose a NaN.
        return float(np.max([0.0, *ends]))

    @property
    def residual(self) -> float:
        """The largest of the energy ledger, relative."""
        return float(np.abs(np.asarray(self.solution.energy.residual_relative)).max())


def run_nodes(
    scene: jt.Scene,
    solver: AbstractSolver,
    end: float,
    save_at: Sequence[float] | None = None,
) -> _Ran:
    """The same as `simulate`, run twice to time it, with the temperatures of all nodes.

    Args:
        scene: in which nothing moves.
        solver: to take.
        end: of the run [s].
        save_at: times to keep [s].
    """
    with precision(scene.dtype):
        todo = plan_run(scene, end, save_at, solver)
        program, layout = (
            todo.compiled.program,
            step_table(todo, save_intervals(todo.intervals)),
        )
        begin = time.perf_counter()
        jax.block_until_ready(
            take_steps_jit(todo.stepper, program, initial_state(todo), layout)[1]
        )
        middle = time.perf_counter()
        state, seen = take_steps_jit(todo.stepper, program, initial_state(todo), layout)
        jax.block_until_ready(seen)
        took = time.perf_counter() - middle
        solution = make_solution(todo, seen)
        nodes = tuple(
            float(part.reference)
            + np.asarray(part.network.temperature(theta), float)[
                body.structure.node_address()
            ]
            for body, part, theta in zip(
                scene.bodies, program.bodies, state.theta, strict=True
            )
        )
    return _Ran(solution, nodes, max(middle - begin - took, 0.0), took)


def stable_step(scene: jt.Scene) -> float:
    """The largest explicit step [s]."""
    with precision(scene.dtype):
        limit = plan_run(scene, 0.0, None).stable_step
    assert limit is not None
    return limit


def judged(
    what: str,
    scene: jt.Scene,
    method: Method,
    bounds: Bounds,
    limits: Limits = LIMITS,
    max_newton: int | None = None,
) -> Row:
    """One solver on one scene, by bounds, energy and what it says of itself.

    Args:
        what: the scene is.
        scene: in which nothing moves.
        method: the solver.
        bounds: of the maximum principle [K].
        limits: of overshoot and energy.
        max_newton: steps of Newton's method allowed in a stage.
    """
    try:
        ran = run_nodes(scene, method.solver, method.end)
    except Exception as error:
        return broken(what, error, method.name, scene.dtype)
    return row_of(what, scene.dtype, method, ran, bounds, limits, max_newton)


def row_of(
    what: str,
    dtype: str,
    method: Method,
    ran: _Ran,
    bounds: Bounds,
    limits: Limits = LIMITS,
    max_newton: int | None = None,
    more: tuple[Bound, ...] = (),
) -> Row:
    """The row of a run; arguments as of `judged`, with `more` checks."""
    over, effort = ran.beyond(bounds), ran.solution.run.statistics
    kept, bounded = limits.overshoot[dtype], bounds[1] - bounds[0]
    overshoot = {
        "kept": Bound("overshoot", over, kept),
        "bounded": Bound("overshoot", over, bounded),
        "reported": Bound("not finite", float(not np.isfinite(over)), 0.0),
    }[method.bounds]
    checks = [overshoot, Bound("energy", ran.residual, limits.energy[dtype])]
    if effort is not None:
        checks.append(
            Bound(
                "missed tolerance",
                float(_misses_tolerance(ran, dtype, method.solver)),
                0.0,
            )
        )
    if effort is not None and max_newton is not None:
        taken = int(effort.newton_iterations) / max(ran.solution.run.steps, 1)
        checks.append(Bound("Newton steps", taken, max_newton))
        checks.append(Bound("not settled", float(effort.newton_failed), 0.0))
    return Row(
        what,
        method.name,
        dtype,
        overshoot_K=over,
        energy_residual=ran.residual,
        newton=None if effort is None else int(effort.newton_iterations),
        linear=None if effort is None else int(effort.linear_iterations),
        compile_s=ran.compile_s,
        run_s=ran.run_s,
        result=ran.result,
        checks=(*checks, *more),
        if_met=REPORTED if method.bounds == "reported" else PASS,
    )


def _misses_tolerance(ran: _Ran, dtype: str, solver: Any) -> bool:
    """True if a solve missed its tolerance although the run reports success.

    A solve is called done within twice its tolerance; steps of an adaptive solver that
    were rejected and taken again do not count.
    """
    effort = ran.solution.run.statistics
    assert effort is not None
    given = getattr(solver, "tolerance", None)
    tolerance = LINEAR_TOLERANCE[dtype] if given is None else given
    short = (
        float(effort.largest_linear_residual) > 2 * tolerance
        and int(effort.rejected_steps) == 0
    )
    return ran.result == "successful" and (short or bool(effort.linear_failed))
