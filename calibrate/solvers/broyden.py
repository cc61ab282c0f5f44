"""Derivatives that are kept from point to point, and corrected by what a run shows.

A Jacobian costs a run and one or more for each value, a run alone costs one. Between
points that are near each other the last one will do, if it is made to tell the change
that was seen between them (Broyden's rule):

    J' = J + (r' - r - J d) d^T / |d|^2,  d = z' - z.

It is found anew where a step by such a Jacobian fails or the fit would end by it (see
`decide`), and at what was found: what is told of the values is never by a guess.

Source: Broyden, Mathematics of Computation 19 (1965) 577-593; for least squares with
damping Madsen, Nielsen and Tingleff, Methods for Non-Linear Least Squares Problems,
IMM, Technical University of Denmark (2004), 3.5.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxthermo.network.network import inverse


class Known(eqx.Module):
    """What is known of the misfits at the best point so far."""

    z: Float[Array, " p"]
    residual: Float[Array, " r"]
    rows: Float[Array, "p r"]
    """Of the Jacobian, transposed."""
    fresh: Bool[Array, ""]
    """Whether it is to be found anew where the next step goes."""


def known_of(z: Float[Array, " p"], misfits: Any, fresh: Bool[Array, ""]) -> Known:
    """What the state of a search holds.

    Args:
        z: its best point.
        misfits: optimistix' residual and its Jacobian there, an operator.
        fresh: whether the next Jacobian is to be found anew.
    """
    rows = jax.vmap(misfits.jac.mv)(jnp.eye(len(z), dtype=z.dtype))
    return Known(z, misfits.residual, rows, fresh)


def corrected(
    known: Known, z: Float[Array, " p"], value: Float[Array, " r"]
) -> Float[Array, "p r"]:
    """The rows at another point, by its misfits alone.

    Args:
        known: of a point before.
        z: the other.
        value: its misfits.
    """
    moved = z - known.z
    unseen = value - known.residual - moved @ known.rows
    along = moved * inverse(moved @ moved)
    return known.rows + along[:, None] * unseen[None, :]
