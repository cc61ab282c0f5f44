"""The state of a run, the interface of all steppers, and the loop over their steps."""

import abc
from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
from equinox import Module
from jaxtyping import Array, Float

from ..arrays import is_traced
from ..scene.compile.memory import Method
from ..scene.compile.program import Program, State
from .ledger import Ledger


class RunState(Module):
    """Everything that one step passes to the next."""

    theta: State
    ledger: Ledger
    solver_state: Any = None
    """Statistics and controller memory of the stepper; None for explicit steppers."""


class AbstractStepper(Module):
    """One-step method, with everything that it precomputes for a scene."""

    two_buffers: ClassVar[bool] = False
    """True if a step is so cheap that copying the state would be noticeable."""

    @property
    @abc.abstractmethod
    def method(self) -> Method:
        """Kind of steps, for the forecast of memory."""

    def begin(self, state: RunState) -> RunState:
        """Return the state with the stepper's own initial `solver_state`."""
        return state

    @abc.abstractmethod
    def step(
        self,
        program: Program,
        state: RunState,
        start: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> RunState:
        """Return the state one step later, with the ledger updated.

        The program is that of a window, from whose start `start` counts [s].
        """


class LoopArguments(NamedTuple):
    """Arguments of a loop over steps that are not overwritten.

    These are all but the temperatures: the other arrays of a state are small, and
    shared by several runs.
    """

    stepper: AbstractStepper
    program: Program
    ledger: Ledger
    solver_state: Any
    steps: Any
    """A `StepTable`, or the `Span` of one segment."""

    def start(self, theta: State) -> RunState:
        """Return the state at the start of the loop."""
        return RunState(theta, self.ledger, self.solver_state)


_FEW_VALUES = 2**16
"""Cells of a lattice that the caches of a core hold: copying a state of them costs less
than compiling a step several times."""

_STEP_OF_A_NODE = 2
"""Time that a step takes for a node with links, over that for a cell of a lattice: as
much larger is the state whose copies are as little of a step."""


def is_copied_fast(theta: State) -> bool:
    """Return True if a loop should copy temperatures, not take two steps a turn."""
    # On a GPU every copy is one more kernel, however small it is.
    on_host = jax.default_backend() == "cpu"
    leaves = jax.tree.leaves(theta)
    lattices = sum(values.size for values in leaves if values.ndim > 1)
    nodes = sum(values.size for values in leaves if values.ndim == 1)
    return on_host and lattices + nodes / _STEP_OF_A_NODE <= _FEW_VALUES


# What XLA starts as one graph on a GPU. Its own choice lacks WHILE: the host would then
# decide after each turn whether the loop goes on.
_GRAPHS = {
    "xla_gpu_enable_command_buffer": "FUSION,CUBLAS,CUBLASLT,CUDNN,CUSTOM_CALL,"
    "DYNAMIC_SLICE_FUSION,CONDITIONAL,WHILE"
}


@cache
def jit_in_place(function: Callable[..., Any], as_graph: bool = False) -> Any:
    """Compile a loop over steps, which overwrites all arguments but the first."""
    options = {"compiler_options": _GRAPHS} if as_graph else {}
    return eqx.filter_jit(function, donate="all-except-first", **options)


def in_place(function: Callable[..., Any], theta: State) -> Callable[..., Any]:
    """Return a compiled loop over steps, which overwrites its temperatures `theta`."""
    # A program within another one has no options of its own.
    as_graph = jax.default_backend() == "gpu" and not is_traced(theta)
    return jit_in_place(function, as_graph)
