"""Levenberg-Marquardt whose Jacobian is kept between steps, as an optimistix solver."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, PyTree, Scalar
from typing_extensions import override

from .broyden import broyden_update, value_and_jacobian
from .trust_region import BoundedDescent, ScaledTrustRegion


class BroydenState(eqx.Module):
    """State between steps: the best point, and the point to evaluate next."""

    first_step: Bool[Array, ""]
    """Evaluate `y_eval` with an exact Jacobian and accept it."""
    y_eval: Float[Array, " p"]
    f_info: Any
    """optimistix' residuals and Jacobian at the best point."""
    aux: PyTree
    search_state: PyTree
    descent_state: PyTree
    terminate: Bool[Array, ""]
    result: optx.RESULTS


class BroydenLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Damped least squares, d = -(J^T J + lambda I)^-1 J^T r, in forward mode.

    The Jacobian is exact at the first point and corrected by Broyden's update at each
    later one. `restart` asks for an exact one.

    As in all of optimistix' Gauss-Newton methods, a step evaluates the point that the
    step before proposed, accepts or rejects it, and proposes the next.
    """

    rtol: float
    atol: float
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    search: ScaledTrustRegion = ScaledTrustRegion()
    descent: BoundedDescent = BoundedDescent(lx.QR())
    use_broyden: bool = True
    """If False, every Jacobian is exact."""
    batch: int = 1
    """Number of derivatives at once in an exact Jacobian."""

    @override
    def init(
        self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any,
        aux_struct: Any, tags: Any,
    ) -> BroydenState:  # fmt: skip
        # Placeholders: the first step replaces them whatever they are.
        zeros = lambda s: jnp.zeros(s.shape, s.dtype)
        matrix = jnp.zeros((*f_struct.shape, len(y)), f_struct.dtype)
        f_info = optx.FunctionInfo.ResidualJac(
            zeros(f_struct), lx.MatrixLinearOperator(matrix)
        )
        f_info_struct = jax.eval_shape(lambda: f_info)
        return BroydenState(
            first_step=jnp.asarray(True),
            y_eval=y,
            f_info=f_info,
            aux=jax.tree.map(zeros, aux_struct),
            search_state=self.search.init(y, f_info_struct),
            descent_state=self.descent.init(y, f_info_struct),
            terminate=jnp.asarray(False),
            result=optx.RESULTS.successful,
        )

    @override
    def step(
        self, fn: Any, y: Any, args: Any, options: Any, state: BroydenState, tags: Any
    ) -> tuple[Float[Array, " p"], BroydenState, PyTree]:
        f_eval_info, aux_eval = self._linearize(fn, y, args, state)
        # The search compares the observed decrease of the loss with that of the linear
        # model, and adapts the damping.
        points = state.first_step, y, state.y_eval
        step_size, accept, search_result, search_state = self.search.step(
            *points, state.f_info, f_eval_info, state.search_state
        )

        def accepted():
            descent = self.descent.query(state.y_eval, f_eval_info, state.descent_state)
            done = self._is_converged(y, state, f_eval_info)
            return state.y_eval, f_eval_info, aux_eval, descent, done

        # A trial from a kept Jacobian may fail: the caller restarts with an exact one.
        def rejected():
            keep = state.f_info, state.aux, state.descent_state
            return y, *keep, jnp.asarray(False)

        # A rejected step is proposed again from the best point, with more damping.
        y, f_info, aux, descent, done = jax.lax.cond(accept, accepted, rejected)
        step, descent_result = self.descent.step(step_size, descent)
        succeeded = search_result == optx.RESULTS.successful
        result = optx.RESULTS.where(succeeded, descent_result, search_result)
        state = BroydenState(
            first_step=jnp.asarray(False),
            y_eval=y + step,
            f_info=f_info,
            aux=aux,
            search_state=search_state,
            descent_state=descent,
            terminate=done,
            result=result,
        )
        return y, state, aux

    def _linearize(
        self, fn: Any, y: Float[Array, " p"], args: Any, state: BroydenState
    ) -> tuple[Any, PyTree]:
        function = lambda z: fn(z, args)

        # An exact Jacobian costs a run per coordinate, a corrected one a single run.
        def exact():
            return value_and_jacobian(function, state.y_eval, self.batch)

        def corrected():
            value, aux = function(state.y_eval)
            rows = state.f_info.jac.as_matrix().T
            change = value - state.f_info.residual
            return value, broyden_update(rows, state.y_eval - y, change), aux

        # A batch of searches would run both branches of the condition.
        if self.use_broyden:
            found = jax.lax.cond(state.first_step, exact, corrected)
        else:
            found = exact()
        value, rows, aux = found
        operator = lx.MatrixLinearOperator(rows.T)
        return optx.FunctionInfo.ResidualJac(value, operator), aux

    def _is_converged(
        self, y: Float[Array, " p"], state: BroydenState, f_eval_info: Any
    ) -> Bool[Array, ""]:
        # Both the coordinates and the residuals have stopped changing.
        small = lambda new, old: (
            self.norm(jnp.abs(new - old) / (self.atol + self.rtol * jnp.abs(new))) < 1
        )
        residuals = f_eval_info.residual, state.f_info.residual
        return small(state.y_eval, y) & small(*residuals)

    @override
    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: BroydenState, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return state.terminate, state.result

    @override
    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: BroydenState,
        tags: Any, result: optx.RESULTS,
    ) -> tuple[Float[Array, " p"], PyTree, dict[str, Any]]:  # fmt: skip
        return y, aux, {}


def restart(state: Any, z: Float[Array, " p"]) -> Any:
    """State of any solver that evaluates z first, exactly, and accepts it."""
    fields = lambda s: (s.first_step, s.y_eval)
    return eqx.tree_at(fields, state, (jnp.asarray(True), z))
