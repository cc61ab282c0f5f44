"""A scene's surface as a function of its numbers: one program for all values of them.

Fits ask for the same run again and again with other conductivities, weights or
coefficients. Here the scene may hold traced values; what is laid out beforehand, from
values that are known, is when it steps: `layout` gives starts, lengths and numbers of
steps as arrays, an argument of the program, so that a scene that turns stiffer takes
more steps without being compiled anew, and one fit's runs differ in their values only,
not in their steps.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...arrays import precision
from ...errors import InputError
from ...scene.compile.compile import compile_scene
from ...scene.scene import Scene
from ...scene.solved_surface import SolvedSurface
from ..explicit.euler import EulerStepper
from ..solvers import AbstractSolver, ForwardEuler
from .schedule import legs, schedule
from .simulate import Plan, layout_table, plan, run, run_all, start


Layout = Any
"""Starts, steps, numbers of steps and moments to read, a row a save time."""


class Answer(NamedTuple):
    """What a run says."""

    surface: Float[Array, "t s"]
    """Of every fragment at every saved time [K]."""
    stable_step: Float[Array, ""]
    """Of an explicit step, with these values [s]."""
    finite: Bool[Array, ""]
    surfaces: tuple[SolvedSurface, ...]
    """Of the bodies, with their finish."""


@dataclass(frozen=True)
class Response:
    """How a scene is run for a fit."""

    saves: tuple[float, ...]
    """Increasing, after 0; the last one is the end [s]."""
    solver: AbstractSolver | None = None
    """None for explicit steps, as long as is stable."""
    reverse_memory: int | None = None
    """For states that reverse mode keeps [bytes]; None for forward mode. In reverse the
    steps are those of `solver`, which has to give them."""

    def __post_init__(self):
        if not self.saves or self.saves[0] <= 0:
            raise InputError("a fit compares what is saved after 0 s: leave out 0")
        if self.reverse_memory is not None and _step(self.solver) is None:
            raise InputError("a gradient in reverse mode needs a solver with its step")

    @property
    def follows_stability(self) -> bool:
        """Whether the steps' lengths go by the stable one."""
        return self.solver is None or (
            isinstance(self.solver, ForwardEuler) and self.solver.dt is None
        )

    def layout(self, scene: Scene, longest: float | None = None) -> Layout:
        """When to step, for a scene whose numbers are known.

        Args:
            scene: of bodies that stay where they are.
            longest: step, where it goes by the stable one; that itself if not given
                [s].

        Raises:
            InputError: if bodies move.
        """
        solver = ForwardEuler(longest) if self.follows_stability else self.solver
        with precision(scene.dtype):
            todo = _still(plan(scene, self.saves[-1], self.saves, solver))
            return layout_table(todo, legs(todo.intervals))

    def stable_step(self, scene: Scene) -> Float[Array, ""]:
        """The largest explicit step; of a scene that may be traced [s]."""
        with precision(scene.dtype):
            return compile_scene(scene, 1, self.saves[-1]).stable_step

    def __call__(self, scene: Scene, layout: Layout) -> Answer:
        """Run a scene that may hold traced values.

        Args:
            scene: as the one that was laid out, but for its numbers.
            layout: when to step.
        """
        with precision(scene.dtype):
            todo = self._plan(scene)
            if self.reverse_memory is not None:
                seen = run(todo, start(todo), traced=True)
            else:
                program, state = todo.compiled.program, start(todo)
                _, seen = run_all.__wrapped__(todo.stepper, program, state, layout)
            return Answer(
                seen.surface,
                jnp.asarray(todo.compiled.stable_step),
                seen.finite.all(),
                todo.compiled.surfaces,
            )

    def _plan(self, scene: Scene) -> Plan:
        """All that is compiled; of steps that follow stability, not how many."""
        end = self.saves[-1]
        if not self.follows_stability:
            memory = self.reverse_memory
            return _still(
                plan(scene, end, self.saves, self.solver, reverse_memory=memory)
            )
        compiled = compile_scene(scene, len(self.saves), end)
        landings = (*compiled.program.breakpoints, *compiled.starts)
        once = schedule(end, self.saves, landings, math.inf)
        solver, stepper = ForwardEuler(), EulerStepper()
        return _still(Plan(scene, compiled, once, self.saves, None, solver, stepper))


def _still(todo: Plan) -> Plan:
    if len(todo.compiled.programs) > 1:
        raise InputError("a fit needs bodies that stay where they are")
    return todo


def _step(solver: AbstractSolver | None) -> float | None:
    return None if solver is None else solver.dt


def with_more_steps(layout: Layout, factor: float) -> Layout:
    """The same moments in shorter steps.

    Args:
        layout: of a run.
        factor: more steps, at least.
    """
    starts, spans, before, reads = (np.asarray(each) for each in layout)
    after = np.ceil(before * factor).astype(before.dtype)
    ratio = np.where(after > 0, before / np.maximum(after, 1), 1.0)
    shorter = spans * ratio.astype(spans.dtype)
    # Loads are read where the last step takes its own, in its middle.
    middle = (starts + spans * before - shorter / 2).astype(spans.dtype)
    reads = np.where(before > 0, middle, reads)
    return layout[0], jnp.asarray(shorter), jnp.asarray(after), jnp.asarray(reads)
