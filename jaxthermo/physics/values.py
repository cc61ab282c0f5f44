"""Values that may change with time: a number, a `Table`, `Until`, or any callable."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..tracing import is_traced


def _as_array(numbers: Any) -> Any:
    """A list of numbers as one array, so that jit sees its values and not a list."""
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(numbers)):
        return jnp.asarray(numbers)
    return np.asarray(numbers, float)


class Table(eqx.Module):
    """Piecewise linear in time, constant before the first and after the last time."""

    times: Any = eqx.field(converter=_as_array)
    """[s], increasing."""
    values: Any = eqx.field(converter=_as_array)

    def __check_init__(self):
        if np.shape(self.times) != np.shape(self.values) or np.ndim(self.times) != 1:
            raise InputError(
                f"Table: {np.shape(self.times)} times and {np.shape(self.values)} "
                "values; give two lists of the same length"
            )
        if (
            not is_traced(self.times)
            and (np.diff(np.asarray(self.times, float)) <= 0).any()
        ):
            raise InputError("Table: the times must increase")

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """The value at `time` [s]."""
        times = jnp.asarray(self.times, time.dtype)
        return jnp.interp(time, times, jnp.asarray(self.values, time.dtype))

    @property
    def knots(self) -> tuple[float, ...]:
        """Times that the solver lands on exactly [s]."""
        return tuple(float(t) for t in np.asarray(self.times))


class Until(eqx.Module):
    """A value up to, but not including, `end` [s]; zero from then on."""

    value: Any
    end: float = eqx.field(static=True)

    def __call__(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """The value at `time` [s]."""
        return jnp.where(time < self.end, value_at(self.value, time), 0)

    @property
    def knots(self) -> tuple[float, ...]:
        """Times that the solver lands on exactly [s]."""
        return (self.end, *getattr(self.value, "knots", ()))


def value_at(value: Any, time: Float[Array, ""]) -> Float[Array, "..."]:
    """A number, one a fragment, or a function of time, at `time` [s]."""
    found = value(time) if callable(value) else value
    return jnp.asarray(found, time.dtype)


def for_jit(value: Any, dtype: Any) -> Any:
    """The same value with its numbers as arrays: new numbers need no new program."""
    if not callable(value):
        return jnp.asarray(value, dtype)
    numbers = float | np.ndarray | np.floating
    as_array = lambda x: jnp.asarray(x, dtype) if isinstance(x, numbers) else x
    return jax.tree.map(as_array, value)


def is_zero(value: Any) -> bool:
    """Whether this is known to be 0 at all times: such a term can be left out."""
    if callable(value) or is_traced(value):
        return False
    return bool(np.all(np.asarray(value) == 0))


def check_at_least_zero(value: Any, what: str) -> None:
    """Refuse a plain number or table below zero or not finite; functions are trusted.

    Raises:
        InputError: naming `what`.
    """
    if isinstance(value, Until):
        return check_at_least_zero(value.value, what)
    stated = value.values if isinstance(value, Table) else value
    if callable(stated) or is_traced(stated):
        return None
    numbers = np.asarray(stated, float)
    if not np.isfinite(numbers).all() or (numbers < 0).any():
        raise InputError(f"{what}={stated!r}: give finite numbers of at least 0")
    return None


def largest(value: Any, end: float) -> Float[Array, ""]:
    """The largest value taken over [0, end] [s]; functions are sampled 1025 times."""
    if isinstance(value, Table):
        return jnp.max(jnp.asarray(value.values, float))
    if isinstance(value, Until):
        return jnp.maximum(largest(value.value, end), 0.0)
    if callable(value):
        return jnp.max(
            jax.vmap(lambda t: value_at(value, t))(jnp.linspace(0.0, end, 1025))
        )
    return jnp.asarray(value, float)
