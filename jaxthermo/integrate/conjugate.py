"""Conjugate gradients that stop in kelvin.

`lineax.CG` measures its residual against the right-hand side, in watts or joules, in
which a voxel of 10 um weighs 1e-15 of one of 1 m, and it looks at the size of a step
besides. Here a solve of an energy balance is done when

    max |residual / capacity| <= tolerance  [K],

whatever the voxel; so it works as a solver of `lineax.linear_solve`, which knows its
derivatives. The residual it reports is recomputed at the end, not the one that the
recurrence believes in, which in float32 may be far smaller.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float


def _dot(a: Any, b: Any) -> Float[Array, ""]:
    each = jax.tree.map(lambda x, y: jnp.vdot(x, y), a, b)
    return jnp.stack(jax.tree.leaves(each)).sum()


def _along(y: Any, step: Float[Array, ""] | float, p: Any) -> Any:
    return jax.tree.map(lambda a, b: a + step * b, y, p)


class ConjugateGradients(lx.AbstractLinearSolver):
    """Preconditioned; the operator and the preconditioner are positive definite.

    Options of `lineax.linear_solve`: `preconditioner`, a module that takes a residual
    to a correction, and `start`, a first guess.
    """

    kelvin: Any
    """From a residual to kelvin, 1 / C of every node [K/J]; None: relative to the
    right-hand side, for derivatives, which have any unit."""
    tolerance: Float[Array, ""] | float
    """[K], or a fraction."""
    most: int = eqx.field(static=True, default=2000)
    """Iterations."""

    def init(self, operator: lx.AbstractLinearOperator, options: dict[str, Any]):
        """The operator itself."""
        del options
        return operator

    def _size(self, residual: Any) -> Float[Array, ""]:
        scaled = residual
        if self.kelvin is not None:
            scaled = jax.tree.map(jnp.multiply, residual, self.kelvin)
        return jnp.stack([jnp.abs(x).max() for x in jax.tree.leaves(scaled)]).max()

    def compute(self, state, vector: Any, options: dict[str, Any]):
        """The solution, how it went, and `iterations` and `left`, the residual."""
        operator = state
        correct = options.get("preconditioner", lambda r: r)
        start = options.get("start")
        if start is None:
            y, r = jax.tree.map(jnp.zeros_like, vector), vector
        else:
            y, r = start, _along(vector, -1.0, operator.mv(start))
        aim = jnp.asarray(self.tolerance, jax.tree.leaves(vector)[0].dtype)
        if self.kelvin is None:
            aim = aim * self._size(vector)

        def goes_on(carry):
            _, r, _, gamma, count = carry
            return (self._size(r) > aim) & (gamma > 0) & (count < self.most)

        def iterate(carry):
            y, r, p, gamma, count = carry
            image = operator.mv(p)
            bent = _dot(p, image)
            # Where rounding has eaten the curvature, the step is none.
            step = jnp.where(bent > 0, gamma / jnp.where(bent > 0, bent, 1), 0)
            y, r = _along(y, step, p), _along(r, -step, image)
            z = correct(r)
            # No better direction is left where the step is none: gamma 0 ends it.
            after = jnp.where(bent > 0, _dot(r, z), 0)
            p = _along(z, after / gamma, p)
            return y, r, p, after, count + 1

        z = correct(r)
        carry = (y, r, z, _dot(r, z), jnp.asarray(0, jnp.int32))
        y, r, _, _, count = jax.lax.while_loop(goes_on, iterate, carry)
        left = self._size(_along(vector, -1.0, operator.mv(y)))
        reached = left <= 2 * aim
        result = lx.RESULTS.where(
            reached, lx.RESULTS.successful, lx.RESULTS.max_steps_reached
        )
        return y, result, {"iterations": count, "left": left}

    def transpose(self, state, options: dict[str, Any]):
        """The same: the operator is symmetric."""
        return state, options

    def conj(self, state, options: dict[str, Any]):
        """The same: the operator is real."""
        return state, options

    def assume_full_rank(self):
        """Yes."""
        return True
