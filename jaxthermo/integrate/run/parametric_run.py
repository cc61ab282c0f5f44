"""A scene's surface temperatures as a function of the scene's numbers, for fits.

A fit repeats one run with other conductivities, weights or coefficients. The scene may
then hold traced values, while the steps are scheduled beforehand from known values: the
`StepTable` is an argument of the compiled program. A scene that becomes stiffer takes
more steps without a new compilation, and all runs of a fit with one table differ in
their values only, not in their steps.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...arrays import precision
from ...errors import InputError
from ...physics.radiation.irradiation import SceneRadiation
from ...scene.compile.compile import compile_scene
from ...scene.scene import Scene, SolvedSurface
from ..explicit import EulerStepper
from ..solvers import AbstractSolver, ErrorControl, ForwardEuler
from .fixed_steps import take_fixed_steps
from .plan import (
    Plan,
    StepTable,
    initial_state,
    plan_run,
    step_table,
)
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


@dataclass(frozen=True)
class ParametricRun:
    """A run whose scene may hold traced values."""

    save_times: tuple[float, ...]
    """Increasing save times after 0; the last one is the end of the run [s]."""
    solver: AbstractSolver | None = None
    """None for explicit Euler steps as long as is stable."""
    reverse_memory: int | None = None
    """Memory for the states that reverse mode stores [bytes]; None for forward mode.
    Reverse mode takes the steps of `solver`, which must give its `dt`."""

    def __post_init__(self):
        if not self.save_times or self.save_times[0] <= 0:
            raise InputError("a fit compares what is saved after 0 s: leave out 0")
        step = None if self.solver is None else self.solver.dt
        if self.reverse_memory is not None and step is None:
            raise InputError("a gradient in reverse mode needs a solver with its step")

    @property
    def uses_stable_step(self) -> bool:
        """True if the steps are as long as is stable."""
        # A run with traced values cannot be repeated until its error holds.
        return isinstance(self.solver, ErrorControl | None) or (
            isinstance(self.solver, ForwardEuler) and self.solver.dt is None
        )

    def step_table(self, scene: Scene, max_dt: float | None = None) -> StepTable:
        """Schedule the steps for a scene whose numbers are known.

        A run that uses the stable step takes `max_dt` [s] instead, if given.
        """
        # Explicit steps are bounded by `max_dt`, which may leave room for a fit to
        # become stiffer before its steps change.
        solver = ForwardEuler(max_dt) if self.uses_stable_step else self.solver
        with precision(scene.dtype):
            plan = plan_run(
                scene, t1=self.save_times[-1], save_at=self.save_times, solver=solver
            )
            if len(plan.compiled.programs) > 1:
                raise InputError("a fit needs bodies that stay where they are")
            return step_table(plan)

    def stable_step(self, scene: Scene) -> Float[Array, ""]:
        """Return the largest stable explicit step of a scene, traced or not [s]."""
        with precision(scene.dtype):
            return compile_scene(scene, 1, self.save_times[-1]).stable_step

    def __call__(self, scene: Scene, table: StepTable) -> ParametricSolution:
        """Run a scene that may hold traced values."""
        saves = self.save_times
        end = saves[-1]
        memory = self.reverse_memory
        with precision(scene.dtype):
            if self.uses_stable_step:
                # The stable step of a traced scene is not known, so that `plan_run`
                # would refuse it; the step table gives the steps.
                compiled = compile_scene(scene, len(saves), end, save_times=saves)
                plan = Plan(
                    scene=scene,
                    compiled=compiled,
                    intervals=(),
                    save_times=saves,
                    stable_step=None,
                    solver=ForwardEuler(),
                    stepper=EulerStepper(),
                )
            else:
                plan = plan_run(
                    scene,
                    t1=end,
                    save_at=saves,
                    solver=self.solver,
                    reverse_memory=memory,
                )
            compiled = plan.compiled
            if memory is not None:
                rows = take_fixed_steps(plan, initial_state(plan))
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


def with_more_steps(table: StepTable, factor: float) -> StepTable:
    """Divide the same intervals into at least `factor` times as many steps."""
    dt = np.asarray(table.dt)
    steps = np.asarray(table.steps)
    observed = np.asarray(table.observation_time)
    more_steps = np.ceil(steps * factor).astype(steps.dtype)
    ratio = np.where(more_steps > 0, steps / np.maximum(more_steps, 1), 1.0)
    shorter = dt * ratio.astype(dt.dtype)
    # Explicit steps take their loads at the middle; so does the last observation.
    middle = (dt * steps - shorter / 2).astype(dt.dtype)
    used = (steps > 0).sum(axis=1)
    last_middle = middle[np.arange(len(used)), np.maximum(used - 1, 0)]
    observed = np.where(used > 0, last_middle, observed)
    return StepTable(
        start=table.start,
        dt=jnp.asarray(shorter),
        steps=jnp.asarray(more_steps),
        observation_time=jnp.asarray(observed),
    )
