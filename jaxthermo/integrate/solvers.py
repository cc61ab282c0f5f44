"""The time integration schemes that a user chooses from, and the default choice.

| solver | order | stability | use |
|---|---|---|---|
| `ForwardEuler` | 1 | up to the stable step | comparison, no overshoot but in columns |
| `SuperTimeStepping` | 2 | by stages, n stable steps cost 2 sqrt(n) | long runs |
| `BackwardEuler` | 1 | L-stable, no overshoot | very stiff scenes, huge steps |
| `TRBDF2` | 2 | L-stable, step by error control | stiff scenes, to a stated error |
| `CrankNicolson` | 2 | A-stable, oscillates above the stable step | comparison |
| `ErrorControl` | 2 | that of the solver it selects | the default: to a stated error |
"""

import abc
import math
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from equinox import Module
from typing_extensions import override

from ..arrays import Number
from ..errors import InputError
from ..physics.time_varying import SAMPLES
from ..scene.compile.memory import Method
from ..scene.compile.program import Compiled
from ..scene.scene import Scene
from .explicit import (
    MIN_STAGES,
    EulerStepper,
    RKL2Stepper,
    stable_length,
    stage_count,
)
from .implicit.adaptive import AdaptiveStepper
from .implicit.jacobian import arranged_for_solves, implicit_context
from .implicit.runge_kutta import (
    BACKWARD_EULER,
    CRANK_NICOLSON,
    TR_BDF2,
    ImplicitStepper,
    Tableau,
)
from .part_stepper import StagePart, in_parts
from .stepper import AbstractStepper


_DEFAULT_STEPS = 128
"""Number of steps of a run whose step nothing else determines."""

# What is switched at an event changes fast at first, so that each interval between
# events gets several steps by default, unless there are very many intervals.
_MIN_STEPS_AFTER_EVENT = 16

MAX_REFINED_EVENTS = 64
"""Number of events up to which the intervals between them get several steps."""

_FIRST_STEPS = 8
"""Number of steps of the first pass of several."""

_FIRST_ERROR = 0.08
"""Error of an adaptive step in the first pass of several [K]."""

MAX_RKL2_STEPS = 5_000_000
"""Number of stable steps above which even their square root is too many."""


class AbstractSolver(Module):
    """Time integration scheme: how long steps are, and what takes them."""

    load_fraction: ClassVar[float] = 1.0
    """Position in the last step, 0 to 1, of the loads that an observation uses."""
    method: ClassVar[Method] = "euler"
    """Kind of steps, for the forecast of memory."""
    dt: eqx.AbstractVar[Any]
    """Step [s]; None if the solver chooses it."""

    def min_steps(self, events: int) -> int:
        """Return the smallest number of steps between two of the run's events."""
        refined = self.dt is None and events <= MAX_REFINED_EVENTS
        return _MIN_STEPS_AFTER_EVENT if refined else 1

    def max_dt(
        self, stable_step: float | None, t1: float | int, sampled: bool
    ) -> float:
        """Return the longest step that will be taken in a run to `t1` [s].

        `stable_step` is the largest stable explicit step [s], None if it is traced;
        `sampled` is True if a value is a function of time that is known only where it
        is evaluated.
        """
        del stable_step
        if self.dt is not None:
            return _positive_step(self.dt)
        # A sampled function of time must not change unseen within a step.
        return float(t1) / (SAMPLES if sampled else _DEFAULT_STEPS) if t1 else 1.0

    def longest_stable_step(self, stable_step: Any) -> Any:
        """Return the longest stable step of this scheme [s]; infinite for any length.

        `stable_step` is the largest stable explicit step [s], which may be traced.
        """
        del stable_step
        return math.inf

    def arranged(self, scene: Scene) -> Scene:
        """Return the scene with its bodies stored as this solver runs fast."""
        return scene

    @abc.abstractmethod
    def stepper(
        self,
        scene: Scene,
        compiled: Compiled,
        stable_step: float | None,
        max_dt: float,
        traced: bool,
    ) -> AbstractStepper:
        """Return the stepper of a compiled scene for steps of up to `max_dt` [s].

        `stable_step` is as in `max_dt`; `traced` is True if derivatives may be needed.
        """


def _positive_step(dt: Any) -> float:
    step = float(dt)
    if not (step > 0 and math.isfinite(step)):
        raise InputError(f"solver: dt={step:g} is no step; give a positive time")
    return step


def _required(stable_step: float | None, example: str) -> float:
    if stable_step is None:
        raise InputError(
            "simulate: the stable step depends on traced values; give the step, as in "
            f"solver={example}"
        )
    return stable_step


class ForwardEuler(AbstractSolver):
    """Explicit Euler: first order, stable up to the stable step.

    No overshoot, but where the surface has columns of thin cells.

        T_{n+1} = T_n + dt / C (K T_n + q(T_n, t_n + dt/2)),

    K T the heat rates by conduction, q those of the terms [W], C capacities [J/K].
    Stable where dt (sum_j G_ij - dq_i/dT_i) <= C_i at every node i: in a uniform body
    dt <= h^2 / (6 alpha), h the voxel's edge [m], alpha the diffusivity [m^2/s].

    Source: Patankar, Numerical Heat Transfer and Fluid Flow (1980), section 4.3.
    """

    # Euler steps take their loads at the middle.
    load_fraction = 0.5
    dt: Number | None = None
    """Step [s]; None for the largest stable step."""

    @override
    def min_steps(self, events: int) -> int:
        # The stable step is short enough after any event.
        return 1

    @override
    def max_dt(self, stable_step, t1, sampled) -> float:
        if self.dt is None:
            dt = _required(stable_step, "ForwardEuler(dt=0.1)")
            return min(dt, t1 / SAMPLES) if sampled and t1 > 0 else dt
        dt = _positive_step(self.dt)
        # A step that the user computed as the stable one may exceed it by rounding.
        if stable_step is not None and dt > stable_step * (1 + 1e-6):
            raise InputError(
                f"solver: dt={dt:g} s is too long: the largest stable step of this "
                f"scene is {stable_step:.6g} s; give that or less, or no dt to have it "
                "chosen, or another solver: SuperTimeStepping() or TRBDF2(), in a file "
                "`solver: super_time_stepping` or `solver: trbdf2`"
            )
        return dt

    @override
    def longest_stable_step(self, stable_step: Any) -> Any:
        return stable_step

    @override
    def stepper(self, scene, compiled, stable_step, max_dt, traced) -> AbstractStepper:
        return EulerStepper()


class SuperTimeStepping(AbstractSolver):
    """Runge-Kutta-Legendre scheme RKL2: explicit, second order, steps of many stages.

    s stages are stable up to dt = (s^2 + s - 2) / 4 stable steps, so that n stable
    steps cost about 2 sqrt(n) evaluations. No overshoot in pure diffusion.

    Source: Meyer, Balsara, Aslam, Journal of Computational Physics 257 (2014) 594-626.
    """

    method = "stages"
    dt: Number | None = None
    """Step [s]; None for 1/128 of the run."""
    stages: int | None = eqx.field(static=True, default=None)
    """Number of stages of every step; None for the smallest stable number."""

    @override
    def max_dt(self, stable_step, t1, sampled) -> float:
        dt = super().max_dt(stable_step, t1, sampled)
        # The number of stages is static, so that it cannot follow a traced stable step.
        if self.stages is None:
            _required(stable_step, "SuperTimeStepping(dt=0.5, stages=9)")
        elif self.stages < MIN_STAGES:
            raise InputError(f"SuperTimeStepping(stages={self.stages}): give 3 or more")
        elif stable_step is not None and self.stages < stage_count(dt, stable_step):
            raise InputError(
                f"solver: stages={self.stages} of super time stepping are too few for "
                f"dt={dt:g} s: a stable step of {stable_step:.6g} s requires "
                f"{stage_count(dt, stable_step)}"
            )
        return dt

    @override
    def longest_stable_step(self, stable_step: Any) -> Any:
        if self.stages is None:
            return math.inf
        return stable_length(self.stages) * stable_step

    @override
    def stepper(self, scene, compiled, stable_step, max_dt, traced) -> AbstractStepper:
        if self.stages is not None:
            return RKL2Stepper(self.stages)

        def stepper_of(stage_part: StagePart) -> RKL2Stepper:
            fixed = RKL2Stepper(stage_part.stages)
            # Derivatives in reverse need a number that is known when they are compiled.
            return fixed if traced else fixed.for_any_count()

        return in_parts(compiled, max_dt, stepper_of)


class _AbstractImplicit(AbstractSolver):
    """Schemes that solve a system of equations in every step."""

    method = "implicit"
    _tableau: ClassVar[Tableau]
    tolerance: eqx.AbstractVar[float | None]
    """Largest residual of a linear solve over capacity [K]; None for 1e-4 K in float32
    and 1e-9 K in float64, or what rounding leaves where that is more."""

    @override
    def arranged(self, scene: Scene) -> Scene:
        return arranged_for_solves(scene)

    @override
    def stepper(self, scene, compiled, stable_step, max_dt, traced) -> AbstractStepper:
        context = implicit_context(
            scene,
            compiled=compiled,
            stable_step=stable_step,
            max_dt=max_dt,
            tolerance=self.tolerance,
            traced=traced,
        )
        return ImplicitStepper(context, self._tableau)


class BackwardEuler(_AbstractImplicit):
    """Implicit Euler: first order, L-stable, never overshoots.

    T_{n+1} = T_n + dt / C (K T_{n+1} + q(T_{n+1}, t_n + dt/2)), see `ForwardEuler`.

    Source: Hairer, Wanner, Solving Ordinary Differential Equations II (1996), IV.3.
    """

    load_fraction = 0.5
    _tableau = BACKWARD_EULER
    dt: Number | None = None
    """Step [s]; None for 1/128 of the run."""
    tolerance: float | None = None


class CrankNicolson(_AbstractImplicit):
    """Trapezoidal rule: second order, A-stable, oscillates at large steps.

    With f = (K T + q) / C [K/s], T_{n+1} = T_n + dt (f_n + f_{n+1}) / 2. A mode that
    decays at a rate z / dt is multiplied by (1 - z/2) / (1 + z/2), which goes to -1:
    above a few stable steps, what is switched on oscillates for long.

    Source: Crank, Nicolson, Proc. Cambridge Philosophical Society 43 (1947) 50-67.
    """

    _tableau = CRANK_NICOLSON
    dt: Number | None = None
    """Step [s]; None for 1/128 of the run."""
    tolerance: float | None = None


class TRBDF2(_AbstractImplicit):
    """Trapezoidal rule, then backward differences: second order, L-stable.

    A step of the trapezoidal rule to t + (2 - sqrt 2) dt, then one of BDF2 to t + dt.
    Without a `dt` an embedded third-order formula controls the step.

    Source: Hosea, Shampine, Applied Numerical Mathematics 20 (1996) 21-37.
    """

    _tableau = TR_BDF2
    dt: Number | None = None
    """Step [s]; None for steps by error control."""
    error: float = 0.01
    """Largest error of one step under error control [K]."""
    tolerance: float | None = None

    def __check_init__(self):
        if not self.error > 0:
            raise InputError(f"TRBDF2(error={self.error!r}): give a positive one [K]")

    @override
    def min_steps(self, events: int) -> int:
        return 1

    @override
    def max_dt(self, stable_step, t1, sampled) -> float:
        # Under error control a scheduled step is the whole way to the next event.
        if self.dt is None and t1 and not sampled:
            return float(t1) / 16
        return super().max_dt(stable_step, t1, sampled)

    @override
    def stepper(self, scene, compiled, stable_step, max_dt, traced) -> AbstractStepper:
        if self.dt is not None:
            return super().stepper(
                scene,
                compiled=compiled,
                stable_step=stable_step,
                max_dt=max_dt,
                traced=traced,
            )
        context = implicit_context(
            scene,
            compiled=compiled,
            stable_step=stable_step,
            max_dt=max_dt,
            tolerance=self.tolerance,
            traced=traced,
        )
        return AdaptiveStepper(context, jnp.asarray(self.error, compiled.receipt.dtype))


class ErrorControl(AbstractSolver):
    """Second order, with the number of steps that an error in time requires.

    The run is repeated with steps half as long until the estimate of its error, at any
    fragment and saved time, is within `relative_error` of the largest range of the
    surface temperatures, or `error`. The receipt gives the estimate, see
    `Solution.run.time_error`. Steps are those of `SuperTimeStepping`, or above 5
    million stable steps of `TRBDF2`. Where values are traced nothing can be repeated:
    the run takes the default steps of one of these two, and its error is not estimated.
    """

    relative_error: float = eqx.field(static=True, default=1e-3)
    """Error over the largest range of the surface temperatures at a saved time [-]."""
    error: float = eqx.field(static=True, default=1e-3)
    """Error that is small enough at any range [K]."""
    dt: None = eqx.field(init=False, static=True, default=None)

    def __check_init__(self):
        for name in ("relative_error", "error"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise InputError(f"ErrorControl({name}={value!r}): give a positive one")

    def first(
        self, stable_step: float, t1: float | int, symmetric: bool, sampled: bool
    ) -> tuple[AbstractSolver, str]:
        """Return the solver and the steps of the first pass, with the reason."""
        steps = _stable_steps(stable_step, t1)
        if symmetric and t1 > MAX_RKL2_STEPS * stable_step:
            return TRBDF2(error=_FIRST_ERROR), steps
        # Two passes that both miss a pulse would agree.
        count = SAMPLES if sampled else _FIRST_STEPS
        return SuperTimeStepping(dt=t1 / count), steps

    @override
    def stepper(self, scene, compiled, stable_step, max_dt, traced) -> AbstractStepper:
        # The stepper of one pass; `first` selects that of a run.
        return SuperTimeStepping().stepper(
            scene,
            compiled=compiled,
            stable_step=stable_step,
            max_dt=max_dt,
            traced=traced,
        )


def _stable_steps(stable_step: float, t1: float | int) -> str:
    # Two digits, but not as 1.5e+03.
    number = float(f"{t1 / stable_step:.2g}")
    return f"{number:,g} stable steps of {stable_step:.3g} s"


def select_solver(
    stable_step: float | None, t1: float | int, symmetric: bool = True
) -> tuple[AbstractSolver, str]:
    """Select a solver by the number of stable explicit steps, with the reason.

    It serves runs that cannot be repeated, since values are traced. All choices are of
    second order: Euler steps as long as is stable are several percent off where a run
    has few of them. Where conduction is not `symmetric` only explicit solvers can be
    chosen.
    """
    if stable_step is None:
        return ForwardEuler(), "the stable step is traced"
    steps = _stable_steps(stable_step, t1)
    if not symmetric:
        return SuperTimeStepping(), f"{steps}, and conduction is not symmetric"
    if t1 <= MAX_RKL2_STEPS * stable_step:
        return SuperTimeStepping(), steps
    return TRBDF2(), steps
