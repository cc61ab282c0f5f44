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
    start: Any,
    lower: float,
    upper: float,
    typical_size: float = 1.0,
    softplus: bool = False,
) -> Bijection:
    """Choose the bijection for a start, a number or an array, within two bounds.

    A bound may be infinite; `softplus` is used instead of exp for a lower one alone.
    Without bounds a start of 0 changes by the `typical_size`.
    """
    has_lower = math.isfinite(lower)
    has_upper = math.isfinite(upper)
    start = np.asarray(start, float)
    if has_lower and has_upper:
        return _interval(start, lower, upper)
    if has_lower and softplus:
        return _softplus_bounded(start, lower)
    if has_lower:
        return _half_bounded(start, bound=lower, sign=1)
    if has_upper:
        return _half_bounded(start, bound=upper, sign=-1)
    size = np.abs(start)
    scale = np.where(size > 0, size, typical_size)
    return Bijection(
        lambda z: _like(start, z) + _like(scale, z) * z,
        lambda value: (value - _like(start, value)) / _like(scale, value),
    )


def _like(constant: Any, z: Any) -> Array:
    # Constants are float64 on the host and must not promote a float32 trace.
    return jnp.asarray(constant, jnp.asarray(z).dtype)


def _half_bounded(start: np.ndarray, bound: float, sign: int) -> Bijection:
    # Equal steps of z are equal ratios, wherever the start is; the sign is that of the
    # distance from the bound.
    size = start - bound
    return Bijection(
        lambda z: bound + _like(size, z) * jnp.exp(sign * z),
        lambda value: sign * jnp.log((value - bound) / _like(size, value)),
    )


def _softplus_bounded(start: np.ndarray, lower: float) -> Bijection:
    # Linear in z far above the bound, so that the value may come close to it.
    size = start - lower
    offset = 1.0 + math.log(-math.expm1(-1.0))

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
