"""Solvers with their steps; one scene by one: bounds, energy, effort and time."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.integrate.implicit.jacobian import LINEAR_TOLERANCE
from jaxthermo.integrate.run.made_solution import make_solution
from jaxthermo.integrate.run.plan import (
    plan_run,
)
from jaxthermo.integrate.run.simulate import first_loop, take_steps
from jaxthermo.integrate.run.solution import result_name
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.integrate.stepper import in_place

from ..harness.case import PASS, REPORTED, Check, Row, attempt, refusal
from ..harness.scenes import stable_step


Bounds = tuple[float, float]
"""Lowest and highest temperature that the maximum principle allows [K]."""


class Limits(NamedTuple):
    """Limits by the dtype of a scene."""

    overshoot: dict[str, float]
    """Largest excess over the bounds [K], by dtype."""
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
    """End of the run [s]."""
    bounds: str = "kept"
    """`kept` to rounding, `bounded` by the range of the data, or `reported`."""


# Number of steps of most implicit runs.
_STEPS = 5
# Step of super time stepping [stable steps].
LONG = 100.0


def explicit(stable: float, steps: int = 200) -> list[Method]:
    """Explicit Euler at its limit, the stable step [s], and a solver far beyond."""
    long_step = LONG * stable
    return [
        Method(
            "ForwardEuler, at its limit",
            solver=jt.ForwardEuler(dt=stable),
            end=steps * stable,
        ),
        Method(
            f"SuperTimeStepping, {LONG:g} limits",
            solver=jt.SuperTimeStepping(dt=long_step),
            end=_STEPS * long_step,
            bounds="bounded",
        ),
    ]


def implicit(dt: float, note: str, steps: int = _STEPS) -> list[Method]:
    """The implicit solvers at one step [s], with a note on it in their names."""
    end = steps * dt
    # Only backward Euler keeps the bounds at any step; the trapezoidal rule rings.
    return [
        Method(f"BackwardEuler, {note}", solver=jt.BackwardEuler(dt=dt), end=end),
        Method(
            f"CrankNicolson, {note}",
            solver=jt.CrankNicolson(dt=dt),
            end=end,
            bounds="reported",
        ),
        Method(f"TRBDF2, {note}", solver=jt.TRBDF2(dt=dt), end=end, bounds="bounded"),
    ]


def implicit_limits(stable: float, ratio: float) -> list[Method]:
    """The implicit solvers in steps of `ratio` stable steps [s]."""
    return implicit(ratio * stable, f"{ratio:g} limits")


def adaptive(end: float, error: float = 0.01) -> Method:
    """The solver that chooses its steps by their error [K], to an end [s]."""
    return Method(
        "TRBDF2, adaptive",
        solver=jt.TRBDF2(error=error),
        end=end,
        bounds="bounded",
    )


def steppers(dt: float, stages: int | None = None) -> dict[str, AbstractSolver]:
    """All solvers in steps of `dt` [s], by the names of their classes."""
    solvers = (
        jt.ForwardEuler(dt=dt),
        jt.SuperTimeStepping(dt=dt, stages=stages),
        jt.BackwardEuler(dt=dt),
        jt.CrankNicolson(dt=dt),
        jt.TRBDF2(dt=dt),
    )
    return {type(solver).__name__: solver for solver in solvers}


def every_solver(stable: float, ratio: float = 1e3) -> list[Method]:
    """All solvers once; the implicit ones in steps of `ratio` stable steps [s]."""
    return [
        *explicit(stable),
        *implicit_limits(stable, ratio),
        adaptive(_STEPS * ratio * stable),
    ]


def damping(scene: jt.Scene, ratio: float = 1e3) -> list[Method]:
    """All solvers but the trapezoidal rule, which is there for comparison."""
    methods = every_solver(stable_step(scene), ratio)
    return [m for m in methods if not isinstance(m.solver, jt.CrankNicolson)]


def too_long(label: str, scene: jt.Scene, ratio: float = 2.0) -> Row:
    """Explicit Euler above its limit, which it must refuse and name."""
    stable = stable_step(scene)
    solver = jt.ForwardEuler(dt=ratio * stable)
    return refusal(
        label,
        lambda: jt.simulate(scene, ratio * stable, solver=solver),
        reason=f"the largest stable step of this scene is {stable:.6g} s",
        solver=f"ForwardEuler, {ratio:g} limits",
        dtype=scene.dtype,
    )


class Ran(NamedTuple):
    """A run with the temperatures of its nodes."""

    method: Method
    solution: jt.Solution
    nodes: tuple[np.ndarray, ...]
    """Temperatures of the nodes of each body at the end [K]."""
    compile_s: float
    """Time of the compilation [s]."""
    run_s: float
    """Time of a run that is compiled already [s]."""

    @property
    def result(self) -> str:
        """Name of its `RESULTS`."""
        return result_name(self.solution.result)

    def beyond(self, bounds: Bounds) -> float:
        """Largest excess of any node or fragment over the bounds [K]."""
        low, high = bounds
        values = [*self.nodes, np.asarray(self.solution.surface_temperature, float)]
        above = [body.max() - high for body in values]
        below = [low - body.min() for body in values]
        # Not `max`, which would lose a NaN.
        return float(np.max([0.0, *above, *below]))

    def moved(self, start: Any) -> float:
        """Largest change of any node since the start, node by node or uniform [K]."""
        return float(np.abs(np.concatenate(self.nodes) - start).max())

    @property
    def residual(self) -> float:
        """Largest relative residual of the energy ledger [-]."""
        residuals = np.asarray(self.solution.energy.residual_relative)
        return float(np.abs(residuals).max())


class Observation(NamedTuple):
    """Further checks of a case on a run, besides bounds and energy."""

    seen: str = ""
    """Text for the report."""
    checks: tuple[Check, ...] = ()


def run_nodes(
    scene: jt.Scene, method: Method, save_at: Sequence[float] | None = None
) -> Ran:
    """Run a scene without motion as `simulate` does, twice to time it."""
    with precision(scene.dtype):
        plan = plan_run(scene, t1=method.end, save_at=save_at, solver=method.solver)
        program = plan.compiled.program

        def run():
            loop = first_loop(plan)
            compiled = in_place(take_steps, loop.theta)
            return jax.block_until_ready(compiled(loop.arguments, loop.theta))

        # The first of two equal runs compiles as well: the second tells how much.
        begin = time.perf_counter()
        run()
        compiled = time.perf_counter()
        state, observations = run()
        run_time = time.perf_counter() - compiled
        solution = make_solution(plan, observations)
        nodes = []
        for body, body_program, theta in zip(
            scene.bodies, program.bodies, state.theta, strict=True
        ):
            difference = np.asarray(body_program.network.temperature(theta), float)
            address = body.structure.node_address()
            nodes.append(float(body_program.reference) + difference[address])
    return Ran(
        method,
        solution,
        nodes=tuple(nodes),
        compile_s=max(compiled - begin - run_time, 0.0),
        run_s=run_time,
    )


def judged(
    label: str,
    scene: jt.Scene,
    methods: Iterable[Method],
    bounds: Bounds,
    observe: Callable[[Ran], Observation] | None = None,
    *,
    limits: Limits = LIMITS,
    max_newton: int | None = None,
    save_at: Sequence[float] | None = None,
) -> Iterator[Row]:
    """Solvers on one scene, by bounds, energy and what they say of themselves.

    Args:
        label: of the scene, for the report.
        scene: without motion.
        methods: solvers and the ends of their runs.
        bounds: of the maximum principle.
        observe: what else is looked at in a run.
        limits: of overshoot and energy.
        max_newton: largest number of Newton iterations of a step of one stage.
        save_at: times at which a run is saved [s]; its end alone if None.
    """
    for method in methods:

        def measure(method: Method = method) -> Row:
            ran = run_nodes(scene, method=method, save_at=save_at)
            row = _row_of(
                ran,
                dtype=scene.dtype,
                bounds=bounds,
                limits=limits,
                max_newton=max_newton,
            )
            observation = Observation() if observe is None else observe(ran)
            return row._replace(
                seen=observation.seen, checks=(*row.checks, *observation.checks)
            )

        yield attempt(label, measure, solver=method.name, dtype=scene.dtype)


def _row_of(
    ran: Ran, dtype: str, bounds: Bounds, limits: Limits, max_newton: int | None
) -> Row:
    method = ran.method
    over = ran.beyond(bounds)
    run = ran.solution.run
    effort = run.statistics
    range_of_data = bounds[1] - bounds[0]
    overshoot = {
        "kept": Check("overshoot", over, limits.overshoot[dtype]),
        "bounded": Check("overshoot", over, range_of_data),
        "reported": Check("not finite", float(not np.isfinite(over)), 0.0),
    }[method.bounds]
    checks = [overshoot, Check("energy", ran.residual, limits.energy[dtype])]
    newton = linear = None
    if effort is not None:
        newton = int(effort.newton_iterations)
        linear = int(effort.linear_iterations)
        missed = _misses_tolerance(ran, dtype=dtype, solver=method.solver)
        checks.append(Check("missed tolerance", float(missed), 0.0))
        # Newton's steps are counted over all stages: these solvers have one.
        is_one_stage = isinstance(method.solver, jt.BackwardEuler | jt.CrankNicolson)
        if max_newton is not None and is_one_stage:
            per_step = newton / max(run.steps, 1)
            checks.append(Check("Newton steps", per_step, max_newton))
            checks.append(Check("not settled", float(effort.newton_failed), 0.0))
    return Row(
        overshoot_K=over,
        energy_residual=ran.residual,
        newton=newton,
        linear=linear,
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
    tolerance = getattr(solver, "tolerance", None)
    if tolerance is None:
        tolerance = LINEAR_TOLERANCE[dtype]
    # A solve is called done within twice its tolerance. Steps of an adaptive solver
    # that were rejected and taken again do not count.
    short = (
        float(effort.largest_linear_residual) > 2 * tolerance
        and int(effort.rejected_steps) == 0
    )
    return ran.result == "successful" and (short or bool(effort.linear_failed))
