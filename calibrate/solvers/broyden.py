"""Jacobians of residuals: exact, in forward mode, or kept and corrected by secants.

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
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxthermo.network.network import inverse


_ResidualFunction = Callable[..., tuple[Float[Array, " r"], Any]]


def value_and_jacobian(
    function: _ResidualFunction, z: Float[Array, " p"], batch: int
) -> tuple[Float[Array, " r"], Float[Array, "p r"], Any]:
    """Residuals, rows of their Jacobian, and auxiliary output of a function at z."""
    tangent = lambda t: jax.jvp(function, (z,), (t,), has_aux=True)
    # Forward mode: the time loop keeps no history of states.
    directions = jnp.eye(len(z), dtype=z.dtype)
    if batch >= len(z):
        # The value comes with the derivatives, which saves a run.
        return jax.vmap(tangent, out_axes=(None, 0, None))(directions)
    value, aux = function(z)
    rows = jax.lax.map(lambda t: tangent(t)[1], directions, batch_size=batch)
    return value, rows, aux


@eqx.filter_jit
def jacobian_rows(
    function: _ResidualFunction, args: Any, z: Float[Array, " p"], batch: int
) -> Float[Array, "p r"]:
    """Rows of the Jacobian of `function(z, args)`, compiled once per shape."""
    return value_and_jacobian(lambda y: function(y, args), z, batch)[1]


def broyden_update(
    rows: Float[Array, "p r"], step: Float[Array, " p"], change: Float[Array, " r"]
) -> Float[Array, "p r"]:
    """Correct a Jacobian by the change of the residuals over a step."""
    # A step of length 0 changes nothing: `inverse` is 0 there.
    direction = step * inverse(step @ step)
    return rows + direction[:, None] * (change - step @ rows)[None, :]
