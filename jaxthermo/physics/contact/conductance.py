"""Conductance of a contact: half a cell of either body, and what is between them.

    1 / G = 1 / G_a + 1 / (h_c A) + 1 / G_b,    G_a = k_a A / d_a

h_c is 1 to 1e6 W/(m^2 K) in practice; infinity bonds the bodies and 0 parts them, both
exactly. Pure functions, with finite derivatives at either end.
"""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Scalar, is_traced
from ...errors import InputError
from ...network.network import inverse


Rows = Float[Array | np.ndarray, "*p"]


def contact_conductance_of(
    area: Rows, half_a: Rows, half_b: Rows, coefficient: Scalar | Rows
) -> Rows:
    """Conductance from node to node through each pair [W/K].

    Args:
        area: of contact [m^2]; 0 in rows that only fill an array.
        half_a: from the contact to A's node, k A / distance [W/K].
        half_b: from the contact to B's node [W/K].
        coefficient: h_c [W/(m^2 K)], 0 to infinity: a number, or one a pair.
    """
    h_c = jnp.asarray(coefficient, area.dtype)
    finite = jnp.isfinite(h_c)
    # The derivative of inf * area would be infinite.
    between = jnp.where(finite, jnp.where(finite, h_c, 1) * area, jnp.inf)
    return series_conductance(half_a, half_b, between)


def series_conductance(first: Rows, *others: Rows) -> Rows:
    """Conductances one after the other [W/K], 0 to infinity but not all infinite.

    G = low / (1 + low / high) of two: no product to overflow, and no 0 / 0.
    """
    total = jnp.asarray(first)
    for other in others:
        low, high = jnp.minimum(total, other), jnp.maximum(total, other)
        total = low / (1 + low * inverse(high))
    return total


def half_conductance(half_cell: Rows, area: Rows, fragment_area: Rows) -> Rows:
    """The part of a fragment's half cell that lies behind a contact [W/K].

    G_half = k A / d = (k A_fragment / d) * A / A_fragment

    Args:
        half_cell: of each pair's fragment, k A_fragment / d [W/K].
        area: of contact [m^2].
        fragment_area: of each pair's fragment [m^2].
    """
    return half_cell * area * inverse(jnp.asarray(fragment_area))


def closeness(gap: Rows, gap_length: Scalar) -> Rows:
    """How much of h_c is left across a gap: 1 where surfaces touch, 0 from a length on.

    w = 1 - s^2 (3 - 2 s), s = gap / gap_length held to [0, 1]: smooth to the first
    derivative. A model without pressure; the length is that of asperities and waviness.

    Args:
        gap: between the surfaces [m], negative where they overlap.
        gap_length: where heat no longer passes [m].

    Raises:
        InputError: if the length is not positive.
    """
    if not is_traced(gap_length) and not 0 < float(gap_length) < math.inf:
        raise InputError(
            f"contact gap_length {float(gap_length)!r}: give a positive length [m]"
        )
    s = jnp.clip(gap / jnp.asarray(gap_length, gap.dtype), 0, 1)
    return 1 - s * s * (3 - 2 * s)


def coefficient_across(
    gap: Rows, coefficient: Scalar | Rows, gap_length: Scalar
) -> Rows:
    """The h_c of every pair at its gap [W/(m^2 K)].

    Args:
        gap: between the surfaces [m].
        coefficient: h_c of surfaces that touch, 0 to infinity [W/(m^2 K)].
        gap_length: as for `closeness`.

    Raises:
        InputError: if the length is not positive.
    """
    h_c = jnp.asarray(coefficient, gap.dtype)
    left = closeness(gap, gap_length)
    finite = jnp.isfinite(h_c)
    bonded = jnp.where(left > 0, jnp.asarray(jnp.inf, gap.dtype), 0)
    return jnp.where(finite, jnp.where(finite, h_c, 1) * left, bonded)
