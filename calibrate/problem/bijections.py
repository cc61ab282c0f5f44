"""Bijections between what an optimizer moves freely and values within their bounds.

| bounds | value of z |
|---|---|
| none | start + scale z |
| a lower one only | lower + (start - lower) exp(z) |
| the same, softplus | lower + s log(1 + exp(z + z_0)), s = start - lower |
| an upper one only | upper - (upper - start) exp(-z) |
| both | lower + (upper - lower) / (1 + exp(-z - z_0)) |

All are 0 at the start, and change the value by about its own size for z of 1.
"""

import abc
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


Values = Float[Array | np.ndarray, "*n"]


class AbstractTransform(eqx.Module):
    """From a free number to a value."""

    @abc.abstractmethod
    def value(self, z: Values) -> Values:
        """The value that a free number stands for."""

    @abc.abstractmethod
    def free(self, value: Values) -> Values:
        """The free number of a value within the bounds."""


def _like(constant: Any, z: Any) -> Array:
    """A constant in the precision of what it meets."""
    return jnp.asarray(constant, jnp.asarray(z).dtype)


class Shifted(AbstractTransform):
    """No bounds."""

    start: Any
    scale: Any

    def value(self, z: Values) -> Values:
        """Start + scale z."""
        return _like(self.start, z) + _like(self.scale, z) * z

    def free(self, value: Values) -> Values:
        """(Value - start) / scale."""
        return (value - _like(self.start, value)) / _like(self.scale, value)


class Above(AbstractTransform):
    """A lower bound, as of what is positive; exp keeps a factor 2 the same anywhere."""

    start: Any
    lower: Any

    def value(self, z: Values) -> Values:
        """Lower + (start - lower) exp(z)."""
        return self.lower + _like(self.start - self.lower, z) * jnp.exp(z)

    def free(self, value: Values) -> Values:
        """log((value - lower) / (start - lower))."""
        return jnp.log((value - self.lower) / _like(self.start - self.lower, value))


class SoftAbove(AbstractTransform):
    """A lower bound that the value may come close to: far above it z is linear."""

    start: Any
    lower: Any

    @property
    def _size(self) -> Any:
        return self.start - self.lower

    def value(self, z: Values) -> Values:
        """Lower + s log(1 + exp(z + z_0))."""
        moved = jax.nn.softplus(z + _like(_inverse_softplus(1.0), z))
        return self.lower + _like(self._size, z) * moved

    def free(self, value: Values) -> Values:
        """The inverse."""
        share = (value - self.lower) / _like(self._size, value)
        return _inverse_softplus(share) - _like(_inverse_softplus(1.0), value)


def _inverse_softplus(y: Any) -> Any:
    own = np if isinstance(y, float) else jnp
    return y + own.log(-own.expm1(-own.asarray(y)))


class Below(AbstractTransform):
    """An upper bound."""

    start: Any
    upper: Any

    def value(self, z: Values) -> Values:
        """Upper - (upper - start) exp(-z)."""
        return self.upper - _like(self.upper - self.start, z) * jnp.exp(-z)

    def free(self, value: Values) -> Values:
        """-log((upper - value) / (upper - start))."""
        return -jnp.log((self.upper - value) / _like(self.upper - self.start, value))


class Between(AbstractTransform):
    """Two bounds; in the logarithm of the value where both are positive."""

    start: Any
    lower: float = eqx.field(static=True)
    upper: float = eqx.field(static=True)

    @property
    def _by_ratio(self) -> bool:
        return self.lower > 0

    def _inner(self, value: Any) -> Any:
        if not self._by_ratio:
            return value
        known = isinstance(value, np.ndarray)
        return np.log(value) if known else jnp.log(value)

    def _ends(self) -> tuple[float, float]:
        both = (self.lower, self.upper)
        return (math.log(both[0]), math.log(both[1])) if self._by_ratio else both

    def _logit(self, value: Any) -> Any:
        low, high = self._ends()
        inner = self._inner(value)
        ratio = (inner - low) / (high - inner)
        known = isinstance(ratio, np.ndarray | np.generic)
        return np.log(ratio) if known else jnp.log(ratio)

    def _steep(self) -> Any:
        """Of the logistic curve at the start, in units of the value's own size."""
        low, high = self._ends()
        inner = self._inner(self.start)
        slope = (inner - low) * (high - inner) / (high - low)
        size = 1.0 if self._by_ratio else np.maximum(np.abs(inner), high - low) / 4
        return size / slope

    def value(self, z: Values) -> Values:
        """Lower + (upper - lower) of the logistic function."""
        low, high = self._ends()
        steep, first = _like(self._steep(), z), _like(self._logit(self.start), z)
        share = jax.nn.sigmoid(steep * z + first)
        inner = low + (high - low) * share
        return jnp.exp(inner) if self._by_ratio else inner

    def free(self, value: Values) -> Values:
        """The inverse."""
        first = _like(self._logit(self.start), value)
        return (self._logit(value) - first) / _like(self._steep(), value)


def transform(
    start: Any, lower: float, upper: float, soft: bool = False
) -> AbstractTransform:
    """The bijection for a start between two bounds, which may be infinite.

    Args:
        start: one number or an array, strictly between the bounds.
        lower: bound, or -inf.
        upper: bound, or inf.
        soft: whether a single lower bound is by softplus, not by exp.
    """
    below, above = math.isfinite(lower), math.isfinite(upper)
    start = np.asarray(start, float)
    if below and above:
        return Between(start, lower, upper)
    if below:
        return SoftAbove(start, lower) if soft else Above(start, lower)
    if above:
        return Below(start, upper)
    size = np.abs(start)
    return Shifted(start, np.where(size > 0, size, 1.0))
