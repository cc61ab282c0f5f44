"""The solvers that a user chooses from: what each decides before a run.

| solver | order | stable up to | for |
|---|---|---|---|
| `ForwardEuler` | 1 | 1 stable step | short runs |
| `SuperTimeStepping` | 2 | any, at sqrt(n) evaluations | long runs, smooth or not |
| `BackwardEuler` | 1, never overshoots | any | very stiff scenes, huge steps |
| `TRBDF2` | 2, error held | any | stiff scenes, to a stated error |
| `CrankNicolson` | 2, rings above 1 stable step | any | comparison |
"""

import abc
import math
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..network.multigrid import Hierarchy, hierarchy
from ..network.nonlinear import NonlinearNetwork
from ..physics.time_varying import SAMPLES
from ..scene.compile.program import BodyProgram, Compiled, Program
from ..scene.scene import Scene
from ..structures.structure import AbstractStructure
from .explicit.euler import EulerStepper
from .explicit.rkl2 import LegendreStepper, stages_for
from .implicit.adaptive import AdaptiveStepper
from .implicit.context import Tools
from .implicit.deflation import parts_of
from .implicit.runge_kutta import (
    BACKWARD_EULER,
    CRANK_NICOLSON,
    TR_BDF2,
    ImplicitStepper,
)
from .run.schedule import END_SHARE
from .run.state import AbstractStepper


KELVIN = {"float32": 1e-4, "float64": 1e-9}
"""What a linear solve may leave at every node, by default [K]."""

STEPS = 128
"""Steps of a run whose length nothing else decides."""

LEAST_STEPS, MOST_LANDINGS = 16, 64
"""Then also the least steps from one landing to the next, unless there are so many:
what is switched there changes fast at first."""

COARSE_RATIO = 30.0
"""Stable steps in one step above which multigrid pays: a cycle takes as long as five to
fifteen iterations with the diagonal (`experiments run multigrid`)."""


class AbstractSolver(eqx.Module):
    """How time passes."""

    dt: eqx.AbstractVar[Any]
    """[s]; None to have it chosen."""

    @property
    def load_time(self) -> float:
        """Where in its last step a surface is read, as it is loaded there."""
        return 1 - END_SHARE

    def least_steps(self, landings: int) -> int:
        """From one landing to the next.

        Args:
            landings: how many there are.
        """
        few = self.dt is None and landings <= MOST_LANDINGS
        return LEAST_STEPS if few else 1

    def longest(self, stable: float | None, t1: float | int, sampled: bool) -> float:
        """The longest step that will be taken [s].

        Args:
            stable: the largest explicit step [s]; None if it is traced.
            t1: end of the run [s].
            sampled: whether a value is a function of time that is known where it is
                evaluated only.

        Raises:
            InputError: for a step that is none, or that is not stable.
        """
        del stable
        if self.dt is not None:
            return positive_step(self.dt)
        return float(t1) / (SAMPLES if sampled else STEPS) if t1 else 1.0

    def suited(self, scene: Scene) -> Scene:
        """The scene with its bodies laid out as this solver runs fast."""
        return scene

    @abc.abstractmethod
    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """What takes the steps.

        Args:
            scene: that was compiled.
            compiled: the scene.
            longest: step that will be asked for [s].
            traced: whether derivatives may be asked for.
        """


def positive_step(dt: Any) -> float:
    """A user's step [s], checked."""
    step = float(dt)
    if not (step > 0 and math.isfinite(step)):
        raise InputError(f"solver: dt={step:g} is no step; give a positive time")
    return step


def _known(stable: float | None, example: str) -> float:
    if stable is None:
        raise InputError(
            "simulate: the stable step depends on traced values; give the step, as in "
            f"solver={example}"
        )
    return stable


class ForwardEuler(AbstractSolver):
    """Explicit Euler at a given step, or at the stable one."""

    dt: Any = None
    """[s]; None for the largest stable step."""

    @property
    def load_time(self) -> float:
        """At the middle, where its loads are taken."""
        return 0.5

    def least_steps(self, landings: int) -> int:
        """One: the stable step is short enough."""
        del landings
        return 1

    def longest(self, stable: float | None, t1: float | int, sampled: bool) -> float:
        """The given step, or the stable one, and short enough to see what varies."""
        if self.dt is None:
            dt = _known(stable, "ForwardEuler(dt=0.1)")
            return min(dt, t1 / SAMPLES) if sampled and t1 > 0 else dt
        dt = positive_step(self.dt)
        if stable is not None and dt > stable * (1 + 1e-6):
            raise InputError(
                f"solver: dt={dt:g} s is too long: the largest stable step of this "
                f"scene is {stable:.6g} s; give that or less, or no dt to have it "
                "chosen, or another solver, such as TRBDF2()"
            )
        return dt

    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """Explicit Euler."""
        del scene, compiled, longest, traced
        return EulerStepper()


class SuperTimeStepping(AbstractSolver):
    """Explicit steps of many stages, second order (`legendre`)."""

    dt: Any = None
    """[s]; None for 1/128 of the run."""
    stages: int | None = eqx.field(static=True, default=None)
    """Of every step; None for as few as are stable."""

    def longest(self, stable: float | None, t1: float | int, sampled: bool) -> float:
        """As given, if the stages are stable with it.

        Raises:
            InputError: for too few stages, or unknown ones.
        """
        dt = super().longest(stable, t1, sampled)
        if self.stages is None:
            _known(stable, "SuperTimeStepping(dt=0.5, stages=9)")
        elif self.stages < 3:
            raise InputError(f"SuperTimeStepping(stages={self.stages}): give 3 or more")
        elif stable is not None and self.stages < stages_for(dt, stable):
            raise InputError(
                f"SuperTimeStepping(dt={dt:g}, stages={self.stages}): a stable step of "
                f"{stable:.6g} s asks for {stages_for(dt, stable)} stages"
            )
        return dt

    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """With the stages that the longest step needs."""
        del scene, traced
        stages = self.stages or stages_for(longest, float(compiled.stable_step))
        return LegendreStepper(stages)


class AbstractImplicit(AbstractSolver):
    """Solvers that solve for the end of a step."""

    tolerance: eqx.AbstractVar[float | None]
    """What a linear solve may leave, largest residual over capacity [K]; None for
    1e-4 K in float32 and 1e-9 K in float64."""

    def suited(self, scene: Scene) -> Scene:
        """Laid out for solves."""
        return for_solves(scene)

    def _tools(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> Tools:
        given = self.tolerance
        return tools(scene, compiled, longest, given, traced)


class BackwardEuler(AbstractImplicit):
    """Implicit Euler: of first order, and no step of it ever overshoots."""

    dt: Any = None
    """[s]; None for 1/128 of the run."""
    tolerance: float | None = None

    @property
    def load_time(self) -> float:
        """At the middle, where its loads are taken."""
        return 0.5

    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """Implicit Euler."""
        return ImplicitStepper(
            self._tools(scene, compiled, longest, traced), BACKWARD_EULER
        )


class CrankNicolson(AbstractImplicit):
    """The trapezoidal rule, of second order; large steps ring.

    A mode that decays at a rate z / dt is multiplied by (1 - z/2) / (1 + z/2), which
    goes to -1: what is switched on rings on for long above a few stable steps.
    """

    dt: Any = None
    """[s]; None for 1/128 of the run."""
    tolerance: float | None = None

    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """The trapezoidal rule."""
        return ImplicitStepper(
            self._tools(scene, compiled, longest, traced), CRANK_NICOLSON
        )


class TRBDF2(AbstractImplicit):
    """Trapezoidal rule and backward differences: second order, damps what is stiff.

    Without a `dt` every step is as long as its `error` allows.
    """

    dt: Any = None
    """[s]; None for steps that follow the error."""
    error: float = 0.01
    """Of a step, where steps follow it [K]."""
    tolerance: float | None = None

    def __check_init__(self):
        if not self.error > 0:
            raise InputError(f"TRBDF2(error={self.error!r}): give a positive one [K]")

    def least_steps(self, landings: int) -> int:
        """One, which follows the error."""
        del landings
        return 1

    def longest(self, stable: float | None, t1: float | int, sampled: bool) -> float:
        """The given step, or the longest way without a landing."""
        if self.dt is None and t1 and not sampled:
            return float(t1) / 16
        return super().longest(stable, t1, sampled)

    def stepper(
        self, scene: Scene, compiled: Compiled, longest: float, traced: bool
    ) -> AbstractStepper:
        """Of given steps, or of the error's."""
        made = self._tools(scene, compiled, longest, traced)
        if self.dt is not None:
            return ImplicitStepper(made, TR_BDF2)
        error = jnp.asarray(self.error, compiled.receipt.dtype)
        return AdaptiveStepper(made, error)


def for_solves(scene: Scene) -> Scene:
    """A scene whose bodies are laid out for linear solves."""
    bodies = tuple(
        replace(body, structure=body.structure.for_solves()) for body in scene.bodies
    )
    return replace(scene, bodies=bodies)


def tools(
    scene: Scene,
    compiled: Compiled,
    longest: float,
    tolerance: float | None,
    traced: bool,
) -> Tools:
    """What implicit steps of a scene need.

    Args:
        scene: that was compiled.
        compiled: the scene.
        longest: step that will be asked for [s].
        tolerance: of linear solves [K]; None for the usual one.
        traced: whether derivatives may be asked for.

    Raises:
        InputError: where conduction is not symmetric.
    """
    dtype, program = compiled.receipt.dtype, compiled.program
    if not all(body.network.symmetric for body in program.bodies):
        raise InputError(
            "a body has weights with `non_orthogonal`, whose conduction is not "
            "symmetric and cannot be solved for: step with ForwardEuler() or "
            "SuperTimeStepping(), or set non_orthogonal to 0"
        )
    stable = compiled.receipt.stable_step_s
    coarse = stable is None or longest > COARSE_RATIO * stable
    levels: tuple[Hierarchy | None, ...] = tuple(
        hierarchy(body.structure, part.network) if coarse else None
        for body, part in zip(scene.bodies, program.bodies, strict=True)
    )
    kelvin = KELVIN[dtype] if tolerance is None else tolerance
    return Tools(
        hierarchies=levels,
        parts=tuple(parts_of(body.structure) for body in scene.bodies),
        nodes=tuple(_nodes(body.structure) for body in scene.bodies),
        ceilings=tuple(_ceiling(part, compiled) for part in program.bodies),
        tolerance=jnp.asarray(kelvin, dtype),
        linear=is_linear(program),
        differentiable=traced,
    )


def _nodes(structure: AbstractStructure) -> Any:
    if len(structure.state_shape) == 1:
        return None
    mask = np.zeros(structure.state_shape, bool)
    mask[structure.node_address()] = True
    return jnp.asarray(mask)


def is_linear(program: Program) -> bool:
    """Whether the balance is linear in all temperatures."""
    return program.enclosure is None and all(
        not isinstance(body.network, NonlinearNetwork)
        and (body.load is None or body.load.places.terms.is_linear)
        for body in program.bodies
    )


def _ceiling(body: BodyProgram, compiled: Compiled) -> Any:
    """What a body's states cannot exceed [K]; infinite where nothing bounds them."""
    dtype = compiled.receipt.dtype
    load = body.load
    if load is None or not any(
        term.law.is_dissipative for _, term in load.places.terms.natural
    ):
        return jnp.asarray(jnp.inf, dtype)
    above = jnp.asarray(compiled.hottest, dtype) - body.reference
    return body.network.state_of(above)
