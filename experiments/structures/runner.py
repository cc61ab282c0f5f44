"""A compiled scene whose time loop can be run, and timed, by itself.

The only place that knows how `simulate` is put together.
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from jaxthermo.arrays import precision
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.observe import Observation
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run, step_table
from jaxthermo.integrate.run.schedule import save_intervals
from jaxthermo.integrate.run.simulate import make_solution, take_steps
from jaxthermo.integrate.run.solution import RESULTS, Solution
from jaxthermo.integrate.solvers import ForwardEuler
from jaxthermo.integrate.surface_error import AnySolution
from jaxthermo.scene.scene import Scene


Loop = Callable[[], Observation]
"""Takes every step from the start, and reads the surface at the saved times."""


@dataclass(frozen=True, eq=False)
class Runner:
    """All that comes before the first step is done."""

    scene: Scene
    plan: Plan
    compile: Callable[[], Loop]
    """Makes the loop, anew each time."""

    @property
    def held_bytes(self) -> int:
        """Arrays of the compiled scene and of its state."""
        held = (self.plan.compiled.program, self.plan.compiled.state)
        leaves = (x for x in jax.tree.leaves(held) if isinstance(x, jax.Array))
        return sum(x.nbytes for x in leaves)

    def solution(self, seen: Observation) -> Solution:
        """What `simulate` gives, of a finished loop.

        Raises:
            InputError: if temperatures stopped being finite or fell below 0 K.
        """
        with precision(self.scene.dtype):
            found = make_solution(self.plan, seen)
        if found.result != RESULTS.successful:
            raise InputError(RESULTS[found.result])
        return found


def prepare(
    scene: Scene, t1: float, save_at: tuple[float, ...], dt: float | None = None
) -> Runner:
    """Compile a scene and lay out its steps.

    Args:
        scene: one body and what acts on it.
        t1: end [s].
        save_at: times to keep [s].
        dt: the step; the largest stable one if not given [s].
    """
    with precision(scene.dtype):
        todo = plan_run(scene, t1, save_at, ForwardEuler(dt=dt))
        program, state = todo.compiled.program, initial_state(todo)
        layout = step_table(todo, save_intervals(todo.intervals))
        jax.block_until_ready((program, state, layout))

    def compile_loop() -> Loop:
        # A function of its own, so that nothing compiled before is used again.
        own = lambda *parts: take_steps(*parts)
        with precision(scene.dtype):
            made = (
                eqx.filter_jit(own)
                .lower(todo.stepper, program, state, layout)
                .compile()
            )

        def loop() -> Observation:
            with precision(scene.dtype):
                return made(todo.stepper, program, state, layout)[1]

        return loop

    return Runner(scene, todo, compile_loop)


def finish(runner: Runner) -> Solution:
    """Run once, untimed."""
    return runner.solution(jax.block_until_ready(runner.compile()()))


def surface_at(solution: AnySolution, time: float) -> Float[np.ndarray, " s"]:
    """Temperatures of all fragments at a saved time [K]."""
    index = int(np.abs(np.asarray(solution.times) - time).argmin())
    return np.asarray(solution.surface_temperature[index], np.float32)
