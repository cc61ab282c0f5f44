"""Solvers with their steps; one scene by one: bounds, energy, effort and time."""

import time
from collections.abc import Callable, Sequence
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
from jaxthermo.integrate.run.simulate import make_solution, take_steps_in_place
from jaxthermo.integrate.run.solution import result_name
from jaxthermo.integrate.solvers import AbstractSolver

from ..harness.case import PASS, REPORTED, Bound, Row, attempt, refusal


# Between which the maximum principle holds every temperature [K].
Bounds = tuple[float, float]


class Limits(NamedTuple):
    """Limits by the dtype of a scene."""

    overshoot: dict[str, float]
    """[K]"""
    energy: dict[str, float]
    """Largest energy residual over the heat that moved [-], by dtype."""


# Measured on a chain of 200 alternating cells at Fo up to 1e6, and rounded up.
LIMITS = Limits(
    overshoot={"float64": 1e-9, "float32": 5e-3},
    energy={"float64": 1e-12, "float32": 1e-4},
)


class Method(NamedTuple):
    """A solver and the end of its run."""

    name: str
    solver: AbstractSolver
    end: float
    """[s]"""
    bounds: str = "kept"
    """`kept` to rounding, `bounded` by the range of the data, or `reported`."""


# Number of steps of most implicit runs.
STEPS = 5
# Step of super time stepping [stable steps].
LONG = 100.0


def explicit(stable: float, steps: int = 200) -> list[Method]:
    """Explicit Euler at its limit, the stable step [s], and a solver far beyond."""
    long = LONG * stable
    euler, super_time = jt.ForwardEuler(dt=stable), jt.SuperTimeStepping(dt=long)
    return [
        Method("ForwardEuler, at its limit", euler, steps * stable),
        Method(
            f"SuperTimeStepping, {LONG:g} limits", super_time, STEPS * long, "bounded"
        ),
    ]


def implicit(dt: float, note: str, steps: int = STEPS) -> list[Method]:
    """The implicit solvers at one step [s], with a note on it in their names."""
    end = steps * dt
    # Only backward Euler keeps the bounds at any step; the trapezoidal rule rings.
    return [
        Method(f"BackwardEuler, {note}", jt.BackwardEuler(dt=dt), end),
        Method(f"CrankNicolson, {note}", jt.CrankNicolson(dt=dt), end, "reported"),
        Method(f"TRBDF2, {note}", jt.TRBDF2(dt=dt), end, "bounded"),
    ]


def adaptive(end: float, error: float = 0.01) -> Method:
    """The solver that chooses its steps by their error [K], to an end [s]."""
    return Method("TRBDF2, adaptive", jt.TRBDF2(error=error), end, "bounded")


def every_solver(stable: float, ratio: float = 1e3) -> list[Method]:
    """All of them once; the implicit ones in steps of `ratio` stable steps [s]."""
    dt = ratio * stable
    return [*explicit(stable), *implicit(dt, f"{ratio:g} limits"), adaptive(STEPS * dt)]


def damping(scene: jt.Scene, ratio: float = 1e3) -> list[Method]:
    """All but the trapezoidal rule, which is there for comparison."""
    methods = every_solver(stable_step(scene), ratio)
    return [m for m in methods if not isinstance(m.solver, jt.CrankNicolson)]


def too_long(what: str, scene: jt.Scene, ratio: float = 2.0) -> Row:
    """Explicit Euler above its limit, which it must refuse and name."""
    stable = stable_step(scene)
    solver = jt.ForwardEuler(dt=ratio * stable)
    return refusal(
        what,
        lambda: jt.simulate(scene, ratio * stable, solver=solver),
        f"the largest stable step of this scene is {stable:.6g} s",
        f"ForwardEuler, {ratio:g} limits",
        scene.dtype,
    )


def stable_step(scene: jt.Scene) -> float:
    """The largest explicit step [s]."""
    with precision(scene.dtype):
        limit = plan_run(scene, 0.0, None).stable_step
    assert limit is not None
    return limit


class Ran(NamedTuple):
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

    def moved(self, start: Any) -> float:
        """Largest change of any node since the start, node by node or uniform [K]."""
        return float(np.abs(np.concatenate(self.nodes) - start).max())

    @property
    def residual(self) -> float:
        """The largest of the energy ledger, relative."""
        return float(np.abs(np.asarray(self.solution.energy.residual_relative)).max())


def run_nodes(
    scene: jt.Scene, method: Method, save_at: Sequence[float] | None = None
) -> Ran:
    """The same as `simulate` without motion, run twice to time it."""
    with precision(scene.dtype):
        todo = plan_run(scene, method.end, save_at, method.solver)
        program = todo.compiled.program
        layout = step_table(todo, save_intervals(todo.intervals))
        take = lambda: jax.block_until_ready(
            take_steps_in_place(todo.stepper, program, initial_state(todo), layout)
        )
        # The first of two equal runs compiles as well: the second tells how much.
        begin = time.perf_counter()
        take()
        middle = time.perf_counter()
        state, seen = take()
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
    return Ran(solution, nodes, max(middle - begin - took, 0.0), took)


def judged(
    what: str,
    scene: jt.Scene,
    method: Method,
    bounds: Bounds,
    more: Callable[[Ran], tuple[str, tuple[Bound, ...]]] | None = None,
    *,
    limits: Limits = LIMITS,
    max_newton: int | None = None,
    save_at: Sequence[float] | None = None,
) -> Row:
    """One solver on one scene, by bounds, energy and what it says of itself."""
    # `more` gives what else was seen, and further checks; `max_newton` is per stage.

    def measure() -> Row:
        ran = run_nodes(scene, method, save_at)
        row = _row_of(what, scene.dtype, method, ran, bounds, limits, max_newton)
        seen, checks = ("", ()) if more is None else more(ran)
        return row._replace(seen=seen, checks=(*row.checks, *checks))

    return attempt(what, measure, method.name, scene.dtype)


def _row_of(
    what: str,
    dtype: str,
    method: Method,
    ran: Ran,
    bounds: Bounds,
    limits: Limits = LIMITS,
    max_newton: int | None = None,
) -> Row:
    over, effort = ran.beyond(bounds), ran.solution.run.statistics
    kept, bounded = limits.overshoot[dtype], bounds[1] - bounds[0]
    overshoot = {
        "kept": Bound("overshoot", over, kept),
        "bounded": Bound("overshoot", over, bounded),
        "reported": Bound("not finite", float(not np.isfinite(over)), 0.0),
    }[method.bounds]
    checks = [overshoot, Bound("energy", ran.residual, limits.energy[dtype])]
    if effort is not None:
        missed = _misses_tolerance(ran, dtype, method.solver)
        checks.append(Bound("missed tolerance", float(missed), 0.0))
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
        checks=tuple(checks),
        if_met=REPORTED if method.bounds == "reported" else PASS,
    )


def _misses_tolerance(ran: Ran, dtype: str, solver: Any) -> bool:
    """True if a solve missed its tolerance although the run reports success."""
    effort = ran.solution.run.statistics
    assert effort is not None
    given = getattr(solver, "tolerance", None)
    tolerance = LINEAR_TOLERANCE[dtype] if given is None else given
    # A solve is called done within twice its tolerance. Steps of an adaptive solver
    # that were rejected and taken again do not count.
    short = (
        float(effort.largest_linear_residual) > 2 * tolerance
        and int(effort.rejected_steps) == 0
    )
    return ran.result == "successful" and (short or bool(effort.linear_failed))
