"""How far a step of a search may go: by what was found true of the ones before.

A damped step solves (J^T J + lambda I) d = -J^T r. What lambda is large goes by the
unit of the misfits; here it starts from J itself, so that it makes no difference to
the steps whether errors are told in percent or in kelvin.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from jaxthermo.network.network import inverse


FIRST = 0.01
"""Damping of the first step, as a share of what J^T J is along the slope."""

TRUSTED = 0.75
"""Share of the promised decrease from which on the next step is damped less."""

FARTHEST = 1.0
"""The most that a number moves in a step; free ones have the unit of their own size."""

LESS, MORE = 10.0, 0.1
"""Factors of the step size, which is 1 / lambda: after a good step, after a bad one."""


class ScaledTrustRegion(optx.AbstractSearch):
    """A trust region whose first size is of the scale of the problem.

    lambda_0 = 0.01 |J g|^2 / |g|^2, g = J^T r

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05 (1999),
    who takes the largest entry of J^T J's diagonal, which needs all of J.
    """

    inner: optx.ClassicalTrustRegion = optx.ClassicalTrustRegion(
        high_cutoff=TRUSTED, high_constant=LESS, low_constant=MORE
    )

    def init(self, y: Any, f_info_struct: Any) -> Any:
        """As the inner one."""
        return self.inner.init(y, f_info_struct)

    def step(
        self,
        first_step: Any,
        y: Any,
        y_eval: Any,
        f_info: Any,
        f_eval_info: Any,
        state: Any,
    ) -> Any:
        """As the inner one, but for the first size."""
        size, accept, result, state = self.inner.step(
            first_step, y, y_eval, f_info, f_eval_info, state
        )
        size = jax.lax.cond(
            first_step, lambda: first_size(f_eval_info).astype(size.dtype), lambda: size
        )
        return size, accept, result, eqx.tree_at(lambda s: s.step_size, state, size)


def first_size(misfits: Any) -> Float[Array, ""]:
    """One over the first lambda; 1 where there is no slope.

    Args:
        misfits: optimistix' residual and Jacobian at the start.
    """
    slope = misfits.compute_grad()
    steep, moved = (slope**2).sum(), (misfits.jac.mv(slope) ** 2).sum()
    size = steep * inverse(moved) / FIRST
    return jnp.where(size > 0, size, 1.0)


class Near(optx.AbstractDescent):
    """Steps in which no number moves by more than 1, which is about its own size.

    What is linear at one point seldom is as far from it as that.
    """

    inner: optx.DampedNewtonDescent

    def init(self, y: Any, f_info_struct: Any) -> Any:
        """As the inner one."""
        return self.inner.init(y, f_info_struct)

    def query(self, y: Any, f_info: Any, state: Any) -> Any:
        """As the inner one."""
        return self.inner.query(y, f_info, state)

    def step(self, step_size: Any, state: Any) -> Any:
        """Its step, as a whole made shorter."""
        moved, result = self.inner.step(step_size, state)
        shorter = FARTHEST / jnp.maximum(jnp.abs(moved).max(), FARTHEST)
        return moved * shorter, result


def with_scale(solver: Any) -> Any:
    """A solver of least squares with such a region and such steps.

    Args:
        solver: of optimistix, by Levenberg-Marquardt.
    """
    parts = ScaledTrustRegion(), Near(solver.descent)
    return eqx.tree_at(lambda s: (s.search, s.descent), solver, parts)
