"""Explicit Euler: one step, many steps, and the step it is stable at.

T_{n+1} = T_n + dt / C (conduction + sum of surface heat rates). Temperatures stay
within their bounds while 1 - dt (sum G + stiffness) / C >= 0 at every node, which is
also the limit of stability: dt = h^2 / (6 alpha) inside a uniform body.
"""

import jax
from jaxtyping import Array, Float

from ...scene.compile.program import Program, State
from ..run.heat_rates import add_loads
from ..stepper import AbstractStepper, RunState


def euler_change(
    program: Program, states: State, time: Float[Array, ""], dt: Float[Array, ""]
) -> tuple[State, Float[Array, " c"]]:
    """The states one step later, and what each entry of the ledger brought [W]."""
    conducted = []
    for body, now in zip(program.bodies, states, strict=True):
        with jax.named_scope("conduction"):
            conducted.append(body.network.euler_step(now, dt))
    return add_loads(program, states, tuple(conducted), time, dt)


class EulerStepper(AbstractStepper):
    """Explicit Euler."""

    @property
    def two_buffers(self) -> bool:
        """Yes."""
        return True

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
        """One step of every body, with the heat each mechanism brought entered.

        Loads are taken at the middle of the step: the heat of a ramp is exact, and what
        is switched off at a landing is on before it and off after it.
        """
        new, rates = euler_change(program, state.theta, start + dt / 2, dt)
        return RunState(new, state.ledger.add(dt * rates), state.solver_state)
