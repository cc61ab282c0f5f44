"""Damping and length of Levenberg-Marquardt steps.

A step solves (J^T J + lambda I) d = -J^T r. The first lambda follows from J itself, so
that the steps are the same whether residuals are in percent or in kelvin.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float, ScalarLike
from typing_extensions import override

from jaxthermo.network.network import inverse


FIRST_DAMPING = 0.01
"""First lambda over the curvature g^T J^T J g / |g|^2 along the gradient g."""
_MAX_STEP = 1.0
"""Largest change of a coordinate in one step; 1 is about the size of its value."""


class ScaledTrustRegion(optx.ClassicalTrustRegion):
    """Trust region of size 1 / lambda whose first size has the scale of the problem.

    lambda_0 = 0.01 |J g|^2 / |g|^2, g = J^T r

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05 (1999),
    who takes the largest entry of J^T J's diagonal, which needs all of J.
    """

    # Decrease over the predicted one of a good step, then the factors of 1 / lambda
    # after a good and after a rejected step.
    high_cutoff: ScalarLike = 0.75
    high_constant: ScalarLike = 10.0
    low_constant: ScalarLike = 0.1

    @override
    def init(self, y: Any, f_info_struct: Any) -> Any:
        state = super().init(y, f_info_struct)
        # optimistix starts in the default dtype, which is not always the fit's.
        return eqx.tree_at(lambda s: s.step_size, state, jnp.ones((), y.dtype))

    @override
    def step(
        self, first_step: Any, y: Any, y_eval: Any, f_info: Any, f_eval_info: Any,
        state: Any,
    ) -> Any:  # fmt: skip
        size, accept, result, state = super().step(
            first_step, y, y_eval, f_info, f_eval_info, state
        )
        # Later sizes follow from how well the linear model predicted the decrease.
        scaled = lambda: first_size(f_eval_info).astype(size.dtype)
        size = jax.lax.cond(first_step, scaled, lambda: size)
        return size, accept, result, eqx.tree_at(lambda s: s.step_size, state, size)


def first_size(f_info: Any) -> Float[Array, ""]:
    """1 / lambda_0 of optimistix' residual and Jacobian; 1 where there is no slope."""
    gradient = f_info.compute_grad()
    square, curvature = (gradient**2).sum(), (f_info.jac.mv(gradient) ** 2).sum()
    size = square * inverse(curvature) / FIRST_DAMPING
    return jnp.where(size > 0, size, 1.0)


class BoundedDescent(optx.DampedNewtonDescent):
    """Damped Newton step, shortened so that no coordinate changes by more than 1."""

    @override
    def step(self, step_size: Any, state: Any) -> Any:
        # The linear model seldom holds over more than a value's own size.
        step, result = super().step(step_size, state)
        return step * (_MAX_STEP / jnp.maximum(jnp.abs(step).max(), _MAX_STEP)), result


def with_trust_region(solver: optx.LevenbergMarquardt) -> optx.LevenbergMarquardt:
    """Solver of optimistix with this damping and these steps."""
    parts = ScaledTrustRegion(), BoundedDescent(solver.descent.linear_solver)
    return eqx.tree_at(lambda s: (s.search, s.descent), solver, parts)
