"""The search for the best values, one step at a time, by a solver of optimistix.

A host loop over the solver's init, step and terminate: after every step there is
progress to tell, a state to keep, and a chance to stop. The steps are one compiled
program: what changes from one to the next, and between fits of one shape, are arrays.

| method | derivatives | for |
|---|---|---|
| Levenberg-Marquardt | the Jacobian, forward mode | some dozens of values |
| Gauss-Newton | products with it, forward and reverse | hundreds |
| BFGS, L-BFGS | the gradient, reverse mode | dozens; fields of thousands |

Derivatives are taken once a point. optimistix linearizes what it is given wherever it
tries; `rules` has what that linear function is.
"""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .broyden import known_of
from .linearization import Program, by_gradient, by_jacobian, by_products
from .trust_region import with_scale


class Setting(NamedTuple):
    """Of a search."""

    method: str = "levenberg_marquardt"
    tolerance: float = 1e-3
    """Relative change of values, and of the error, at which it ends."""
    most_steps: int = 50
    huber: float | None = None
    """Misfit, in units of their root mean square at the start, above which they count
    linearly; None for squares."""
    memory: int = 2**30
    """For the states of a run, in reverse mode [bytes]."""
    secant: bool = True
    """Whether Levenberg-Marquardt keeps its Jacobian between points, see `secant`."""


class Point(NamedTuple):
    """Where a search stands."""

    z: Float[Array, " p"]
    state: Any
    """Of the solver."""
    steps: int
    done: bool


class Search:
    """A search by one method."""

    def __init__(self, program: Program, setting: Setting, batch: int):
        """Nothing is compiled yet.

        Args:
            program: of the misfits.
            setting: method and tolerance.
            batch: derivatives to take at once, in forward mode.
        """
        arrays, static = eqx.partition(program, eqx.is_array)
        inner = RULES[setting.method](batch)
        self._function = lambda z, given: inner(
            z, replace(eqx.combine(given[0], static), known=given[1])
        )
        self.keeps = setting.secant and setting.method == "levenberg_marquardt"
        self._arrays = arrays
        self._solver = SOLVERS[setting.method](setting.tolerance)
        self._options = OPTIONS.get(setting.method, {})
        self._step: Any = eqx.filter_jit(self.take)
        self._compiled: dict[tuple, Any] = {}
        self._begun: dict[tuple, Any] = {}

    def with_program(self, program: Program) -> "Search":
        """The same search with other arrays; what is compiled stays."""
        other = copy.copy(self)
        other._arrays = eqx.filter(program, eqx.is_array)
        return other

    def begin(self, z: Float[Array, " p"]) -> Point:
        """A search at its start; what it traces for that is traced once."""
        shapes = self._shapes(z)
        if shapes not in self._begun:
            self._begun[shapes] = self._first_state(z)
        return self.again(Point(z, self._begun[shapes], 0, False))

    def _first_state(self, z: Float[Array, " p"]) -> Any:
        given = (self._arrays, None)
        like, seen = eqx.filter_eval_shape(self._function, z, given)
        return self._solver.init(
            self._function, z, given, self._options, like, seen, frozenset()
        )

    def _shapes(self, *rest: Any) -> tuple:
        arrays = jax.tree.leaves(eqx.filter((rest, self._arrays), eqx.is_array))
        return tuple((array.shape, array.dtype) for array in arrays)

    def compiled(self, point: Point) -> "Search":
        """The same search with its step compiled, so that steps can be timed."""
        shapes = self._shapes(point.z, point.state)
        if shapes not in self._compiled:
            given = (point.z, point.state, self._arrays, jnp.asarray(True))
            self._compiled[shapes] = self._step.lower(*given).compile()
        other = copy.copy(self)
        other._step = self._compiled[shapes]
        return other

    def take(
        self, z: Any, state: Any, arrays: Any, fresh: Any = None
    ) -> tuple[Any, Any, Any, Any]:
        """One step, to be compiled: values, the solver's state, if done, what is seen.

        Args:
            z: values.
            state: of the solver.
            arrays: of the program.
            fresh: whether a Jacobian is found anew; None for always.
        """
        known = None
        if self.keeps and fresh is not None:
            known = known_of(z, state.f_info, fresh)
        rest = ((arrays, known), self._options)
        z, state, seen = self._solver.step(self._function, z, *rest, state, frozenset())
        done, _ = self._solver.terminate(self._function, z, *rest, state, frozenset())
        return z, state, done, seen

    def step(self, point: Point, fresh: bool = True) -> Point:
        """The next point.

        Args:
            point: where the search stands.
            fresh: whether to find the Jacobian anew, where it may be kept.
        """
        given = (point.state, self._arrays, jnp.asarray(fresh))
        z, state, done, _ = self._step(point.z, *given)
        return Point(z, state, point.steps + 1, bool(done))

    def again(self, point: Point) -> Point:
        """From the same point, of which nothing is known but where it is."""
        places = lambda s: (s.first_step, s.y_eval)
        state = eqx.tree_at(places, point.state, (jnp.asarray(True), point.z))
        return Point(point.z, state, point.steps, False)

    def tried(self, point: Point) -> Float[Array, " p"]:
        """The values that the next step will run with."""
        return point.state.y_eval

    def loss(self, point: Point) -> float:
        """Half of the sum of squares at the point itself."""
        info = point.state.f_info
        if hasattr(info, "residual"):
            return float(0.5 * (np.asarray(info.residual) ** 2).sum())
        return float(info.f)


def _gauss_newton(tolerance: float) -> Any:
    """Damped; its linear solves go by products with J^T J alone."""
    linear = lx.Normal(lx.CG(rtol=1e-3, atol=1e-8, max_steps=100))
    solver = optx.LevenbergMarquardt(tolerance, tolerance, linear_solver=linear)
    return with_scale(solver)


SOLVERS: dict[str, Callable[[float], Any]] = {
    "levenberg_marquardt": lambda t: with_scale(optx.LevenbergMarquardt(t, t)),
    "gauss_newton": _gauss_newton,
    "bfgs": lambda t: optx.BFGS(rtol=t, atol=t),
    "lbfgs": lambda t: optx.LBFGS(rtol=t, atol=t, history_length=20),
}
RULES = {
    "levenberg_marquardt": by_jacobian,
    "gauss_newton": by_products,
    "bfgs": by_gradient,
    "lbfgs": by_gradient,
}
REVERSE = ("gauss_newton", "bfgs", "lbfgs")
"""Methods that take derivatives in reverse mode."""

OPTIONS: dict[str, dict[str, Any]] = {
    "bfgs": {"autodiff_mode": "bwd"},
    "lbfgs": {"autodiff_mode": "bwd"},
}
