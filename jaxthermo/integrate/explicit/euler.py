"""Explicit Euler steps.

    T_{n+1} = T_n + dt / C (K T_n + q(T_n, t_n + dt/2)),

K T the heat rates by conduction [W], q those of loads, C the capacities [J/K]. The
temperatures stay within their bounds while 1 - dt (sum_j G_ij - dq_i/dT_i) / C_i >= 0
at every node, which is also the limit of stability.
"""

import jax
from typing_extensions import override

from ...scene.compile.program import Program
from ..run.heat_rates import add_loads
from ..stepper import AbstractStepper, RunState


class EulerStepper(AbstractStepper):
    """Explicit Euler: first order, stable up to the stable step."""

    two_buffers = True

    @override
    def begin(self, state: RunState) -> RunState:
        return state

    @override
    def step(self, program: Program, state: RunState, start, dt) -> RunState:
        conducted = []
        for body, theta in zip(program.bodies, state.theta, strict=True):
            with jax.named_scope("conduction"):
                conducted.append(body.network.euler_step(theta, dt))
        # Loads at the middle of the step: the heat of a ramp is exact, and what is
        # switched off at an event is on before it and off after it.
        middle = start + dt / 2
        new, rates = add_loads(program, state.theta, tuple(conducted), middle, dt)
        return RunState(new, state.ledger.add(dt * rates), state.solver_state)
