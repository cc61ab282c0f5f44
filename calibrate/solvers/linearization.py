"""What optimistix is given to linearize: functions whose tangents are ready made.

- `by_jacobian`: misfits and their Jacobian at once, in forward mode; a tangent is a
  product with it. A trial point costs a run and a derivative for each value, and the
  linear solves of a step cost no run at all.
- `by_products`: misfits; a tangent is a run in forward mode, its transpose one in
  reverse.
- `by_gradient`: half of the sum of squares, with its gradient in reverse mode.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import linear_call
from jaxtyping import Array, Float

from ..problem.problem import Layouts, Seen, with_jacobian
from .broyden import Known, corrected
from .jaxpr_function import Traced


class Program(eqx.Module):
    """What a search runs: its arrays are arguments of the compiled steps."""

    traced: Traced
    layouts: Layouts
    knee: Float[Array, ""]
    """Misfit above which it counts linearly."""
    noise: Float[Array, "*_"]
    """Added to the misfits."""
    backward: Traced | None = None
    """The misfits by steps that reverse mode goes back through."""
    known: Known | None = None
    """Of the point before; None where every Jacobian is found anew."""


def softened(misfits: Float[Array, " r"], knee: Float[Array, ""]) -> Float[Array, " r"]:
    """Misfits whose squares are the pseudo-Huber loss.

        r' = r sqrt(2 / (1 + sqrt(1 + (r / k)^2)))

    Args:
        misfits: r.
        knee: k; infinite for squares.

    Source: Charbonnier et al., IEEE Transactions on Image Processing 6 (1997) 298-311.
    """
    ratio = misfits / knee
    return misfits * jnp.sqrt(2 / (1 + jnp.sqrt(1 + ratio * ratio)))


def residuals(program: Program, z: Float[Array, " p"]) -> tuple[Array, Seen]:
    """What is squared."""
    misfits, seen = program.traced(z, program.layouts)
    return softened(misfits + program.noise, program.knee), seen


def backward_residuals(program: Program, z: Float[Array, " p"]) -> Array:
    """The same, for reverse mode."""
    assert program.backward is not None
    misfits, _ = program.backward(z, program.layouts)
    return softened(misfits + program.noise, program.knee)


def _with_tangent(
    function: Callable[[Program, Array], tuple[Array, Seen]],
    linearize: Callable[[Program, Array, Array], tuple[tuple[Array, Seen], Array]],
) -> Callable[..., tuple[Array, Seen]]:
    """A function whose tangents are ready made; what was seen has none.

    Args:
        function: of a program and z.
        linearize: of both and a tangent of z: the same, and the value's tangent.
    """

    @jax.custom_jvp
    def given(z, program):
        return function(program, z)

    @given.defjvp
    def _(primals, tangents):
        z, program = primals
        (value, seen), moved = linearize(program, z, tangents[0])
        return (value, seen), (moved, jax.tree.map(_zero_tangent, seen))

    return given


def by_jacobian(batch: int) -> Callable[..., tuple[Array, Seen]]:
    """The residuals, whose derivative is a product with a Jacobian of their own.

    It is the one before, corrected, where that is known and nothing asks for another.
    """

    def linearize(program, z, along):
        anew = lambda: with_jacobian(lambda y: residuals(program, y), z, batch)
        known = program.known

        def by_one_run():
            value, seen = residuals(program, z)
            return value, corrected(known, z, value), seen

        always = known is None
        found = anew() if always else jax.lax.cond(known.fresh, anew, by_one_run)
        value, rows, seen = found
        return (value, seen), along @ rows

    return _with_tangent(residuals, linearize)


def by_products(batch: int) -> Callable[..., tuple[Array, Seen]]:
    """The residuals, whose derivative is a product without a Jacobian."""
    del batch

    def linearize(program, z, along):
        arrays, static = eqx.partition(program, eqx.is_array)

        def forward(point, along):
            z, arrays = point
            own = eqx.combine(arrays, static)
            return jax.jvp(lambda y: residuals(own, y)[0], (z,), (along,))[1]

        def back(point, pulled):
            z, arrays = point
            own = eqx.combine(arrays, static)
            _, pull = jax.vjp(lambda y: backward_residuals(own, y), z)
            return pull(pulled)[0]

        return residuals(program, z), linear_call(forward, back, (z, arrays), along)

    return _with_tangent(residuals, linearize)


def by_gradient(batch: int) -> Callable[..., tuple[Array, Seen]]:
    """Half of the sum of squares, whose derivative is a product with its gradient."""
    del batch

    def loss(program, z):
        found, seen = residuals(program, z)
        return _half_sum(found), seen

    def linearize(program, z, along):
        back = lambda y: _half_sum(backward_residuals(program, y))
        value, slope = jax.value_and_grad(back)(z)
        return (value, residuals(program, z)[1]), slope @ along

    return _with_tangent(loss, linearize)


def _half_sum(values: Float[Array, " r"]) -> Float[Array, ""]:
    return 0.5 * (values * values).sum()


def _zero_tangent(value: Array) -> Any:
    if jnp.issubdtype(value.dtype, jnp.inexact):
        return jnp.zeros_like(value)
    return np.zeros(value.shape, jax.dtypes.float0)
