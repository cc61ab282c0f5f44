"""Conjugate gradients that stop in kelvin.

`lineax.CG` measures its residual against the right-hand side, in watts or joules, in
which a voxel of 10 um weighs 1e-15 of one of 1 m, and it looks at the size of a step
besides. Here a solve of an energy balance is done when

    max |residual / capacity| <= tolerance  [K],

whatever the voxel; so it works as a solver of `lineax.linear_solve`, which knows its
derivatives. The residual it reports is recomputed at the end, not the one that the
recurrence believes in, which in float32 may be far smaller. Without a step there is no
such scale: a steady state asks how far an iteration still moves it.
"""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Bool, Float, Int


STALLED = 200
"""Iterations without progress after which there is none to come."""

LEAST, DIGITS = 3, 1e-3
"""Iterations made whatever is left, unless it is so much less than at first."""


def _dot(a: Any, b: Any) -> Float[Array, ""]:
    each = jax.tree.map(lambda x, y: jnp.vdot(x, y), a, b)
    return jnp.stack(jax.tree.leaves(each)).sum()


def _along(y: Any, step: Float[Array, ""] | float, p: Any) -> Any:
    return jax.tree.map(lambda a, b: a + step * b, y, p)


class AbstractStoppingNorm(eqx.Module):
    """How far a solve still is from its end."""

    @abc.abstractmethod
    def initial(self, residual: Any) -> Float[Array, ""]:
        """Any iteration."""

    @abc.abstractmethod
    def after_step(self, residual: Any, moved: Any) -> Float[Array, ""]:
        """An iteration that moved the solution, and left a residual."""

    @abc.abstractmethod
    def final(self, residual: Any, correct: Callable[[Any], Any]) -> Float[Array, ""]:
        """Of a solution whose residual was computed anew."""


def max_abs(values: Any) -> Float[Array, ""]:
    """Largest magnitude in a pytree of arrays."""
    return jnp.stack([jnp.abs(x).max() for x in jax.tree.leaves(values)]).max()


class ResidualNorm(AbstractStoppingNorm):
    """The residual, each value in its own scale."""

    scale: Any
    """Such as the step over the capacity of every node [K/W]; a number for all."""

    def initial(self, residual: Any) -> Float[Array, ""]:
        """Max |scale * residual|."""
        if not isinstance(self.scale, tuple):
            return max_abs(residual) * self.scale
        return max_abs(jax.tree.map(jnp.multiply, residual, self.scale))

    def after_step(self, residual: Any, moved: Any) -> Float[Array, ""]:
        """The same."""
        del moved
        return self.initial(residual)

    def final(self, residual: Any, correct: Callable[[Any], Any]) -> Float[Array, ""]:
        """The same."""
        del correct
        return self.initial(residual)


class CorrectionNorm(AbstractStoppingNorm):
    """What still moves the solution: about its error, if the preconditioner is good."""

    def initial(self, residual: Any) -> Float[Array, ""]:
        """Not known."""
        return jnp.full((), jnp.inf, jax.tree.leaves(residual)[0].dtype)

    def after_step(self, residual: Any, moved: Any) -> Float[Array, ""]:
        """Max |moved|."""
        del residual
        return max_abs(moved)

    def final(self, residual: Any, correct: Callable[[Any], Any]) -> Float[Array, ""]:
        """Max |what the preconditioner would still change|."""
        return max_abs(correct(residual))


class _Iteration(NamedTuple):
    y: Any
    residual: Any
    direction: Any
    gamma: Float[Array, ""]
    """Of the residual in the preconditioner's norm, before the last step."""
    size: Float[Array, ""]
    """What is left."""
    first: Float[Array, ""]
    """What was left at first."""
    least: Float[Array, ""]
    """The least that was left so far."""
    since: Int[Array, ""]
    """The iteration that left it."""
    count: Int[Array, ""]


class ConjugateGradient(lx.AbstractLinearSolver):
    """Preconditioned; the operator and the preconditioner are positive definite.

    Options of `lineax.linear_solve`: `preconditioner`, a module that takes a residual
    to a correction, and `start`, a first guess.
    """

    norm: AbstractStoppingNorm
    """Of what is left over."""
    tolerance: Float[Array, ""] | float
    """In the measure's unit."""
    relative: bool = eqx.field(static=True, default=False)
    """Whether it is a fraction of the right-hand side's measure instead, as for
    derivatives, which have any unit."""
    max_iterations: int = eqx.field(static=True, default=2000)
    """Iterations."""

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]):
        """The operator itself."""
        del options
        return operator

    def compute(self, state, vector: Any, options: dict[str, Any]):
        """The solution, how it went, and `iterations` and `left`, the residual."""
        operator = state
        correct = options.get("preconditioner", lambda r: r)
        start = options.get("start")
        if start is None:
            y, r = jax.tree.map(jnp.zeros_like, vector), vector
        else:
            y, r = start, _along(vector, -1.0, operator.mv(start))
        dtype = jax.tree.leaves(vector)[0].dtype
        aim = jnp.asarray(self.tolerance, dtype)

        def goal(i: _Iteration) -> Float[Array, ""]:
            known = jnp.isfinite(i.first)
            return jnp.where(known, aim * i.first, 0) if self.relative else aim

        def goes_on(i: _Iteration) -> Bool[Array, ""]:
            more = (i.count < self.max_iterations) & (i.count - i.since < STALLED)
            # A step that changes less than the tolerance must not be taken for none.
            early = (i.count < LEAST) & (i.size > DIGITS * i.first)
            return ((i.size > goal(i)) | early) & (i.gamma > 0) & more

        def iterate(i: _Iteration) -> _Iteration:
            z = correct(i.residual)
            gamma = _dot(i.residual, z)
            p = _along(z, gamma / i.gamma, i.direction)
            image = operator.mv(p)
            bent = _dot(p, image)
            # Where rounding has eaten the curvature, the step is none, and the last.
            step = jnp.where(bent > 0, gamma / jnp.where(bent > 0, bent, 1), 0)
            moved = jax.tree.map(lambda each: step * each, p)
            r = _along(i.residual, -step, image)
            size = self.norm.after_step(r, moved)
            return _Iteration(
                y=jax.tree.map(jnp.add, i.y, moved),
                residual=r,
                direction=p,
                gamma=jnp.where(bent > 0, gamma, 0),
                size=size,
                first=jnp.where(jnp.isfinite(i.first), i.first, size),
                least=jnp.minimum(i.least, size),
                since=jnp.where(size < i.least, i.count + 1, i.since),
                count=i.count + 1,
            )

        size, endless = self.norm.initial(r), jnp.asarray(jnp.inf, dtype)
        first = _Iteration(
            y=y,
            residual=r,
            direction=jax.tree.map(jnp.zeros_like, r),
            gamma=endless,
            size=size,
            first=self.norm.initial(vector),
            least=size,
            since=jnp.asarray(0, jnp.int32),
            count=jnp.asarray(0, jnp.int32),
        )
        last = jax.lax.while_loop(goes_on, iterate, first)
        found, count, aim = last.y, last.count, goal(last)
        r = _along(vector, -1.0, operator.mv(found))
        left = self.norm.final(r, correct)
        reached = left <= 2 * aim

        def better() -> Any:
            # Where rounding has eaten the operator the start may be the better answer,
            # by what the preconditioner would still change.
            both = jax.tree.map(lambda *each: jnp.stack(each), r, first.residual)
            now, before = jax.lax.map(lambda each: max_abs(correct(each)), both)
            pick = lambda new, old: jnp.where(now <= before, new, old)
            return jax.tree.map(pick, found, y)

        y = jax.lax.cond(reached, lambda: found, better)
        result = lx.RESULTS.where(
            reached, lx.RESULTS.successful, lx.RESULTS.max_steps_reached
        )
        return y, result, {"iterations": count, "residual": left}

    def transpose(self, state, options: dict[str, Any]):
        """The same: the operator is symmetric."""
        return state, options

    def conj(self, state, options: dict[str, Any]):
        """The same: the operator is real."""
        return state, options

    def assume_full_rank(self):
        """Yes."""
        return True
