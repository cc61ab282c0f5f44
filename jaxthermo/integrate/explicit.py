"""Explicit steps: Euler's, see `ForwardEuler`, and RKL2, far above the stable step.

Both eliminate the columns of a body, see `network.columns`.

s stages of a Runge-Kutta-Legendre scheme of second order cover

    dt = (s^2 + s - 2) / 4  stable steps,

so that n stable steps cost about 2 sqrt(n) evaluations. Each stage is an explicit Euler
step E of length w dt, w = 4 / (s^2 + s - 2), combined with the two stages before it and
the start. In the changes since the start, d_j = Y_j - Y_0,

    d_j = mu_j (E(Y_0 + d_{j-1}) - Y_0) + nu_j d_{j-2} - a_{j-1} mu_j D,
    D = E(Y_0) - Y_0,

where conduction acts on d_{j-1} alone and that at the start is added: hundreds of
stages would otherwise round temperatures whose changes are far smaller. In pure
diffusion no stage overshoots.

The ledger is combined in the same way, so that energy closes. Since no heat rate acts
on a heat, its recursion is two sums, which hundreds of stages do not round more than
one: with H_j = b_j u_j and the heat rates r_j of the stages,

    S_j = S_{j-1} + (2 j - 1) w dt (r_{j-1} - a_{j-1} r_0) / b_{j-1},
    u_j = u_{j-1} + S_j / j,    u_1 = S_1 = w dt r_0.

Source: Meyer, Balsara, Aslam, Journal of Computational Physics 257 (2014) 594-626.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import override

from ..arrays import device_array
from ..network.columns import FILTER_TIME, ColumnFactors
from ..network.network import AbstractNetwork, StepStart
from ..scene.compile.body_program import BodyProgram
from ..scene.compile.memory import Method
from ..scene.compile.program import Program, State
from .heat_rates import add_loads
from .stepper import AbstractStepper, RunState, is_copied_fast


class _Coefficients(NamedTuple):
    """Coefficients of one stage, see the docstring of this module."""

    mu: Float[Array, ""]
    nu: Float[Array, ""]
    a: Float[Array, ""]


class _Changes(NamedTuple):
    """Changes of a body since the start of a step, by earlier stages."""

    latest: Float[Array, "..."]
    previous: Float[Array, "..."]
    first: Float[Array, "..."]
    """Change by an Euler step from the start."""


class _Conduction(NamedTuple):
    """Explicit conduction of one body, before loads and after them."""

    network: AbstractNetwork

    def conducted(
        self, theta: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """State after a step of conduction, which loads are added to."""
        return self.network.euler_step(theta, dt)

    def stepped(
        self, theta: Float[Array, "..."], loaded: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """State after a step, with the loads in what is `conducted`."""
        return loaded

    def filtered(self, rise: Float[Array, "..."]) -> Float[Array, "..."]:
        """Rise of the first stage, with its loads."""
        return rise

    def mixed(
        self,
        step_start: StepStart,
        dt: Float[Array, ""],
        coefficients: _Coefficients,
        changes: _Changes,
    ) -> Float[Array, "..."]:
        """Change of a stage before loads."""
        return self.network.combined_step(
            changes.latest,
            step_start,
            dt,
            _mixed,
            changes.previous,
            changes.first,
            *coefficients,
        )

    def finished(
        self,
        loaded: Float[Array, "..."],
        coefficients: _Coefficients,
        changes: _Changes,
    ) -> Float[Array, "..."]:
        """Change of a stage, with the loads in what is `mixed`."""
        return loaded


class _ColumnConduction(NamedTuple):
    """The same with columns: loads are added to a rise, which is then filtered."""

    network: AbstractNetwork
    factors: ColumnFactors

    def conducted(
        self, theta: Float[Array, "..."], dt: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """Rise by a step of conduction, which loads are added to."""
        return self.network.euler_rise(theta, dt)

    def stepped(
        self, theta: Float[Array, "..."], loaded: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """State after a step that is implicit in the columns."""
        return theta + self.factors.backward(loaded)

    def filtered(self, rise: Float[Array, "..."]) -> Float[Array, "..."]:
        """Rise of the first stage, with its loads."""
        return self.factors.filtered(rise)

    def mixed(
        self,
        step_start: StepStart,
        dt: Float[Array, ""],
        coefficients: _Coefficients,
        changes: _Changes,
    ) -> Float[Array, "..."]:
        """Rise of a stage before loads."""
        latest = changes.latest
        return self.network.combined_step(
            latest, step_start, dt, _rise, latest, coefficients.mu
        )

    def finished(
        self,
        loaded: Float[Array, "..."],
        coefficients: _Coefficients,
        changes: _Changes,
    ) -> Float[Array, "..."]:
        """Change of a stage, with the loads in its rise."""
        before = _mixed(
            changes.latest, 0, changes.previous, changes.first, *coefficients
        )
        return before + self.factors.filtered(loaded)


def _conduction(
    program: Program, span: Float[Array, ""]
) -> list[_Conduction | _ColumnConduction]:
    """Conduction of each body; columns are solved over a span of time [s]."""
    conduction: list[_Conduction | _ColumnConduction] = []
    for body in program.bodies:
        columns = body.network.columns
        if columns is None:
            conduction.append(_Conduction(body.network))
        else:
            factors = columns.factored(span)
            conduction.append(_ColumnConduction(body.network, factors))
    return conduction


class EulerStepper(AbstractStepper):
    """Explicit Euler: first order, stable up to the stable step."""

    two_buffers = True

    @property
    @override
    def method(self) -> Method:
        return "euler"

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        conduction = _conduction(program, dt)
        with jax.named_scope("conduction"):
            pairs = zip(conduction, state.theta, strict=True)
            conducted = tuple(body.conducted(theta, dt) for body, theta in pairs)
        # Loads at the middle of the step: the heat of a ramp is exact, and what is
        # switched off at an event is on before it and off after it.
        middle = start + dt / 2
        loaded, rates = add_loads(
            program, states=state.theta, new=conducted, time=middle, dt=dt
        )
        pairs = zip(conduction, state.theta, loaded, strict=True)
        new = tuple(body.stepped(theta, change) for body, theta, change in pairs)
        return RunState(new, state.ledger.add(dt * rates), state.solver_state)


MIN_STAGES = 3
"""Number of stages of the shortest step: with 2 the scheme covers no time."""

_MIN_COLUMN_STAGES = 5
"""The same with columns, which are filtered over the time of one stage: with 3 stages
that is half of the step, whose error is several times that of the scheme."""


def least_stages(bodies: Sequence[BodyProgram]) -> int:
    """Return the number of stages of the shortest step of some groups of bodies."""
    has_columns = any(body.network.columns is not None for body in bodies)
    return _MIN_COLUMN_STAGES if has_columns else MIN_STAGES


def stage_count(dt: float, stable_step: float, least: int = MIN_STAGES) -> int:
    """Return the smallest odd number of stages, of at least so many, that is stable."""
    ratio = dt / stable_step
    # Less a rounding, so that a ratio that fits exactly costs no stage more.
    stages = math.ceil((math.sqrt(9 + 16 * ratio) - 1) / 2 * (1 - 1e-9))
    return max(least, stages + (stages + 1) % 2)


def stable_length(stages: Any) -> Any:
    """Longest step of a number of stages, in stable explicit steps [-]."""
    return (stages**2 + stages - 2) / 4


def rkl2_coefficients(stages: int) -> dict[str, np.ndarray]:
    """Return mu, nu, b, the last stage's a, and the load time in steps, by stage."""
    j = np.arange(stages + 1, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        b = np.where(j < 3, 1 / 3, (j * j + j - 2) / (2 * j * (j + 1)))
        mu = (2 * j - 1) / j * b / np.roll(b, 1)
        nu = -(j - 1) / j * b / np.roll(b, 2)
    a = np.roll(1 - b, 1)
    weight = 4 / (stages * stages + stages - 2)
    # The time that each stage reaches is the scheme's solution of dt/dt = 1.
    reached = [0.0, weight / 3]
    for k in range(2, stages + 1):
        stepped = mu[k] * (reached[-1] + weight) + nu[k] * reached[-2]
        reached.append(stepped - a[k] * mu[k] * weight)
    return {"mu": mu, "nu": nu, "b": b, "a": a, "time": np.roll(reached, 1)}


def _mixed(stepped, rise, previous, first_change, mu, nu, a):
    """Change of a stage before loads, from the Euler step of the last one."""
    # The rise is not added to the step itself: XLA would compute that twice where only
    # some of its nodes are corrected.
    return mu * stepped + (mu * (rise - a * first_change) + nu * previous)


def _rise(stepped, rise, change, mu):
    """Rise by the conduction of a stage, without the changes that it is added to."""
    return mu * (stepped - change + rise)


class _Stages(NamedTuple):
    """The last two stages, and the heat of all stages by ledger entry."""

    previous: State
    latest: State
    """Changes of the states since the start of the step."""
    heat: Float[Array, " c"]
    """u_j [J]."""
    weighted_heat: Float[Array, " c"]
    """S_j [J]."""


class RKL2Stepper(AbstractStepper):
    """RKL2 with the same number of stages in every step: second order."""

    stages: int = eqx.field(static=True)
    """Number of stages of every step, or the largest number of any step."""
    stable_step: Float[Array, ""] | None = None
    """Largest stable explicit step [s], if the number of stages follows from the length
    of each step: one compiled program then serves steps of any length."""
    count: Int[Any, ""] | None = None
    """Odd number of stages of every step, if it is an argument of the compiled program:
    other materials then need no other program."""

    @property
    @override
    def method(self) -> Method:
        return "stages"

    @property
    def stages_taken(self) -> int:
        """Number of stages of every step, or the largest number of any step."""
        return self.stages if self.count is None else int(self.count)

    @property
    def _max_stages(self) -> int:
        # A power of 2: runs that differ little share the program.
        return max(64, 2 ** math.ceil(math.log2(self.stages + 3)))

    def for_any_step(self, stable_step: float, dtype: Any) -> "RKL2Stepper":
        """Return the stepper of steps of any length, up to the longest of this one."""
        return RKL2Stepper(
            self._max_stages, device_array(np.asarray(stable_step), dtype)
        )

    def for_any_count(self) -> "RKL2Stepper":
        """Return the same steps in a program for other numbers of stages too."""
        # A numpy array: it is transferred together with the other arguments.
        count = np.asarray(self.stages, np.int32)
        return RKL2Stepper(self._max_stages, count=count)

    @property
    def _is_fixed(self) -> bool:
        return self.stable_step is None and self.count is None

    def _stages(self, dt: Float[Array, ""], least: int) -> tuple[Any, Any]:
        """Return the pairs of stages after the first, and the weight w.

        `least` is the number of stages of the shortest step.
        """
        if self._is_fixed:
            return (self.stages - 1) // 2, 1 / stable_length(self.stages)
        if self.count is not None:
            stages = self.count.astype(dt.dtype)
            return (self.count - 1) // 2, 1 / stable_length(stages)
        assert self.stable_step is not None
        # As in `stage_count`, but that a rounding may cost two stages more.
        root = jnp.sqrt(9 + 16 * dt / self.stable_step)
        pairs = jnp.ceil(((root - 1) / 2 * (1 + 1e-5) - 1) / 2)
        pairs = jnp.clip(pairs, (least - 1) // 2, (self.stages - 1) // 2)
        stages = 2 * pairs + 1
        return pairs.astype(jnp.int32), 1 / stable_length(stages)

    def _table(self, weight: Any) -> dict[str, Float[Array, " s"]]:
        """Coefficients by stage, see `rkl2_coefficients`."""
        dtype = jnp.asarray(weight).dtype
        table = {
            name: jnp.asarray(values, dtype)
            for name, values in rkl2_coefficients(self.stages).items()
        }
        if not self._is_fixed:
            # Only the times depend on the number of stages, as the weight does.
            table["time"] *= weight * stable_length(self.stages)
        return table

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        pairs, weight = self._stages(dt, least_stages(program.bodies))
        table = self._table(jnp.asarray(weight, dt.dtype))
        theta = state.theta
        euler_dt = dt * weight

        def load(new: State, changes: State, time_fraction, dt_fraction):
            loaded, rates = add_loads(
                program,
                states=changes,
                new=new,
                time=start + dt * time_fraction,
                dt=euler_dt * dt_fraction,
                start=theta,
            )
            return loaded, euler_dt * rates

        one_step = jnp.ones((), dt.dtype)
        no_change = jax.tree.map(jnp.zeros_like, theta)
        conduction = _conduction(program, FILTER_TIME * euler_dt)
        step_starts = tuple(
            StepStart(state, body.network.euler_rise(state, euler_dt))
            for body, state in zip(program.bodies, theta, strict=True)
        )
        first_rise, start_heat = load(
            tuple(step_start.rise for step_start in step_starts),
            changes=no_change,
            time_fraction=0.0,
            dt_fraction=one_step,
        )
        first_change = tuple(
            body.filtered(rise)
            for body, rise in zip(conduction, first_rise, strict=True)
        )
        # The first stage is b_1 = 1/3 of an Euler step.
        third = jax.tree.map(lambda change: change / 3, first_change)
        first = _Stages(
            previous=no_change,
            latest=third,
            heat=start_heat,
            weighted_heat=start_heat,
        )

        def stage(j, stages: _Stages) -> _Stages:
            previous = stages.previous
            latest = stages.latest
            mu = table["mu"][j]
            a = table["a"][j]
            coefficients = _Coefficients(mu, table["nu"][j], a)
            changes = tuple(map(_Changes, latest, previous, first_change))
            bodies = list(zip(conduction, changes, step_starts, strict=True))
            # Combined before loads are added, so that one pass over the nodes suffices.
            mixed = tuple(
                body.mixed(step_start, euler_dt, coefficients, body_changes)
                for body, body_changes, step_start in bodies
            )
            loaded, added_heat = load(
                mixed, changes=latest, time_fraction=table["time"][j], dt_fraction=mu
            )
            new = tuple(
                body.finished(rise, coefficients, body_changes)
                for (body, body_changes, _), rise in zip(bodies, loaded, strict=True)
            )
            number = jnp.asarray(j, dt.dtype)
            gain = (2 * number - 1) / (1 - a) * (added_heat - a * start_heat)
            weighted_heat = stages.weighted_heat + gain
            return _Stages(
                previous=latest,
                latest=new,
                heat=stages.heat + weighted_heat / number,
                weighted_heat=weighted_heat,
            )

        def two_stages(i, stages: _Stages) -> _Stages:
            # Two stages per iteration exchange their buffers; one copies them.
            return stage(2 * i + 3, stage(2 * i + 2, stages))

        if is_copied_fast(theta):
            end = jax.lax.fori_loop(2, 2 * pairs + 2, stage, first)
        else:
            end = jax.lax.fori_loop(0, pairs, two_stages, first)
        last = 2 * pairs + 1
        if self._is_fixed and self.stages % 2 == 0:
            last = self.stages
            end = stage(last, end)
        theta = jax.tree.map(jnp.add, theta, end.latest)
        total = table["b"][last] * end.heat
        return RunState(theta, state.ledger.add(total), state.solver_state)
