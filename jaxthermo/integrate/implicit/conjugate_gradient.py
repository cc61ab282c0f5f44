"""Preconditioned Krylov solvers with a stopping criterion in kelvin.

Conjugate gradients where the operator is symmetric, BiCGStab where it is not.

`lineax.CG` compares its residual with the right-hand side, in watts or joules, in which
a voxel of 10 um weighs 1e-15 of one of 1 m, and it also looks at the size of a step.
Here a solve of an energy balance is done when

    max |residual / capacity| <= tolerance  [K],

whatever the voxel. In float32 a long step of a good conductor cannot satisfy that: y is
stored to a rounding, which A multiplies. Where the tolerance may give way to rounding,
a residual r is also accepted if, but for the tolerance,

    |r| <= 8 u |A| |y|,    u = eps / 2,

the bound on the rounding of b - A y in a row of seven entries (Higham, Accuracy and
Stability of Numerical Algorithms, 2002, section 3.5), and if the correction M r that
the preconditioner would still make is within the tolerance. It is a solver of
`lineax.linear_solve`, which knows its derivatives. Without a time step there is no such
scale: a steady solve measures how far an iteration still moves the solution.
"""

import abc
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from equinox import Module
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ...arrays import EXACT


_STAGNATION_ITERATIONS = 200
"""Iterations without a smaller norm after which the solve stops."""

_ROUNDINGS = 4.0
"""Bound on the rounding of a residual [eps |A| |y|]."""

_MIN_ITERATIONS = 3
"""Number of iterations that are made even if the norm is within the tolerance."""

_EARLY_REDUCTION = 1e-3
"""Reduction of the norm with which fewer iterations than that suffice."""


_Map = Callable[[Any], Any]


def _dot(a: Any, b: Any) -> Float[Array, ""]:
    products = jax.tree.map(partial(jnp.vdot, precision=EXACT), a, b)
    return jnp.stack(jax.tree.leaves(products)).sum()


def _add_scaled(y: Any, factor: Float[Array, ""] | float, p: Any) -> Any:
    return jax.tree.map(lambda a, b: a + factor * b, y, p)


def max_abs(values: Any) -> Float[Array, ""]:
    """Return the largest magnitude in a pytree of arrays."""
    return jnp.stack([jnp.abs(x).max() for x in jax.tree.leaves(values)]).max()


class AbstractStoppingNorm(Module):
    """Measure of the error of a solve, which is compared with its tolerance."""

    @abc.abstractmethod
    def initial(self, residual: Any) -> Float[Array, ""]:
        """Measure before any iteration."""

    @abc.abstractmethod
    def after_step(self, residual: Any, change: Callable[[], Any]) -> Float[Array, ""]:
        """Measure the residual, or the change of the solution, computed if called."""


class ResidualNorm(AbstractStoppingNorm):
    """max |scale * residual|."""

    scale: Any
    """Scale of each value, such as step over capacity [K/W]; or one number for all."""

    @override
    def initial(self, residual: Any) -> Float[Array, ""]:
        if not isinstance(self.scale, tuple):
            return max_abs(residual) * self.scale
        return max_abs(jax.tree.map(jnp.multiply, residual, self.scale))

    @override
    def after_step(self, residual: Any, change) -> Float[Array, ""]:
        return self.initial(residual)


class CorrectionNorm(AbstractStoppingNorm):
    """max |change of the solution|: about its error, if the preconditioner is good."""

    @override
    def initial(self, residual: Any) -> Float[Array, ""]:
        return jnp.full((), jnp.inf, jax.tree.leaves(residual)[0].dtype)

    @override
    def after_step(self, residual: Any, change) -> Float[Array, ""]:
        return max_abs(change())


class _Iteration(NamedTuple):
    y: Any
    residual: Any
    work: Any
    """Data that the method passes from one iteration to the next."""
    goes_on: Bool[Array, ""]
    """False after an iteration in which rounding exceeds what the method divides by."""
    norm: Float[Array, ""]
    first_norm: Float[Array, ""]
    min_norm: Float[Array, ""]
    min_count: Int[Array, ""]
    """Iteration that reached `min_norm`."""
    count: Int[Array, ""]


class _Step(NamedTuple):
    """One iteration of a method."""

    change: Any
    residual: Any
    work: Any
    goes_on: Bool[Array, ""]


class _AbstractKrylov(lx.AbstractLinearSolver):
    """Iterative solver with a preconditioner close to the inverse.

    Options of `lineax.linear_solve`: `preconditioner`, a module from a residual to a
    correction, `start`, an initial guess, and `magnitude`, a function from y to
    |A| |y|, for the `rounding` of the residual. Its statistics are `iterations` and
    `residual`, the final norm.
    """

    norm: AbstractStoppingNorm
    tolerance: Float[Array, ""] | float
    """Tolerance of the norm, in its unit."""
    relative: bool = eqx.field(static=True, default=False)
    """Multiply the tolerance by the norm of the right-hand side, as for derivatives,
    which have any unit."""
    rounding: bool = eqx.field(static=True, default=False)
    """Accept a residual that is rounding, if its correction is within the tolerance."""
    max_iterations: int = eqx.field(static=True, default=2000)

    @abc.abstractmethod
    def first_work(self, residual: Any) -> Any:
        """Data with which the first iteration starts."""

    @abc.abstractmethod
    def step(self, apply: _Map, precondition: _Map, residual: Any, work: Any) -> _Step:
        """Make one iteration; `apply` is the operator."""

    @override
    def init(self, operator: lx.AbstractLinearOperator, options: Mapping[str, Any]):
        return operator

    @override
    def compute(self, state, vector: Any, options: Mapping[str, Any]):
        operator = state
        precondition = options.get("preconditioner", lambda r: r)
        start = options.get("start")
        if start is None:
            y = jax.tree.map(jnp.zeros_like, vector)
            r = vector
        else:
            y = start
            r = _add_scaled(vector, -1.0, operator.mv(start))
        dtype = jax.tree.leaves(vector)[0].dtype
        tolerance = jnp.asarray(self.tolerance, dtype)

        def goal(i: _Iteration) -> Float[Array, ""]:
            if not self.relative:
                return tolerance
            return jnp.where(jnp.isfinite(i.first_norm), tolerance * i.first_norm, 0)

        def unfinished(i: _Iteration) -> Bool[Array, ""]:
            stagnates = i.count - i.min_count >= _STAGNATION_ITERATIONS
            allowed = (i.count < self.max_iterations) & ~stagnates
            # A right-hand side below the tolerance still gets some iterations, or
            # steps that change less than the tolerance would never change anything.
            early = (i.count < _MIN_ITERATIONS) & (
                i.norm > _EARLY_REDUCTION * i.first_norm
            )
            return ((i.norm > goal(i)) | early) & i.goes_on & allowed

        def iterate(i: _Iteration) -> _Iteration:
            step = self.step(operator.mv, precondition, i.residual, i.work)
            norm = self.norm.after_step(step.residual, lambda: step.change)
            first_known = jnp.isfinite(i.first_norm)
            return _Iteration(
                y=jax.tree.map(jnp.add, i.y, step.change),
                residual=step.residual,
                work=step.work,
                goes_on=step.goes_on,
                norm=norm,
                first_norm=jnp.where(first_known, i.first_norm, norm),
                min_norm=jnp.minimum(i.min_norm, norm),
                min_count=jnp.where(norm < i.min_norm, i.count + 1, i.min_count),
                count=i.count + 1,
            )

        norm = self.norm.initial(r)
        first = _Iteration(
            y=y,
            residual=r,
            work=self.first_work(r),
            goes_on=jnp.asarray(True),
            norm=norm,
            first_norm=self.norm.initial(vector),
            min_norm=norm,
            min_count=jnp.asarray(0, jnp.int32),
            count=jnp.asarray(0, jnp.int32),
        )
        last = jax.lax.while_loop(unfinished, iterate, first)
        # Recomputed: in float32 the recurrence's residual may be far too small.
        r = _add_scaled(vector, -1.0, operator.mv(last.y))
        limit = 2 * goal(last)
        residual = self.norm.after_step(r, lambda: precondition(r))
        if self.rounding:
            # Evaluated only where the residual does not meet the tolerance anyway.
            residual = jax.lax.cond(
                residual <= limit,
                lambda: residual,
                lambda: self._above_rounding(
                    r,
                    residual=residual,
                    magnitude=options["magnitude"](last.y),
                    correction=max_abs(precondition(r)),
                    limit=limit,
                ),
            )
        converged = residual <= limit

        def better() -> Any:
            # Where rounding exceeds the operator the start may be the better answer.
            residuals = jax.tree.map(lambda a, b: jnp.stack([a, b]), r, first.residual)
            return _with_smaller_correction(precondition, residuals, (last.y, y))

        y = jax.lax.cond(converged, lambda: last.y, better)
        result = lx.RESULTS.where(
            converged, lx.RESULTS.successful, lx.RESULTS.max_steps_reached
        )
        return y, result, {"iterations": last.count, "residual": residual}

    def _above_rounding(
        self,
        residual_vector: Any,
        residual: Float[Array, ""],
        magnitude: Any,
        correction: Float[Array, ""],
        limit: Float[Array, ""],
    ) -> Float[Array, ""]:
        """Return the correction instead of a residual that is rounding."""
        dtype = correction.dtype
        floor = _ROUNDINGS * float(jnp.finfo(dtype).eps)

        def excess(values: Array, size: Array) -> Array:
            return jnp.maximum(jnp.abs(values) - floor * size, 0)

        above = jax.tree.map(excess, residual_vector, magnitude)
        is_rounding = self.norm.initial(above) <= limit
        return jnp.where(is_rounding & (correction <= limit), correction, residual)

    @override
    def assume_full_rank(self):
        return True


def _with_smaller_correction(
    precondition: _Map, residuals: Any, answers: tuple[Any, Any]
) -> Any:
    """Return the one of two answers that the preconditioner would change less.

    `residuals` has the residuals of both along a new first axis.
    """
    first_correction, second_correction = jax.lax.map(
        lambda residual: max_abs(precondition(residual)), residuals
    )
    first_is_better = first_correction <= second_correction
    first, second = answers
    return jax.tree.map(lambda a, b: jnp.where(first_is_better, a, b), first, second)


class ConjugateGradient(_AbstractKrylov):
    """Conjugate gradients for positive definite operators and preconditioners.

    Source: Hestenes, Stiefel, J. Research Nat. Bureau of Standards 49 (1952) 409-436.
    """

    @override
    def first_work(self, residual: Any) -> Any:
        # The direction, and residual times preconditioned residual of the last
        # iteration.
        endless = jnp.asarray(jnp.inf, jax.tree.leaves(residual)[0].dtype)
        return jax.tree.map(jnp.zeros_like, residual), endless

    @override
    def step(self, apply: _Map, precondition: _Map, residual: Any, work: Any) -> _Step:
        direction, gamma_before = work
        z = precondition(residual)
        gamma = _dot(residual, z)
        p = _add_scaled(z, gamma / gamma_before, direction)
        image = apply(p)
        curvature = _dot(p, image)
        # Where rounding exceeds the curvature the step is 0, and the last one.
        positive = curvature > 0
        length = jnp.where(positive, gamma / jnp.where(positive, curvature, 1), 0)
        change = jax.tree.map(lambda p_leaf: length * p_leaf, p)
        r = _add_scaled(residual, -length, image)
        return _Step(
            change=change, residual=r, work=(p, gamma), goes_on=positive & (gamma > 0)
        )

    @override
    def transpose(self, state, options: Mapping[str, Any]):
        # The operator is symmetric and real: its own transpose and conjugate.
        return state, options

    @override
    def conj(self, state, options: Mapping[str, Any]):
        return state, options


class _BiCGStabWork(NamedTuple):
    """Vectors and numbers that one iteration of BiCGStab passes to the next."""

    shadow: Any
    """Residual of the start, to which the residuals are made orthogonal."""
    p: Any
    """Search direction."""
    v: Any
    """A M p."""
    rho: Float[Array, ""]
    """Residual times shadow residual."""
    alpha: Float[Array, ""]
    """Length of the step along M p."""
    omega: Float[Array, ""]
    """Length of the stabilizing step."""


class BiCGStab(_AbstractKrylov):
    """Stabilized biconjugate gradients, for operators near a symmetric one.

    Each iteration applies the operator and the symmetric preconditioner twice.

    Source: van der Vorst, SIAM J. Sci. Stat. Comput. 13 (1992) 631-644.
    """

    @override
    def first_work(self, residual: Any) -> Any:
        zero = jax.tree.map(jnp.zeros_like, residual)
        unit = jnp.ones((), jax.tree.leaves(residual)[0].dtype)
        return _BiCGStabWork(
            shadow=residual, p=zero, v=zero, rho=unit, alpha=unit, omega=unit
        )

    @override
    def step(self, apply: _Map, precondition: _Map, residual: Any, work: Any) -> _Step:
        rho = _dot(work.shadow, residual)
        size = _dot(residual, residual)
        # The residual has become orthogonal to its shadow: start again from here.
        eps = float(jnp.finfo(rho.dtype).eps)
        shadow_size = _dot(work.shadow, work.shadow)
        lost = jnp.abs(rho) <= 10 * eps * jnp.sqrt(size * shadow_size)
        shadow = jax.tree.map(
            lambda r, old: jnp.where(lost, r, old), residual, work.shadow
        )
        rho = jnp.where(lost, size, rho)
        beta = rho * _inverse(work.rho) * work.alpha * _inverse(work.omega)
        beta = jnp.where(lost, 0, beta)
        p = _add_scaled(residual, beta, _add_scaled(work.p, -work.omega, work.v))
        x = precondition(p)
        v = apply(x)
        alpha = rho * _inverse(_dot(shadow, v))
        s = _add_scaled(residual, -alpha, v)
        z = precondition(s)
        t = apply(z)
        omega = _dot(t, s) * _inverse(_dot(t, t))
        change = jax.tree.map(lambda a, b: alpha * a + omega * b, x, z)
        r = _add_scaled(s, -omega, t)
        moved = jnp.isfinite(alpha) & (alpha != 0)
        return _Step(
            change=change,
            residual=r,
            work=_BiCGStabWork(
                shadow=shadow, p=p, v=v, rho=rho, alpha=alpha, omega=omega
            ),
            goes_on=moved,
        )

    @override
    def transpose(self, state, options: Mapping[str, Any]):
        # The preconditioner is its own transpose.
        return state.transpose(), options

    @override
    def conj(self, state, options: Mapping[str, Any]):
        return state, options


def _inverse(value: Float[Array, ""]) -> Float[Array, ""]:
    # 0 for 0: the step is then 0.
    zero = value == 0
    return jnp.where(zero, 0, 1 / jnp.where(zero, 1, value))
