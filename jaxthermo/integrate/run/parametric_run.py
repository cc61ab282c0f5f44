"""A scene's surface temperatures as a function of the scene's numbers, for fits.

A fit repeats one run with other conductivities, weights or coefficients. The scene may
then hold traced values, while the steps are scheduled beforehand from known values: the
`StepTable` is an argument of the compiled program. A scene that becomes stiffer takes
more steps without a new compilation, and all runs with one table differ in their values
only, not in their steps.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...errors import InputError
from ...physics.radiation.irradiation import SceneRadiation
from ...scene.compile.compile import compile_scene
from ...scene.scene import Scene, SolvedSurface
from ..explicit import EulerStepper
from ..solvers import AbstractSolver, ErrorControl, ForwardEuler
from .fixed_steps import FixedLoop, take_table_steps
from .plan import (
    Plan,
    StepTable,
    checkpoint_count,
    initial_state,
    plan_run,
    step_table,
)
from .schedule import schedule
from .simulate import first_loop, take_steps


class ParametricSolution(NamedTuple):
    """Result of a `ParametricRun`."""

    surface_temperature: Float[Array, "t s"]
    """Temperature of every fragment at every save time [K]."""
    stable_step: Float[Array, ""]
    """Largest stable explicit step with these values [s]."""
    finite: Bool[Array, ""]
    """True if all temperatures are finite."""
    surfaces: tuple[SolvedSurface, ...]
    """Surface of each body, with its emissivity and absorptivity."""
    radiation: SceneRadiation
    """Irradiation of the surfaces, absorbed or not."""


class ReverseMode(NamedTuple):
    """Memory and loops of a run that is differentiated in reverse mode."""

    memory: int
    """Memory for the states that it stores [bytes]."""
    loops: Sequence[FixedLoop]
    """Loops that have room for the steps of every table that it is called with."""


@dataclass(frozen=True)
class ParametricRun:
    """A run whose scene may hold traced values."""

    save_times: tuple[float, ...]
    """Increasing save times after 0; the last one is the end of the run [s]."""
    solver: AbstractSolver = ForwardEuler()
    """Not by error control: a run with traced values cannot be repeated."""
    reverse: ReverseMode | None = None
    """None for forward mode."""

    def __post_init__(self):
        if not self.save_times or self.save_times[0] <= 0:
            raise InputError("a fit compares what is saved after 0 s: leave out 0")
        if isinstance(self.solver, ErrorControl):
            raise InputError("a run with traced values needs a solver with its step")
        adaptive = not self.uses_stable_step and self.solver.dt is None
        if self.reverse is not None and adaptive:
            raise InputError("a gradient in reverse mode needs a solver with its step")

    @property
    def uses_stable_step(self) -> bool:
        """True if the steps are as long as is stable."""
        return isinstance(self.solver, ForwardEuler) and self.solver.dt is None

    @property
    def is_always_stable(self) -> bool:
        """True if steps of any length are stable."""
        return math.isinf(self.solver.longest_stable_step(1.0))

    def step_table(self, scene: Scene) -> StepTable:
        """Schedule the steps for a scene whose numbers are known."""
        return step_table(self._scheduled_plan(scene))

    def fewest_steps(self, scene: Scene) -> StepTable:
        """Schedule the same intervals in as few steps as the solver allows.

        Stability may require more, see `divided`.
        """
        plan = self._scheduled_plan(scene)
        if not self.uses_stable_step:
            return step_table(plan)
        # A sampled function of time must not change unseen within a step.
        longest = plan.solver.max_dt(
            math.inf, t1=self.save_times[-1], sampled=plan.compiled.program.sampled
        )
        intervals = schedule(
            self.save_times[-1],
            self.save_times,
            event_times=tuple(interval.end for interval in plan.intervals),
            max_dt=longest,
        )
        return step_table(plan._replace(intervals=intervals))

    def _scheduled_plan(self, scene: Scene) -> Plan:
        """Plan with the steps of a scene whose numbers are known."""
        with scene.precision:
            plan = plan_run(
                scene,
                t1=self.save_times[-1],
                save_at=self.save_times,
                solver=self.solver,
            )
            if len(plan.compiled.programs) > 1:
                raise InputError("a fit needs bodies that stay where they are")
            return plan

    def divided(self, fewest: StepTable, longest: float) -> StepTable:
        """Divide the intervals of `fewest_steps` into steps up to `longest` [s]."""
        length = np.asarray(fewest.dt, float) * np.asarray(fewest.steps)
        # A quotient that exceeds a whole number by rounding must not cost a step more.
        needed = np.ceil(length / longest * (1 - 1e-6))
        most = np.iinfo(fewest.steps.dtype).max
        if needed.max() > most:
            raise InputError(
                f"{length.max():g} s take {needed.max():.2g} steps of {longest:.3g} s, "
                "the longest stable step: check the start values of the parameters"
            )
        steps = np.maximum(fewest.steps, needed.astype(fewest.steps.dtype))
        dt = np.divide(length, steps, out=np.zeros_like(length), where=steps > 0)
        used = (steps > 0).sum(axis=1)
        last = (np.arange(len(used)), np.maximum(used - 1, 0))
        before_end = (1 - self.solver.load_fraction) * dt[last]
        dtype = fewest.dt.dtype
        return StepTable(
            start=fewest.start,
            dt=dt.astype(dtype),
            steps=steps,
            observation_time=(length[last] - before_end).astype(dtype),
        )

    def longest_step(self, scene: Scene) -> Float[Array, ""]:
        """Return the longest stable step of a scene, traced or not [s].

        Infinite for a scheme that is stable for any step.
        """
        return _longest_step(self.solver, scene, self.save_times[-1])

    def __call__(self, scene: Scene, table: StepTable) -> ParametricSolution:
        """Run a scene that may hold traced values."""
        with scene.precision:
            plan = self._traced_plan(scene)
            compiled = plan.compiled
            if self.reverse is not None:
                loops = self.reverse.loops
                rows = take_table_steps(plan, initial_state(plan), table, loops)
            else:
                loop = first_loop(plan, table)
                _, rows = take_steps(loop.arguments, loop.theta)
            return ParametricSolution(
                surface_temperature=rows.surface_temperature,
                stable_step=jnp.asarray(compiled.stable_step),
                finite=rows.is_finite.all(),
                surfaces=compiled.surfaces,
                radiation=compiled.radiation,
            )

    def _traced_plan(self, scene: Scene) -> Plan:
        """Plan whose steps are those of a table."""
        saves = self.save_times
        end = saves[-1]
        memory = None if self.reverse is None else self.reverse.memory
        if not self.uses_stable_step:
            return plan_run(
                scene,
                t1=end,
                save_at=saves,
                solver=self.solver,
                reverse_memory=memory,
            )
        # The stable step of a traced scene is not known, so that `plan_run` would
        # refuse it; the step table gives the steps.
        compiled = compile_scene(scene, len(saves), end, save_times=saves)
        return Plan(
            scene=scene,
            compiled=compiled,
            intervals=(),
            save_times=saves,
            stable_step=None,
            solver=ForwardEuler(),
            stepper=EulerStepper(),
            checkpoints=checkpoint_count(memory, compiled),
        )


def _longest_step(solver: AbstractSolver, scene: Scene, end: float) -> Float[Array, ""]:
    with scene.precision:
        if math.isinf(solver.longest_stable_step(1.0)):
            return jnp.asarray(math.inf, scene.dtype)
        stable_step = compile_scene(scene, 1, end).stable_step
        return jnp.asarray(solver.longest_stable_step(stable_step))


def stable_solver(
    solver: AbstractSolver | None, scene: Scene, end: float
) -> AbstractSolver | None:
    """Return a solver with a step that is stable up to `end` [s], None for none.

    The numbers of the scene must be known.
    """
    if solver is None or solver.dt is None:
        return solver
    longest = float(_longest_step(solver, scene, end))
    if solver.dt <= longest:
        return solver
    return eqx.tree_at(lambda tree: tree.dt, solver, longest)
