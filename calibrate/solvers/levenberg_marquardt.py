"""Levenberg-Marquardt that reuses its Jacobian between steps, an optimistix solver.

A step solves (J^T J + lambda I) d = -J^T r. The first lambda follows from J itself, so
that the steps are the same whether residuals are in percent or in kelvin.

An exact Jacobian costs about one run per coordinate, a residual alone one run. Between
near points the last Jacobian is corrected so that it reproduces the observed change
(Broyden's update):

    J' = J + (r' - r - J d) d^T / |d|^2,  d = z' - z.

Jacobians are stored as `rows` of shape (coordinates, residuals), transposed.

Source: Broyden, Mathematics of Computation 19 (1965) 577-593; for damped least squares
Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares Problems, IMM,
Technical University of Denmark (2004), 3.5.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jax.custom_batching import custom_vmap
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, PyTree, Scalar, ScalarLike
from typing_extensions import override

from jaxthermo.network.network import inverse
from jaxthermo.parallel.batch import on_first_device, over_devices, part_of


_ResidualFunction = Callable[..., tuple[Float[Array, " r"], Any]]


def _value_and_jacobian(
    function: _ResidualFunction,
    args: Any,
    z: Float[Array, " p"],
    batch: int,
    mesh: Mesh | None,
) -> "_Linearization":
    """Linearize `function(z, args)`, which returns residuals and auxiliary output.

    The devices of a mesh share the rows; under `vmap` they share the points z.
    """
    if mesh is None:
        rows, same = _derivatives(
            function, args=args, z=z, directions=_directions(z), batch=batch
        )
    else:
        arrays, static = eqx.partition(args, eqx.is_array)
        rows, same = _on_devices(function, static=static, batch=batch, mesh=mesh)(
            z, arrays
        )
    value, aux = same
    return _Linearization(value, rows=rows, aux=aux)


class _Linearization(NamedTuple):
    """Residuals, rows of their Jacobian, and auxiliary output."""

    value: Float[Array, " r"]
    rows: Float[Array, "p r"]
    aux: Any


def _directions(z: Float[Array, " p"]) -> Float[Array, "p p"]:
    return jnp.eye(len(z), dtype=z.dtype)


def _derivatives(
    function: _ResidualFunction,
    args: Any,
    z: Float[Array, " p"],
    directions: Float[Array, "d p"],
    batch: int,
) -> tuple[Float[Array, "d r"], tuple[Float[Array, " r"], Any]]:
    """Derivatives along some directions, then residuals and auxiliary output at z."""

    # Forward mode: the time loop stores no history of states.
    def tangent(direction: Float[Array, " p"]) -> Any:
        return jax.jvp(lambda y: function(y, args), (z,), (direction,), has_aux=True)

    if batch >= len(directions):
        # The value comes with the derivatives, which saves a run.
        value, rows, aux = jax.vmap(tangent, out_axes=(None, 0, None))(directions)
        return rows, (value, aux)
    same = function(z, args)
    return jax.lax.map(lambda t: tangent(t)[1], directions, batch_size=batch), same


def _on_devices(
    function: _ResidualFunction, static: Any, batch: int, mesh: Mesh
) -> Callable[[Float[Array, " p"], Any], Any]:
    """Derivatives along all directions at a point, by arguments that are arrays."""

    def derivatives(arguments, directions, batch):
        z, arrays = arguments
        args = eqx.combine(arrays, static)
        return _derivatives(
            function, args=args, z=z, directions=directions, batch=batch
        )

    @custom_vmap
    def at_one(z, arrays):
        # As many derivatives at once on all devices together as on one.
        device_batch = part_of(mesh, batch)
        return over_devices(
            mesh,
            function=lambda directions, given: derivatives(
                given, directions=directions, batch=device_batch
            ),
            batch=_directions(z),
            constants=(z, arrays),
        )

    @at_one.def_vmap
    def _(_, is_batched, points, arrays):
        # A search from several starts: each device has all directions of some.
        def at_points(points, arrays):
            return jax.vmap(lambda z: derivatives((z, arrays), _directions(z), batch))(
                points
            ), None

        derivatives_of_all, _ = over_devices(
            mesh, function=at_points, batch=points, constants=arrays
        )
        return derivatives_of_all, jax.tree.map(lambda _: True, derivatives_of_all)

    return at_one


@eqx.filter_jit
def jacobian_rows(
    function: _ResidualFunction,
    args: Any,
    z: Float[Array, " p"],
    batch: int,
    mesh: Mesh | None = None,
) -> Float[Array, "p r"]:
    """Rows of the Jacobian of `function(z, args)`, compiled once per shape."""
    return _value_and_jacobian(function, args=args, z=z, batch=batch, mesh=mesh).rows


def _broyden_update(
    rows: Float[Array, "p r"], step: Float[Array, " p"], change: Float[Array, " r"]
) -> Float[Array, "p r"]:
    """Correct a Jacobian by the change of the residuals over a step."""
    # A step of length 0 changes nothing: `inverse` is 0 there.
    direction = step * inverse(step @ step)
    return rows + direction[:, None] * (change - step @ rows)[None, :]


FIRST_DAMPING = 0.01
"""First lambda over the curvature g^T J^T J g / |g|^2 along the gradient g."""
_MAX_STEP = 1.0
"""Largest change of a coordinate in one step; 1 is about the size of its value."""


class _ScaledTrustRegion(optx.ClassicalTrustRegion):
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
        self,
        first_step: Any,
        y: Any,
        y_eval: Any,
        f_info: Any,
        f_eval_info: Any,
        state: Any,
    ) -> Any:
        size, accept, result, state = super().step(
            first_step, y, y_eval, f_info, f_eval_info, state
        )
        # Later sizes follow from how well the linear model predicted the decrease.
        size = jax.lax.cond(
            first_step,
            lambda: _first_size(f_eval_info).astype(size.dtype),
            lambda: size,
        )
        return size, accept, result, eqx.tree_at(lambda s: s.step_size, state, size)


def _first_size(f_info: Any) -> Float[Array, ""]:
    """1 / lambda_0 of optimistix' residual and Jacobian; 1 where there is no slope."""
    gradient = f_info.compute_grad()
    square = (gradient**2).sum()
    curvature = (f_info.jac.mv(gradient) ** 2).sum()
    size = square * inverse(curvature) / FIRST_DAMPING
    return jnp.where(size > 0, size, 1.0)


class _BoundedDescent(optx.DampedNewtonDescent):
    """Damped Newton step, shortened so that no coordinate changes by more than 1."""

    @override
    def step(self, step_size: Any, state: Any) -> Any:
        # The linear model seldom holds over more than a value's own size.
        step, result = super().step(step_size, state)
        return step * (_MAX_STEP / jnp.maximum(jnp.abs(step).max(), _MAX_STEP)), result


def with_trust_region(solver: optx.LevenbergMarquardt) -> optx.LevenbergMarquardt:
    """Solver of optimistix with this damping and these steps."""
    descent = _BoundedDescent(solver.descent.linear_solver)
    return eqx.tree_at(
        lambda s: (s.search, s.descent), solver, (_ScaledTrustRegion(), descent)
    )


class _BroydenState(eqx.Module):
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


class _Best(NamedTuple):
    """The best point after a trial, and if the search has converged there."""

    y: Float[Array, " p"]
    f_info: Any
    aux: PyTree
    descent_state: PyTree
    done: Bool[Array, ""]


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
    search: _ScaledTrustRegion = _ScaledTrustRegion()
    descent: _BoundedDescent = _BoundedDescent(lx.QR())
    use_broyden: bool = True
    """If False, every Jacobian is exact."""
    batch: int = 1
    """Number of derivatives at once in an exact Jacobian."""
    mesh: Mesh | None = eqx.field(static=True, default=None)
    """Devices that share the derivatives; None for one."""

    @override
    def init(
        self,
        fn: Any,
        y: Any,
        args: Any,
        options: Any,
        f_struct: Any,
        aux_struct: Any,
        tags: Any,
    ) -> _BroydenState:
        # Placeholders: the first step replaces them whatever they are.
        def zeros(struct: Any) -> Array:
            return jnp.zeros(struct.shape, struct.dtype)

        matrix = jnp.zeros((*f_struct.shape, len(y)), f_struct.dtype)
        f_info = optx.FunctionInfo.ResidualJac(
            zeros(f_struct), lx.MatrixLinearOperator(matrix)
        )
        f_info_struct = jax.eval_shape(lambda: f_info)
        return _BroydenState(
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
        self, fn: Any, y: Any, args: Any, options: Any, state: _BroydenState, tags: Any
    ) -> tuple[Float[Array, " p"], _BroydenState, PyTree]:
        # An exact Jacobian costs a run per coordinate, a corrected one a single run.
        def exact():
            return _value_and_jacobian(
                fn, args=args, z=state.y_eval, batch=self.batch, mesh=self.mesh
            )

        def corrected():
            value, aux = on_first_device(
                self.mesh, lambda arguments: fn(*arguments), (state.y_eval, args)
            )
            rows = state.f_info.jac.as_matrix().T
            change = value - state.f_info.residual
            updated = _broyden_update(rows, step=state.y_eval - y, change=change)
            return _Linearization(value, rows=updated, aux=aux)

        # A batch of searches would run both branches of the condition.
        if self.use_broyden:
            trial = jax.lax.cond(state.first_step, exact, corrected)
        else:
            trial = exact()
        operator = lx.MatrixLinearOperator(trial.rows.T)
        f_eval_info = optx.FunctionInfo.ResidualJac(trial.value, operator)
        # The search compares the observed decrease of the loss with that of the linear
        # model, and adapts the damping.
        step_size, accept, search_result, search_state = self.search.step(
            first_step=state.first_step,
            y=y,
            y_eval=state.y_eval,
            f_info=state.f_info,
            f_eval_info=f_eval_info,
            state=state.search_state,
        )

        def is_small(new: Array, old: Array) -> Bool[Array, ""]:
            allowed = self.atol + self.rtol * jnp.abs(new)
            return self.norm(jnp.abs(new - old) / allowed) < 1

        def accepted():
            descent = self.descent.query(state.y_eval, f_eval_info, state.descent_state)
            # Both the coordinates and the residuals have stopped changing.
            settled = is_small(trial.value, state.f_info.residual)
            return _Best(
                y=state.y_eval,
                f_info=f_eval_info,
                aux=trial.aux,
                descent_state=descent,
                done=is_small(state.y_eval, y) & settled,
            )

        # A trial from an old Jacobian may fail: the caller restarts with an exact one.
        def rejected():
            return _Best(
                y=y,
                f_info=state.f_info,
                aux=state.aux,
                descent_state=state.descent_state,
                done=jnp.asarray(False),
            )

        # A rejected step is proposed again from the best point, with more damping.
        best = jax.lax.cond(accept, accepted, rejected)
        step, descent_result = self.descent.step(step_size, best.descent_state)
        succeeded = search_result == optx.RESULTS.successful
        result = optx.RESULTS.where(succeeded, descent_result, search_result)
        following = _BroydenState(
            first_step=jnp.asarray(False),
            y_eval=best.y + step,
            f_info=best.f_info,
            aux=best.aux,
            search_state=search_state,
            descent_state=best.descent_state,
            terminate=best.done,
            result=result,
        )
        return best.y, following, best.aux

    @override
    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: _BroydenState, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return state.terminate, state.result

    @override
    def postprocess(
        self,
        fn: Any,
        y: Any,
        aux: Any,
        args: Any,
        options: Any,
        state: _BroydenState,
        tags: Any,
        result: optx.RESULTS,
    ) -> tuple[Float[Array, " p"], PyTree, dict[str, Any]]:
        return y, aux, {}


def restart(state: Any, z: Float[Array, " p"]) -> Any:
    """State of any solver that evaluates z first, exactly, and accepts it."""
    return eqx.tree_at(
        lambda s: (s.first_step, s.y_eval), state, (jnp.asarray(True), z)
    )
