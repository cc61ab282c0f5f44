"""What goes from step to step, and what a solver is."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from ...scene.compile.program import Program, State
from .ledger import Ledger


class RunState(eqx.Module):
    """What goes from step to step."""

    theta: State
    ledger: Ledger
    work: Any = None
    """A solver's own."""


class AbstractStepper(eqx.Module):
    """Takes steps of a program: a solver with all that it has made for the scene."""

    @property
    def two_buffers(self) -> bool:
        """Whether a step is so cheap that copying the state would show."""
        return False

    @abc.abstractmethod
    def begin(self, state: RunState) -> RunState:
        """The state with the solver's own work, at the start of a run."""

    @abc.abstractmethod
    def step(
        self,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """The state one step later, with what each mechanism brought entered.

        Args:
            program: of the scene.
            state: at the start.
            start: of the step [s].
            dt: its length [s].
        """
