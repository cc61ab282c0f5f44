"""A search for the best coordinates: one optimistix solver, stepped from the host.

After every step the host can report progress, save the state and stop. All steps are
one compiled program: what changes between steps, and between fits of one shape, are
arrays.

| method | derivatives | for |
|---|---|---|
| Levenberg-Marquardt | the Jacobian, forward mode | some dozens of values |
| Gauss-Newton | products with it, forward and reverse | hundreds |
| BFGS, L-BFGS | the gradient, reverse mode | dozens; fields of thousands |
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax.custom_derivatives import linear_call
from jax.sharding import Mesh
from jaxtyping import Array, Float
from scipy.stats import qmc

from jaxthermo.parallel.batch import on_every_device, over_devices, part_of
from jaxthermo.parallel.lattice import replicated

from ..config.schema import FitConfig
from ..problem.problem import Problem, RunDiagnostics, Traced, Views
from ..problem.time_steps import StepTables
from .levenberg_marquardt import BroydenLevenbergMarquardt, restart, with_trust_region


class Objective(eqx.Module):
    """Residuals as a function of z, whose arrays are arguments of the compiled step."""

    traced: Traced
    step_tables: StepTables
    knee: Float[Array, ""]
    """Residual beyond which it counts linearly; infinite for squares."""
    noise: Float[Array, " r"]
    """Values added to the residuals, as those of repeated measurements."""
    views: Views = ()
    """Views of cameras whose poses are fitted, near those of the point."""
    reverse: Traced | None = None
    """Residuals whose time steps can be differentiated in reverse mode."""


def make_objective(problem: Problem, step_tables: StepTables) -> Objective:
    """Trace a problem's residuals, in forward mode."""
    z = problem.start()
    views = problem.views_at(z)
    traced = problem.trace(step_tables)
    rows, _ = jax.eval_shape(traced, z, step_tables, views)
    noise = jnp.zeros(rows.shape, rows.dtype)
    # Plain squares without noise are the same program with other arrays.
    knee = jnp.asarray(jnp.inf, problem.dtype)
    return Objective(
        traced=traced,
        step_tables=step_tables,
        knee=knee,
        noise=noise,
        views=views,
    )


def with_step_tables(objective: Objective, step_tables: StepTables) -> Objective:
    """Objective with other steps in time."""
    return eqx.tree_at(lambda o: o.step_tables, objective, step_tables)


def with_views(objective: Objective, views: Views) -> Objective:
    """Objective with the views of cameras in other poses."""
    if not views:
        return objective
    return eqx.tree_at(lambda o: o.views, objective, views)


def forward_only(objective: Objective) -> Objective:
    """Objective without its reverse mode, which is compiled for more than its values.

    Programs of residuals then do not change when reverse mode is traced again.
    """
    return replace(objective, reverse=None)


def residuals(
    z: Array, objective: Objective, in_reverse: bool = False
) -> tuple[Array, RunDiagnostics]:
    """Residuals at z, whose squares are minimized, as optimistix calls them."""
    traced = objective.reverse if in_reverse else objective.traced
    assert traced is not None
    values, diagnostics = traced(z, objective.step_tables, objective.views)
    # r' = r sqrt(2 / (1 + sqrt(1 + (r / k)^2))): the squares of r' are the pseudo-Huber
    # loss of r.
    # Source: Charbonnier et al., IEEE Trans. Image Processing 6 (1997) 298-311.
    rows = values + objective.noise
    ratio = rows / objective.knee
    return rows * jnp.sqrt(2 / (1 + jnp.sqrt(1 + ratio * ratio))), diagnostics


def _with_tangent(
    function: Callable[[Array, Objective], tuple[Array, Any]],
    linearize: Callable[[Array, Objective, Array], tuple[tuple[Array, Any], Array]],
) -> Callable[[Array, Objective], tuple[Array, Any]]:
    # optimistix linearizes the function that it is given; here the tangents come from
    # another program than the values.
    @jax.custom_jvp
    def with_tangent(z, objective):
        return function(z, objective)

    @with_tangent.defjvp
    def _(primals, tangents):
        z, objective = primals
        (value, diagnostics), tangent = linearize(z, objective, tangents[0])
        zeros = jax.tree.map(_zero_tangent, diagnostics)
        return (value, diagnostics), (tangent, zeros)

    return with_tangent


def _zero_tangent(value: Array) -> Any:
    # JAX gives integers and booleans tangents of a type of their own.
    if jnp.issubdtype(value.dtype, jnp.inexact):
        return jnp.zeros_like(value)
    return np.zeros(value.shape, jax.dtypes.float0)


def _residual_products(z: Array, objective: Objective, tangent: Array) -> Any:
    # Forward products by the fast time loop, transposed ones by the reverse-mode loop.
    arrays, static = eqx.partition(objective, eqx.is_array)

    def forward(point, tangent):
        z, arrays = point
        objective = eqx.combine(arrays, static)
        return jax.jvp(lambda y: residuals(y, objective)[0], (z,), (tangent,))[1]

    def transposed(point, cotangent):
        z, arrays = point
        objective = eqx.combine(arrays, static)
        return jax.vjp(lambda y: residuals(y, objective, True)[0], z)[1](cotangent)[0]

    product = linear_call(forward, transposed, (z, arrays), tangent)
    return residuals(z, objective), product


def _loss(z: Array, objective: Objective) -> tuple[Array, RunDiagnostics]:
    values, diagnostics = residuals(z, objective)
    return _half_sum(values), diagnostics


def _loss_gradient(z: Array, objective: Objective, tangent: Array) -> Any:
    value, gradient = jax.value_and_grad(
        lambda y: _half_sum(residuals(y, objective, in_reverse=True)[0])
    )(z)
    return (value, residuals(z, objective)[1]), gradient @ tangent


def _half_sum(values: Float[Array, " r"]) -> Float[Array, ""]:
    return 0.5 * (values * values).sum()


residuals_with_products = _with_tangent(residuals, _residual_products)
"""Residuals whose derivatives are products, forward and reverse."""
_FUNCTIONS = {
    "levenberg_marquardt": residuals,
    "gauss_newton": residuals_with_products,
    "bfgs": _with_tangent(_loss, _loss_gradient),
    "lbfgs": _with_tangent(_loss, _loss_gradient),
}
# Only BFGS and L-BFGS read it.
_OPTIONS = {"autodiff_mode": "bwd"}


def _make_solver(
    settings: FitConfig, batch: int, use_broyden: bool, mesh: Mesh | None
) -> Any:
    tolerance = settings.tolerance
    match settings.method:
        case "levenberg_marquardt":
            return BroydenLevenbergMarquardt(
                rtol=tolerance,
                atol=tolerance,
                use_broyden=use_broyden,
                batch=batch,
                mesh=mesh,
            )
        case "gauss_newton":
            # By products with J^T J alone, which need no Jacobian.
            linear = lx.Normal(lx.CG(rtol=1e-3, atol=1e-8, max_steps=100))
            solver = optx.LevenbergMarquardt(
                rtol=tolerance, atol=tolerance, linear_solver=linear
            )
            return with_trust_region(solver)
        case "bfgs":
            return optx.BFGS(rtol=tolerance, atol=tolerance)
        case _:
            return optx.LBFGS(rtol=tolerance, atol=tolerance, history_length=20)


REVERSE_METHODS = ("gauss_newton", "bfgs", "lbfgs")
"""Methods that take derivatives in reverse mode."""


class Search:
    """Steps of one solver on one objective, whose arrays later steps may replace."""

    def __init__(
        self,
        objective: Objective,
        settings: FitConfig,
        batch: int,
        use_broyden: bool = True,
        mesh: Mesh | None = None,
    ):
        """Nothing is traced yet; `batch` forward-mode derivatives are taken at once.

        With `use_broyden` Levenberg-Marquardt keeps its Jacobian between points. The
        devices of a `mesh` share the derivatives.
        """
        self._function = _FUNCTIONS[settings.method]
        self._mesh = mesh
        self._solver = _make_solver(
            settings, batch=batch, use_broyden=use_broyden, mesh=mesh
        )
        self._objective = objective
        self._compiled: Any = None
        self._initial: Any = None
        is_levenberg_marquardt = settings.method == "levenberg_marquardt"
        self.keeps_jacobian = use_broyden and is_levenberg_marquardt

    def start(self, z: Float[Array, " p"]) -> Any:
        """State of the solver that evaluates z first."""
        if self._initial is None:
            # Once only: the states of optimistix hold programs, which are compared by
            # identity, so that another start would be compiled again.
            residuals_struct, aux_struct = eqx.filter_eval_shape(
                self._function, z, self._objective
            )
            self._initial = self._solver.init(
                fn=self._function,
                y=z,
                args=self._objective,
                options=_OPTIONS,
                f_struct=residuals_struct,
                aux_struct=aux_struct,
                tags=frozenset(),
            )
        return restart(self._initial, z)

    def advance(self, z: Any, state: Any, objective: Objective) -> tuple[Any, Any, Any]:
        """One step, not compiled: best point, state of the solver, and end."""
        shared = {
            "fn": self._function,
            "args": objective,
            "options": _OPTIONS,
            "tags": frozenset(),
        }
        z, state, _ = self._solver.step(y=z, state=state, **shared)
        done, _ = self._solver.terminate(y=z, state=state, **shared)
        arrays, static = eqx.partition(state, eqx.is_array)
        z, arrays, done = replicated(self._mesh, (z, arrays, done))
        return z, eqx.combine(arrays, static), done

    def compile(self, z: Float[Array, " p"], state: Any) -> Callable[..., Any]:
        """`advance` compiled ahead and once, so that steps can be timed without it."""
        if self._compiled is None:
            replicate = partial(on_every_device, self._mesh)
            arguments = replicate((z, state, self._objective))
            compiled = eqx.filter_jit(self.advance).lower(*arguments).compile()

            def advance(*arguments: Any) -> Any:
                return compiled(*replicate(arguments))

            self._compiled = advance
        return self._compiled


def best_loss(state: Any) -> float:
    """Half of the sum of squares at the best point."""
    # Least-squares solvers keep residuals, minimizers their loss.
    info = state.f_info
    if hasattr(info, "residual"):
        return float(0.5 * (np.asarray(info.residual) ** 2).sum())
    return float(info.f)


def start_points(
    count: int, size: int, spread: float, seed: int
) -> Float[np.ndarray, "n p"]:
    """Start points around 0, which is the first of them.

    Normally distributed by a scrambled Sobol' sequence, which is even for few points.
    """
    if count == 1:
        return np.zeros((1, size))
    sampler = qmc.MultivariateNormalQMC(
        np.zeros(size), spread**2 * np.eye(size), rng=np.random.default_rng(seed)
    )
    # Sobol' points are balanced in powers of 2.
    power = 1 << max(count - 2, 0).bit_length()
    drawn = np.asarray(sampler.random(power))[: count - 1]
    return np.concatenate([np.zeros((1, size)), drawn])


@eqx.filter_jit
def losses(
    objective: Objective,
    points: Float[Array, "n p"],
    batch: int,
    mesh: Mesh | None = None,
) -> Float[Array, " n"]:
    """Half of the sum of squares at each point; infinite where it is not finite."""

    def at(points, objective):
        def loss(z):
            half_sum = 0.5 * (residuals(z, objective)[0] ** 2).sum()
            # A start whose run diverges is left out without an error.
            return jnp.where(jnp.isfinite(half_sum), half_sum, jnp.inf)

        size = max(1, min(part_of(mesh, batch), len(points)))
        return jax.lax.map(loss, points, batch_size=size), None

    return over_devices(mesh, function=at, batch=points, constants=objective)[0]


def batched(
    search: Search, starts: Float[Array, "n p"], batch: int
) -> tuple[Any, Callable[..., Any]]:
    """States of searches from several starts, and the step that advances them all."""
    states = [search.start(z) for z in starts]
    arrays = [eqx.filter(state, eqx.is_array) for state in states]
    # Programs in the states are the same for all starts.
    static = eqx.filter(states[0], eqx.is_array, inverse=True)

    @eqx.filter_jit
    def advance(z, states, objective):
        def single(start):
            state = eqx.combine(start[1], static)
            z, state, done = search.advance(start[0], state, objective)
            return z, eqx.filter(state, eqx.is_array), done

        return jax.lax.map(single, (z, states), batch_size=batch)

    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *arrays), advance
