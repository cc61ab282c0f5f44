"""Values that vary with time, as steps use them: within a window of time.

Late in a run float32 does not tell close times apart: 100 s and 100 s + 1 us are one
number. So an interval of equal steps is a window, in which time counts from its start.
The times of the start and of all tables are two numbers each, t = rounded + remainder,
whose differences keep 48 bits:

    t - t_0 = (rounded - rounded_0) + (remainder - remainder_0).

Steps end at the breakpoints of known values. Within a window such a value is one line,
which is looked up once for all steps of the window. What has no known breakpoints, such
as a table of traced times, becomes the line of the same integral and the same first
moment in each step, so that its energy does not depend on the steps.
"""

import abc
import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import override

from ..arrays import SplitTimes, Time


_Tree = TypeVar("_Tree")

# Points of a step, for functions that can be evaluated within the run alone: those of
# Gauss, and its ends, which have no weight: they only show the range of the values.
_POINTS = np.array([-1.0, *np.polynomial.legendre.leggauss(4)[0], 1.0])
_WEIGHTS = np.array([0.0, *np.polynomial.legendre.leggauss(4)[1], 0.0])


class Window(NamedTuple):
    """An interval of equal steps, from whose start time counts."""

    start: SplitTimes
    """Start of the window, two numbers [s]."""
    length: Time
    """[s]"""

    def ends_before(self, time: SplitTimes) -> Bool[Array, ""]:
        """True if its middle, and so all of it, is before a time that ends steps."""
        return _since(self.start, jnp.asarray(time, self.length.dtype)) > (
            self.length / 2
        )


def _since(start: SplitTimes, times: SplitTimes) -> Float[Array, "..."]:
    """Times after a start [s]."""
    return (times[0] - start[0]) + (times[1] - start[1])


class _Line(Module):
    """A value that is linear in the time since the start of a window."""

    origin: Any
    """Time at which it has its value [s]."""
    value: Any
    slope: Any
    """[1/s]"""

    def __call__(self, time: Time) -> Float[Array, "..."]:
        """The value at `time` [s]."""
        return self.value + self.slope * (time - self.origin)


class AbstractVarying(Module):
    """A value that is a function of time, in a form that windows can use."""

    @abc.abstractmethod
    def __call__(self, time: Time) -> Float[Array, "..."]:
        """The value at `time` [s]."""

    @abc.abstractmethod
    def over(self, window: Window) -> Any:
        """The value in a window, as a function of the time since its start."""

    def within(self, start: SplitTimes, dt: Time) -> Any:
        """The value in a step from `start` [s] on: itself, or a line."""
        return self


class PiecewiseLinear(AbstractVarying):
    """Linear between knots, where it may jump; constant before and after them."""

    times: SplitTimes
    """Times of the knots, increasing [s]."""
    first: Float[Any, "m ..."]
    """Value after the knot at which each piece starts."""
    last: Float[Any, "m ..."]
    """Value before the knot at which each piece ends."""
    ends_steps: bool = eqx.field(static=True, default=True)
    """True if steps end at all knots."""

    @property
    def values(self) -> Any:
        """All values at knots."""
        on_device = isinstance(self.first, jax.Array) or isinstance(
            self.last, jax.Array
        )
        xp = jnp if on_device else np
        return xp.stack([self.first, self.last])

    @override
    def __call__(self, time: Time) -> Float[Array, "..."]:
        start = jnp.stack([time, jnp.zeros_like(time)])
        return self._line(Window(start, jnp.zeros_like(time)))(jnp.zeros_like(time))

    @override
    def over(self, window: Window) -> Any:
        if self.ends_steps:
            return self._line(window)
        times = jnp.asarray(self.times, window.length.dtype)
        shifted = times - window.start[:, None]
        # What the first difference is rounded by, for knots after the start.
        rounding = (times[0] - shifted[0]) - window.start[0]
        shifted = shifted.at[1].add(rounding)
        return PiecewiseLinear(shifted, self.first, self.last, ends_steps=False)

    def _line(self, window: Window) -> _Line:
        """The line in the middle of a window."""
        dtype = window.length.dtype
        times = jnp.asarray(self.times, dtype)
        first = jnp.asarray(self.first, dtype)
        last = jnp.asarray(self.last, dtype)
        pieces = first.shape[0]
        begun = _count_until(times, window.start, window.length / 2)
        piece = jnp.clip(begun - 1, 0, pieces - 1)
        begin = times[:, piece]
        width = _since(begin, times[:, piece + 1])
        is_inside = (begun > 0) & (begun <= pieces)
        value = jnp.where(begun > pieces, last[piece], first[piece])
        # Knots that only float64 tells apart enclose no time.
        slope = (last[piece] - first[piece]) / jnp.where(width > 0, width, 1)
        return _Line(
            origin=_since(window.start, begin),
            value=value,
            slope=jnp.where(is_inside & (width > 0), slope, 0),
        )

    @override
    def within(self, start: SplitTimes, dt: Time) -> Any:
        if self.ends_steps:
            return self
        dtype = dt.dtype
        times = jnp.asarray(self.times, dtype)
        first = jnp.asarray(self.first, dtype)
        last = jnp.asarray(self.last, dtype)
        knots = _since(start, times)
        past_end = (times[0] - start[0] - dt) + (times[1] - start[1])
        # Not differences of `knots`, which are rounded: pieces may be much shorter.
        width = _since(times[:, :-1], times[:, 1:])
        before = jnp.clip(-knots[:-1], 0, width)
        after = jnp.clip(past_end[1:], 0, width)
        slope = (last - first) / _column(jnp.where(width > 0, width, 1), first)
        # Also the constant pieces before and after all knots.
        at_begin = first + slope * _column(before, first)
        at_end = last - slope * _column(after, first)
        low = jnp.concatenate([first[:1], at_begin, last[-1:]])
        high = jnp.concatenate([first[:1], at_end, last[-1:]])
        lengths = [knots[:1], width - before - after, -past_end[-1:]]
        duration = _column(jnp.clip(jnp.concatenate(lengths), 0, dt), first)
        edges = jnp.clip(knots, 0, dt)
        begin = jnp.concatenate([jnp.zeros(1, dtype), edges])
        end = jnp.concatenate([edges, dt[None]])
        mean = (duration * (low + high)).sum(axis=0) / (2 * dt)
        centre = _column((begin + end) / 2 - dt / 2, first)
        moment = duration * (centre * (low + high) / 2 + duration * (high - low) / 12)
        is_reached = duration > 0
        return _projection(
            start.sum(),
            dt=dt,
            mean=mean,
            moment=moment.sum(axis=0),
            lowest=jnp.where(is_reached, jnp.minimum(low, high), jnp.inf).min(axis=0),
            highest=jnp.where(is_reached, jnp.maximum(low, high), -jnp.inf).max(axis=0),
        )


def _column(values: Float[Array, " n"], like: Float[Array, "..."]) -> Array:
    """Values of pieces, shaped to be multiplied by all numbers of each."""
    return values.reshape(values.shape + (1,) * (like.ndim - 1))


def _count_until(times: SplitTimes, start: SplitTimes, after: Time) -> Int[Array, ""]:
    """Number of increasing times that are at most `after` [s] after a start."""
    # Without a loop: on a GPU XLA fails where the loop of the steps holds one of fixed
    # length whose result is an index. https://github.com/openxla/xla/issues/49299
    # In two passes over about a root of all times, which compile faster than bisection.
    size = times.shape[1]
    block = math.isqrt(size - 1) + 1

    def count(knots: SplitTimes) -> Int[Array, ""]:
        return (_since(start, knots) <= after).sum(dtype=jnp.int32)

    begin = jnp.minimum(block * count(times[:, block - 1 :: block]), size - block)
    rest = jax.lax.dynamic_slice_in_dim(times, begin, block, axis=1)
    return begin + count(rest)


def _projection(
    start: Time, dt: Time, mean: Array, moment: Array, lowest: Array, highest: Array
) -> _Line:
    """The line of a mean and a first moment about the middle, between two bounds.

    A line that would leave the bounds within the step is less steep.
    """
    steepest = 2 * jnp.maximum(jnp.minimum(highest - mean, mean - lowest), 0) / dt
    slope = jnp.clip(12 * moment / dt**3, -steepest, steepest)
    return _Line(origin=start + dt / 2, value=mean, slope=slope)


class FunctionOfTime(AbstractVarying):
    """A function of time that is known only where a run evaluates it."""

    function: Callable[[Time], Any]
    start: SplitTimes | None = None
    """Start of the window from which its time counts [s]; None for that of the run."""

    @override
    def __call__(self, time: Time) -> Float[Array, "..."]:
        if self.start is not None:
            time = self.start[0] + (self.start[1] + time)
        return jnp.asarray(self.function(time), time.dtype)

    @override
    def over(self, window: Window) -> "FunctionOfTime":
        return FunctionOfTime(self.function, window.start)

    @override
    def within(self, start: SplitTimes, dt: Time) -> _Line:
        begin = start.sum()
        points = jnp.asarray(_POINTS, dt.dtype)
        samples = jax.vmap(self)(begin + dt * (points + 1) / 2)
        weights = _column(jnp.asarray(_WEIGHTS / 2, dt.dtype), samples)
        mean = (weights * samples).sum(axis=0)
        moment = (weights * _column(points / 2, samples) * samples).sum(axis=0)
        return _projection(
            begin,
            dt=dt,
            mean=mean,
            moment=moment * dt**2,
            lowest=samples.min(axis=0),
            highest=samples.max(axis=0),
        )


def switched(value: Any, is_on: Bool[Array, ""]) -> Any:
    """A value of a window, or 0 where it is off."""
    if isinstance(value, _Line):
        return _Line(
            origin=value.origin,
            value=jnp.where(is_on, value.value, 0),
            slope=jnp.where(is_on, value.slope, 0),
        )
    if isinstance(value, AbstractVarying):
        return _Switched(value, is_on)
    return jnp.where(is_on, value, 0)


class _Switched(AbstractVarying):
    """A value of a window in which it is on or off."""

    value: AbstractVarying
    is_on: Bool[Array, ""]

    @override
    def __call__(self, time: Time) -> Float[Array, "..."]:
        return jnp.where(self.is_on, self.value(time), 0)

    @override
    def over(self, window: Window) -> Any:
        return switched(self.value.over(window), self.is_on)

    @override
    def within(self, start: SplitTimes, dt: Time) -> Any:
        return switched(self.value.within(start, dt), self.is_on)


def _is_varying(node: Any) -> bool:
    return isinstance(node, AbstractVarying)


def _with_varying(tree: _Tree, change: Callable[[AbstractVarying], Any]) -> _Tree:
    if not any(map(_is_varying, jax.tree.leaves(tree, is_leaf=_is_varying))):
        return tree
    return jax.tree.map(
        lambda node: change(node) if _is_varying(node) else node,
        tree,
        is_leaf=_is_varying,
    )


def over(tree: _Tree, window: Window) -> _Tree:
    """A program in a window: its time then counts from the start of the window."""
    return _with_varying(tree, lambda value: value.over(window))


def start_of_step(number: Int[Array, ""], dt: Time) -> SplitTimes:
    """Start of one of the equal steps of a window, two numbers [s].

    They add up to `number` times `dt` to 36 bits for numbers below 4096, so that no
    time is between two steps, or in both.
    """
    # Half of the bits, whose product with such a number is exact.
    coarse = jax.lax.reduce_precision(dt, exponent_bits=8, mantissa_bits=11)
    return jnp.stack([coarse, dt - coarse]) * number.astype(dt.dtype)


def within(tree: _Tree, start: SplitTimes, dt: Time) -> _Tree:
    """A program of a window in one of its steps, from `start` [s] on.

    Values without known breakpoints are lines in it, of the same integral.
    """
    return _with_varying(tree, lambda value: value.within(start, dt))
