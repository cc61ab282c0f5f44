"""Values that may change with time: a number, a `Table`, `Until`, or any callable."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import override

from ..arrays import (
    HOST,
    HostTime,
    Samples,
    Scalar,
    SplitTimes,
    Time,
    TimeVarying,
    is_traced,
    namespace,
    split_times,
    typed_array,
)
from ..errors import InputError, shortened
from ..temperatures import ALLOW_EXTREME, CheckedValues, Limits, extreme_refusal
from .windows import (
    AbstractVarying,
    FunctionOfTime,
    PiecewiseLinear,
    Window,
    switched,
)


# Points at which functions are sampled for their bounds.
_FUNCTION_SAMPLES = 1025

# Roundings between the time of an event and the time just before it.
_EVENT_ROUNDINGS = 8


def _as_array(numbers: Any) -> Any:
    # One array, so that jit sees values and not a list.
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(numbers)):
        return jnp.asarray(numbers)
    return np.asarray(numbers, float)


class Table(AbstractVarying):
    """Piecewise linear in time, constant before the first and after the last time."""

    times: Samples = eqx.field(converter=_as_array)
    """[s], increasing."""
    values: Samples = eqx.field(converter=_as_array)

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

    @override
    def __call__(self, time: Time) -> Float[Array, ""]:
        """The value at `time` [s]."""
        if len(self.times) == 1:
            return jnp.asarray(self.values[0], time.dtype)
        return self.piecewise(ends_steps=False)(time)

    @override
    def over(self, window: Window) -> Any:
        if len(self.times) == 1:
            return self.values[0]
        return self.piecewise(ends_steps=False).over(window)

    def piecewise(self, ends_steps: bool) -> PiecewiseLinear:
        """The table of two times or more in the form that windows use.

        `ends_steps` is True if steps end at all of its times.
        """
        return PiecewiseLinear(
            times=split_times(self.times),
            first=self.values[:-1],
            last=self.values[1:],
            ends_steps=ends_steps,
        )


class Until(AbstractVarying):
    """A value up to, but not including, `end` [s]; zero from then on."""

    value: TimeVarying
    end: float = eqx.field(static=True)

    @override
    def __call__(self, time: Time) -> Float[Array, ""]:
        """The value at `time` [s]."""
        return jnp.where(time < self.end, value_at(self.value, time), 0)

    @override
    def over(self, window: Window) -> Any:
        # Steps end at the end: in the window of an interval it is on or off.
        value = self.value
        if isinstance(value, AbstractVarying):
            value = value.over(window)
        elif callable(value):
            value = FunctionOfTime(value).over(window)
        return switched(value, window.ends_before(split_times(self.end)))


def value_at(value: Any, time: Time | HostTime) -> Float[Array, "..."]:
    """A number or array, or a function of time, at `time` [s].

    A time of the host is not rounded to float32 in tables and switches.
    """
    if isinstance(time, HOST):
        dtype = jnp.result_type(float)
        if isinstance(value, AbstractVarying):
            return _value_of_window(value, jnp.asarray(split_times(time), dtype))
        time = jnp.asarray(time, dtype)
    return jnp.asarray(value(time) if callable(value) else value, time.dtype)


# One program, where single operations would compile one after the other.
@eqx.filter_jit
def _value_of_window(value: AbstractVarying, start: SplitTimes) -> Float[Array, "..."]:
    """The value at the start of a window [s]."""
    zero = jnp.zeros((), start.dtype)
    return value_at(value.over(Window(start, zero)), zero)


def for_jit(value: Any, dtype: Any) -> Any:
    """The value with its numbers as arrays, so that new numbers need no new program."""
    if not callable(value):
        return typed_array(value, dtype)

    def typed(leaf: Any) -> Any:
        is_number = isinstance(leaf, float | np.ndarray | np.floating)
        return typed_array(leaf, dtype) if is_number else leaf

    return jax.tree.map(typed, value)


def _stated_numbers(value: Any) -> Any:
    """Numbers of a value, as its author wrote them; a plain function has none."""
    value = value.value if isinstance(value, Until) else value
    return value.values if isinstance(value, Table | PiecewiseLinear) else value


def is_zero(value: Any) -> bool:
    """True if the value is known to be 0 at all times."""
    stated = _stated_numbers(value)
    # A fit may move a traced value away from 0.
    if callable(stated) or is_traced(stated):
        return False
    return bool(np.all(np.asarray(stated) == 0))


SAMPLES = 256
"""Minimum number of steps of a run in which a value changes at unknown times."""


def is_unknown_function(value: Any) -> bool:
    """True if the value is a function that may do anything between steps."""
    if isinstance(value, Until):
        return is_unknown_function(value.value)
    return callable(value) and not isinstance(value, Table | PiecewiseLinear)


def changes_unseen(value: Any) -> bool:
    """True if a value may change within steps, which do not end where it does."""
    if isinstance(value, Until):
        return changes_unseen(value.value)
    if isinstance(value, PiecewiseLinear):
        return not value.ends_steps
    return is_unknown_function(value)


def breakpoints(value: Any) -> tuple[float, ...]:
    """Times at which a value has a kink or jump, where steps end exactly [s]."""
    if isinstance(value, Until):
        return (value.end, *breakpoints(value.value))
    if isinstance(value, PiecewiseLinear) and value.ends_steps:
        return tuple(np.asarray(value.times, float).sum(axis=0).tolist())
    # A traced table has no numbers yet.
    if isinstance(value, Table) and not is_traced(value.times):
        return tuple(float(t) for t in np.asarray(value.times))
    return ()


def check_value(value: Any, argument: str, minimum: float = -np.inf) -> None:
    """Refuse a number or table that is not finite or below `minimum`.

    Functions and traced values are not checked.

    Raises:
        InputError: naming the argument.
    """
    stated = _stated_numbers(value)
    if callable(stated) or is_traced(stated):
        return
    try:
        # A text of digits would be taken for its number here, and fail later.
        numbers = np.asarray(None if isinstance(stated, str) else stated, float)
    except (TypeError, ValueError):
        numbers = np.full((), np.nan)
    if not numbers.ndim and np.isnan(numbers):
        raise InputError(f"{argument}: got {shortened(stated)}: give a finite number")
    if not np.isfinite(numbers).all() or (numbers < minimum).any():
        need = "finite" if minimum == -np.inf else f"at least {minimum:g}"
        raise InputError(f"{argument}: got {numbers.tolist()}, which must be {need}")


def check_one_of(owner: str, values: dict[str, Any], minimum: float = -np.inf) -> None:
    """Refuse anything but one value that is not None, and check that one.

    Args:
        owner: name of the class that has the values.
        values: each by its name and unit, such as "heat_rate [W]".
        minimum: least value.

    Raises:
        InputError: if there is not exactly one, or it is no value.
    """
    stated = {label: value for label, value in values.items() if value is not None}
    if len(stated) != 1:
        names = " or ".join(f"`{label.partition(' ')[0]}`" for label in values)
        raise InputError(f"{owner}: give either {names}")
    for label, value in stated.items():
        check_value(value, f"{owner}({label})", minimum)


def check_temperature(
    value: Any,
    argument: str,
    end: float | int | None = None,
    option: str = f"Scene(..., {ALLOW_EXTREME}=True)",
) -> None:
    """Refuse temperatures outside of the limits [K].

    Traced values are not checked, and functions only up to `end` [s], unless it is
    None. The message names the `option` that lifts the limits.

    Raises:
        InputError: naming the argument.
    """
    stated = _stated_numbers(value)
    if callable(stated):
        if end is None:
            return
        stated = jnp.stack([smallest(stated, end), largest(stated, end)])
    if is_traced(stated):
        return
    kelvin = np.asarray(stated, float)
    outside = Limits().exceeded(kelvin)
    if not outside.any():
        return
    first = float(kelvin[outside][0])
    pixels = ""
    if kelvin.ndim > 1:
        pixels = (
            f", one of {outside.sum()} of {kelvin.size} that leave the limits: "
            f"{CheckedValues(kelvin).listed(outside)}"
        )
    raise extreme_refusal(argument, first, option=option, pixels=pixels)


def just_before(time: Any, dtype: Any = None) -> Any:
    """Return a time [s] just before an event, at which loads are not yet changed by it.

    Args:
        time: time of the event [s], an array or a number of the host.
        dtype: type of the run, in which the two times must differ; None for that of
            the array.
    """
    dtype = time.dtype if dtype is None else dtype
    # By less, the difference would vanish late in a run, in which times of the host are
    # two numbers of float32.
    rounding = max(float(jnp.finfo(dtype).eps), 2.0**-48)
    return time - _EVENT_ROUNDINGS * rounding * abs(time)


def largest(value: Any, end: float | int) -> Any:
    """The largest value in [0, end] [s]; functions are sampled 1025 times."""
    if isinstance(value, Until):
        # The value is 0 after the end.
        highest = largest(value.value, end)
        return namespace(highest).maximum(highest, 0.0)
    values = _sampled(value, end)
    # Constant values of several cells stay apart.
    return values.max() if callable(value) else values


def smallest(value: Any, end: float | int) -> Any:
    """The smallest value in [0, end] [s]; functions are sampled as by `largest`."""
    if isinstance(value, Until):
        lowest = smallest(value.value, end)
        return namespace(lowest).minimum(lowest, 0.0)
    return _sampled(value, end).min()


def largest_size(value: Any, end: float | int) -> Any:
    """The largest |value| in [0, end] [s]."""
    highest = largest(value, end)
    lowest = smallest(value, end)
    xp = namespace((highest, lowest))
    return xp.maximum(abs(highest), abs(lowest)).max()


class Dose(NamedTuple):
    """Bounds of the positive part of a value that varies with time."""

    largest: Any
    """Its largest value, 0 or more."""
    integral: Any
    """At least its integral over time, in units of the value times seconds."""


def dose(value: Any, end: float | int, sign: Scalar = 1.0) -> Dose:
    """Bounds of the positive part of `sign` times a value in [0, end] [s].

    The integral counts each interval between points of a table, or 1024 samples of a
    function, with the larger of its ends: no sum over steps that end at the points
    exceeds it.
    """
    if isinstance(value, Until):
        return dose(value.value, min(float(value.end), end), sign)
    if not callable(value):
        xp = namespace((value, sign))
        size = xp.maximum(sign * xp.asarray(value, float), 0.0)
        return Dose(size, size * end)
    if isinstance(value, Table):
        if len(value.times) == 1:
            return dose(value.values[0], end, sign)
        value = value.piecewise(ends_steps=False)
    if isinstance(value, PiecewiseLinear):
        ends = (value.first, value.last)
        times = value.times[0] + value.times[1]
    else:
        times = jnp.linspace(0.0, end, _FUNCTION_SAMPLES)
        samples = _sampled(value, end)
        ends = (samples[:-1], samples[1:])
    xp = namespace((times, ends, sign))
    times = xp.clip(xp.asarray(times, float), 0.0, end)
    sizes = xp.maximum(sign * xp.asarray(ends, float), 0.0)
    # The largest of the values of several cells.
    sizes = sizes.reshape(2, len(times) - 1, -1).max(axis=2)
    between = (sizes.max(axis=0) * xp.diff(times)).sum()
    outside = sizes[0, 0] * times[0] + sizes[1, -1] * (end - times[-1])
    return Dose(sizes.max(), between + outside)


def _sampled(value: Any, end: float | int) -> Float[Any, "..."]:
    if is_unknown_function(value):
        # The sampling includes both ends; a narrow peak may be missed.
        times = jnp.linspace(0.0, end, _FUNCTION_SAMPLES)
        return jax.vmap(lambda t: value_at(value, t))(times)
    # On the host where nothing is traced: single operations on a device are slow.
    numbers = _stated_numbers(value)
    return namespace(numbers).asarray(numbers, float)
