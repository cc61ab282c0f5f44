"""Bijections between an optimizer's unconstrained coordinate z and bounded values.

| bounds | value of z |
|---|---|
| none | start + scale z |
| lower | lower + (start - lower) exp(z) |
| lower, softplus | lower + s log(1 + exp(z + z_0)), s = start - lower |
| upper | upper - (upper - start) exp(-z) |
| both | lower + (upper - lower) / (1 + exp(-z - z_0)) |

Each gives the start at z = 0, and changes the value by about its own size for z = 1.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


Values = Float[Array | np.ndarray, "*n"]


class Bijection(NamedTuple):
    """A map from unconstrained coordinates to values within bounds, and its inverse."""

    value: Callable[[Values], Values]
    coordinate: Callable[[Values], Values]


def bijection(
    start: Any, lower: float, upper: float, softplus: bool = False
) -> Bijection:
    """Choose the bijection for a start strictly between two bounds.

    Args:
        start: one number or an array, which z = 0 stands for.
        lower: bound, or -inf.
        upper: bound, or inf.
        softplus: use softplus instead of exp for a single lower bound.
    """
    has_lower, has_upper = math.isfinite(lower), math.isfinite(upper)
    start = np.asarray(start, float)
    if has_lower and has_upper:
        return _interval(start, lower, upper)
    if has_lower:
        return (_softplus_bounded if softplus else _lower_bounded)(start, lower)
    if has_upper:
        return _upper_bounded(start, upper)
    size = np.abs(start)
    scale = np.where(size > 0, size, 1.0)
    return Bijection(
        lambda z: _like(start, z) + _like(scale, z) * z,
        lambda value: (value - _like(start, value)) / _like(scale, value),
    )


def _like(constant: Any, z: Any) -> Array:
    # Constants are float64 on the host and must not promote a float32 trace.
    return jnp.asarray(constant, jnp.asarray(z).dtype)


def _lower_bounded(start: np.ndarray, lower: float) -> Bijection:
    # Equal steps of z are equal ratios, wherever the start is.
    size = start - lower
    return Bijection(
        lambda z: lower + _like(size, z) * jnp.exp(z),
        lambda value: jnp.log((value - lower) / _like(size, value)),
    )


def _upper_bounded(start: np.ndarray, upper: float) -> Bijection:
    size = upper - start
    return Bijection(
        lambda z: upper - _like(size, z) * jnp.exp(-z),
        lambda value: -jnp.log((upper - value) / _like(size, value)),
    )


def _softplus_bounded(start: np.ndarray, lower: float) -> Bijection:
    # Linear in z far above the bound, so that the value may come close to it.
    size, offset = start - lower, 1.0 + math.log(-math.expm1(-1.0))

    def coordinate(value: Values) -> Values:
        ratio = (value - lower) / _like(size, value)
        # log(exp(y) - 1) without the overflow of exp for a large y.
        inverse = ratio + jnp.log(-jnp.expm1(-jnp.asarray(ratio)))
        return inverse - _like(offset, value)

    return Bijection(
        lambda z: lower + _like(size, z) * jax.nn.softplus(z + _like(offset, z)),
        coordinate,
    )


def _interval(start: np.ndarray, lower: float, upper: float) -> Bijection:
    # The logistic curve is one of log(value) where both bounds are positive.
    logarithmic = lower > 0
    low, high = (math.log(lower), math.log(upper)) if logarithmic else (lower, upper)
    inner = np.log(start) if logarithmic else start
    offset = np.log((inner - low) / (high - inner))
    # Steep enough that z = 1 changes the value by about its own size at the start.
    slope = (inner - low) * (high - inner) / (high - low)
    size = 1.0 if logarithmic else np.maximum(np.abs(inner), high - low) / 4
    steepness = size / slope

    def value(z: Values) -> Values:
        fraction = jax.nn.sigmoid(_like(steepness, z) * z + _like(offset, z))
        inner = low + (high - low) * fraction
        return jnp.exp(inner) if logarithmic else inner

    def coordinate(value: Values) -> Values:
        inner = jnp.log(value) if logarithmic else value
        logit = jnp.log((inner - low) / (high - inner))
        return (logit - _like(offset, value)) / _like(steepness, value)

    return Bijection(value, coordinate)
