"""Steps of independent parts of a scene, each with as many stages as it requires.

The stages of a step are as many as the stiffest node requires. Where no heat flows
between some bodies and others, the others need not follow: a small rim of aluminium
then costs a large and slow ground nothing. Nor need they follow where shorter steps are
taken for the error in time of a part, see `run.time_error`.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array, Bool, Float
from typing_extensions import override

from ..scene.compile.independent_parts import independent_groups, program_of
from ..scene.compile.memory import Method
from ..scene.compile.program import Compiled, Program
from .explicit import RKL2Stepper, least_stages, stage_count
from .stepper import AbstractStepper, RunState


_MIN_RATIO = 1.5
"""Ratio of the stages of two parts from which each takes its own number."""

_MIN_SAVED = 2**18
"""Stages of single nodes in a step that a part saves if it takes its own number: less
would not be worth the compilation of one more loop over stages."""


class StagePart(NamedTuple):
    """Groups that take one number of stages."""

    groups: tuple[int, ...]
    """Numbers of the groups in the program."""
    nodes: int
    stable_step: float
    """Largest stable explicit step [s]."""
    stages: int
    """Number of stages of the longest step."""


class PartStepper(AbstractStepper):
    """Steps of parts between which no heat flows, each by its own stepper."""

    groups: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Numbers of the groups of each part."""
    steppers: tuple[RKL2Stepper, ...]
    takes_steps: Bool[Any, " parts"] | None = None
    """False for each part that keeps its state; None where all parts take steps."""

    @property
    @override
    def method(self) -> Method:
        return "stages"

    @property
    def stages_taken(self) -> int:
        """Largest number of stages of any part."""
        return max(stepper.stages_taken for stepper in self.steppers)

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        theta = list(state.theta)
        ledger = state.ledger
        for number, groups in enumerate(self.groups):
            start_state = RunState(tuple(theta[group] for group in groups), ledger)
            new_state = self._step_of(number, program, start_state, start, dt)
            ledger = new_state.ledger
            for group, values in zip(groups, new_state.theta, strict=True):
                theta[group] = values
        return RunState(tuple(theta), ledger, state.solver_state)

    def _step_of(
        self,
        number: int,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """Return the state of one part after a step, if it takes steps."""
        take_step = partial(
            self.steppers[number].step,
            program_of(program, self.groups[number]),
            start=start,
            dt=dt,
        )
        if self.takes_steps is None:
            return take_step(state)
        return jax.lax.cond(
            self.takes_steps[number], take_step, lambda state: state, state
        )


def in_parts(
    compiled: Compiled,
    longest: float,
    stepper_of: Callable[[StagePart], RKL2Stepper],
) -> RKL2Stepper | PartStepper:
    """Return the stepper of steps up to `longest` [s], from those of its parts.

    The stable steps of the scene must be known.
    """
    divided = stage_parts(compiled, longest)
    steppers = tuple(map(stepper_of, divided))
    if len(divided) == 1:
        return steppers[0]
    return PartStepper(tuple(stage_part.groups for stage_part in divided), steppers)


def stage_parts(compiled: Compiled, longest: float) -> list[StagePart]:
    """Parts of a scene that take different numbers of stages, the most first."""
    independent = [
        _part(compiled, groups, longest)
        for groups in independent_groups(compiled.programs)
    ]
    independent.sort(key=lambda stage_part: stage_part.stages, reverse=True)
    # Parts of about as many stages share a loop.
    classes: list[list[StagePart]] = []
    for stage_part in independent:
        if classes and classes[-1][0].stages < _MIN_RATIO * stage_part.stages:
            classes[-1].append(stage_part)
        else:
            classes.append([stage_part])
    divided: list[StagePart] = []
    for members in classes:
        joined = _joined(compiled, members, longest)
        saved = _MIN_SAVED
        if divided:
            saved = joined.nodes * (divided[-1].stages - joined.stages)
        if saved >= _MIN_SAVED:
            divided.append(joined)
        else:
            divided[-1] = _joined(compiled, [divided[-1], joined], longest)
    return divided


def _joined(compiled: Compiled, members: list[StagePart], longest: float) -> StagePart:
    groups = sorted(group for member in members for group in member.groups)
    return _part(compiled, tuple(groups), longest)


def _part(compiled: Compiled, groups: tuple[int, ...], longest: float) -> StagePart:
    stable_step = float(compiled.stable_rates.step(groups))
    min_stages = least_stages([compiled.program.bodies[group] for group in groups])
    return StagePart(
        groups=groups,
        nodes=sum(math.prod(compiled.state_shapes[group]) for group in groups),
        stable_step=stable_step,
        stages=stage_count(longest, stable_step, min_stages),
    )
