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

import abc
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override


Values = Float[Array | np.ndarray, "*n"]


class AbstractBijection(eqx.Module):
    """A map from unconstrained coordinates to values within bounds, and its inverse."""

    @abc.abstractmethod
    def value(self, z: Values) -> Values:
        """Values of the coordinates z."""

    @abc.abstractmethod
    def coordinate(self, value: Values) -> Values:
        """Coordinates of values within the bounds."""


def _like(constant: Any, z: Any) -> Array:
    # Constants are float64 on the host and must not promote a float32 trace.
    return jnp.asarray(constant, jnp.asarray(z).dtype)


def _log(value: Any) -> Any:
    # Host constants stay in numpy, so that float64 is kept under a float32 trace.
    on_host = isinstance(value, np.ndarray | np.generic)
    return np.log(value) if on_host else jnp.log(value)


class _Affine(AbstractBijection):
    """start + scale z: no bounds."""

    start: Any
    scale: Any

    @override
    def value(self, z: Values) -> Values:
        return _like(self.start, z) + _like(self.scale, z) * z

    @override
    def coordinate(self, value: Values) -> Values:
        return (value - _like(self.start, value)) / _like(self.scale, value)


class _LowerBounded(AbstractBijection):
    """lower + (start - lower) exp(z): equal steps of z are equal ratios."""

    start: Any
    lower: Any

    @override
    def value(self, z: Values) -> Values:
        return self.lower + _like(self.start - self.lower, z) * jnp.exp(z)

    @override
    def coordinate(self, value: Values) -> Values:
        return jnp.log((value - self.lower) / _like(self.start - self.lower, value))


class _SoftplusBounded(AbstractBijection):
    """lower + s log(1 + exp(z + z_0)): linear in z far above the lower bound."""

    start: Any
    lower: Any

    @override
    def value(self, z: Values) -> Values:
        softplus = jax.nn.softplus(z + _like(_inverse_softplus(1.0), z))
        return self.lower + _like(self.start - self.lower, z) * softplus

    @override
    def coordinate(self, value: Values) -> Values:
        ratio = (value - self.lower) / _like(self.start - self.lower, value)
        return _inverse_softplus(ratio) - _like(_inverse_softplus(1.0), value)


def _inverse_softplus(y: Any) -> Any:
    xp = np if isinstance(y, float) else jnp
    # log(exp(y) - 1) without the overflow of exp for large y.
    return y + xp.log(-xp.expm1(-xp.asarray(y)))


class _UpperBounded(AbstractBijection):
    """upper - (upper - start) exp(-z)."""

    start: Any
    upper: Any

    @override
    def value(self, z: Values) -> Values:
        return self.upper - _like(self.upper - self.start, z) * jnp.exp(-z)

    @override
    def coordinate(self, value: Values) -> Values:
        return -jnp.log((self.upper - value) / _like(self.upper - self.start, value))


class _Interval(AbstractBijection):
    """A logistic curve between two bounds, in log(value) where both are positive."""

    start: Any
    lower: float = eqx.field(static=True)
    upper: float = eqx.field(static=True)

    @property
    def _is_logarithmic(self) -> bool:
        return self.lower > 0

    def _inner(self, value: Any) -> Any:
        return _log(value) if self._is_logarithmic else value

    def _ends(self) -> tuple[float, float]:
        ends = (self.lower, self.upper)
        return (math.log(ends[0]), math.log(ends[1])) if self._is_logarithmic else ends

    def _logit(self, value: Any) -> Any:
        low, high = self._ends()
        inner = self._inner(value)
        return _log((inner - low) / (high - inner))

    def _steepness(self) -> Any:
        # Chosen so that z = 1 changes the value by about its own size at the start.
        low, high = self._ends()
        inner = self._inner(self.start)
        slope = (inner - low) * (high - inner) / (high - low)
        linear_size = np.maximum(np.abs(inner), high - low) / 4
        return (1.0 if self._is_logarithmic else linear_size) / slope

    @override
    def value(self, z: Values) -> Values:
        low, high = self._ends()
        steepness, offset = (
            _like(self._steepness(), z),
            _like(self._logit(self.start), z),
        )
        inner = low + (high - low) * jax.nn.sigmoid(steepness * z + offset)
        return jnp.exp(inner) if self._is_logarithmic else inner

    @override
    def coordinate(self, value: Values) -> Values:
        offset = _like(self._logit(self.start), value)
        return (self._logit(value) - offset) / _like(self._steepness(), value)


def bijection(
    start: Any, lower: float, upper: float, softplus: bool = False
) -> AbstractBijection:
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
        return _Interval(start, lower, upper)
    if has_lower:
        return (_SoftplusBounded if softplus else _LowerBounded)(start, lower)
    if has_upper:
        return _UpperBounded(start, upper)
    size = np.abs(start)
    return _Affine(start, np.where(size > 0, size, 1.0))
