"""Super time stepping: explicit steps far beyond the stable one (RKL2).

s stages of a Runge-Kutta-Legendre scheme of second order cover

    dt = (s^2 + s - 2) / 4  stable steps,

so that n stable steps cost about 2 sqrt(n) evaluations. Each stage is an explicit Euler
step of length w dt, w = 4 / (s^2 + s - 2), mixed with the two before and the start:

    Y_j = mu_j E(Y_{j-1}) + nu_j Y_{j-2} + (1 - mu_j - nu_j) Y_0 - a_{j-1} mu_j D,
    D = E(Y_0) - Y_0.

The ledger is mixed likewise, so that energy closes to rounding. For pure diffusion no
stage overshoots.

Source: Meyer, Balsara, Aslam, Journal of Computational Physics 257 (2014) 594-626.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...scene.compile.program import Program, State
from ..run.heat_rates import add_loads
from ..stepper import AbstractStepper, RunState


MIN_STAGES = 3


def stage_count(dt: float, stable: float) -> int:
    """The least odd number of stages that a step is stable with.

    Args:
        dt: the step [s].
        stable: the largest explicit one [s].
    """
    ratio = dt / stable
    stages = math.ceil((math.sqrt(9 + 16 * ratio) - 1) / 2 * (1 - 1e-9))
    return max(MIN_STAGES, stages + (stages + 1) % 2)


def rkl2_coefficients(stages: int) -> dict[str, np.ndarray]:
    """Mu, nu, a of the stage before, and where a stage takes its loads, by stage.

    Args:
        stages: s.
    """
    j = np.arange(stages + 1, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        b = np.where(j < 3, 1 / 3, (j * j + j - 2) / (2 * j * (j + 1)))
        mu = (2 * j - 1) / j * b / np.roll(b, 1)
        nu = -(j - 1) / j * b / np.roll(b, 2)
    a, weight = np.roll(1 - b, 1), 4 / (stages * stages + stages - 2)
    # Time itself, integrated by the scheme.
    reached = [0.0, weight / 3]
    for k in range(2, stages + 1):
        stepped = mu[k] * (reached[-1] + weight) + nu[k] * reached[-2]
        reached.append(stepped - a[k] * mu[k] * weight)
    return {"mu": mu, "nu": nu, "a": a, "time": np.roll(reached, 1)}


Mixed = tuple[State, Float[Array, " c"]]
"""A state, and the heat that each entry has brought since the start of the step [J]."""


class RKL2Stepper(AbstractStepper):
    """RKL2 with a fixed number of stages."""

    stages: int = eqx.field(static=True)

    def begin(self, state: RunState) -> RunState:
        """As it is."""
        return state

    def step(
        self,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """One step of all stages."""
        weight = 4 / (self.stages**2 + self.stages - 2)
        table = {
            name: jnp.asarray(values, dt.dtype)
            for name, values in rkl2_coefficients(self.stages).items()
        }
        none = jnp.zeros_like(state.ledger.heat)
        theta, bodies, span = state.theta, program.bodies, dt * weight

        def conducted(states: State) -> State:
            each = zip(bodies, states, strict=True)
            return tuple(body.network.euler_step(own, span) for body, own in each)

        def loaded(new: State, states: State, share, part) -> Mixed:
            """With the loads of a part of a stage, and their heat."""
            time = start + dt * share
            warm, entries = add_loads(program, states, new, time, span * part)
            return warm, span * entries

        whole = jnp.ones((), dt.dtype)
        after, heat = loaded(conducted(theta), theta, 0.0, whole)
        change = jax.tree.map(jnp.subtract, after, theta)
        # b_1 = 1/3 of a whole Euler step.
        third = jax.tree.map(lambda y, d: y + d / 3, theta, change)
        first: tuple[Mixed, Mixed] = ((theta, none), (third, heat / 3))

        def stage(j, pair):
            (before, heat_before), (last, heat_last) = pair
            mu, nu, a = table["mu"][j], table["nu"][j], table["a"][j]
            # Differences to the start: what has not changed stays so bit by bit, and
            # weights of about 2 and -1 multiply no rounding of what is large.
            mix = lambda e, y, zero, d: (
                zero + (mu * (e - zero) + nu * (y - zero) - a * mu * d)
            )
            # Mixed before loads are added, all is done in one pass over the nodes.
            mixed = jax.tree.map(mix, conducted(last), before, theta, change)
            new, brought = loaded(mixed, last, table["time"][j], mu)
            total = mu * (heat_last + brought) + nu * heat_before - a * mu * heat
            return pair[1], (new, total)

        # Two stages an iteration trade their buffers; one would copy them.
        both = lambda i, pair: stage(2 * i + 3, stage(2 * i + 2, pair))
        pair = jax.lax.fori_loop(0, (self.stages - 1) // 2, both, first)
        if self.stages % 2 == 0:
            pair = stage(self.stages, pair)
        end, total = pair[1]
        return RunState(end, state.ledger.add(total), state.solver_state)
