"""Changes between plain values, and the noise below which there is none."""

import math
import statistics
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Any, NamedTuple, TypeGuard


class Absent(Enum):
    """Mark of a key that one of two results does not have; None is a value."""

    ABSENT = "absent"


ABSENT = Absent.ABSENT
Number = int | float
ROUNDING = 1e-4
"""Relative difference that float32 leaves between two machines [-]: a thousand
roundings of 1e-7."""
# Other load on a machine changes a time that was measured once by as much.
_MAX_SINGLE_RATIO = 1.5
_MIN_RATIO = 1.02
"""Ratio of medians below which a time has not changed, however small its spread is."""
_NAMES = ("id", "name", "label", "title")
_MEDIAN_AND_RANGE = (
    ("median", "fastest", "slowest"),
    ("median", "least", "most"),
    ("median", "low", "high"),
    ("median", "min", "max"),
)


class Change(NamedTuple):
    """One value that is another one in the second of two results."""

    key: str
    old: Any
    new: Any
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain values; a value that is absent has no key."""
        return {k: v for k, v in self._asdict().items() if v not in (ABSENT, "")}


def flatten(value: Any, prefix: str = "", named: bool = False) -> dict[str, Any]:
    """Leaves of nested values by their dotted keys.

    A list of numbers, such as a direction, is one leaf.

    Args:
        value: plain values.
        prefix: of all keys.
        named: use the names of the items of a list, where all differ, as their keys,
            and keep a median and its range together.
    """
    join = lambda key: f"{prefix}.{key}" if prefix else str(key)
    if isinstance(value, dict) and value and not (named and is_spread(value)):
        pairs = value.items()
    elif isinstance(value, list) and not _is_numbers(value):
        pairs = zip(_keys(value, named), value, strict=True)
    else:
        return {prefix: value}
    found: dict[str, Any] = {}
    for key, item in pairs:
        found |= flatten(item, join(key), named)
    return found


def _keys(items: list[Any], named: bool) -> Sequence[str]:
    positions = [str(n) for n in range(len(items))]
    if not named or not all(isinstance(item, dict) for item in items):
        return positions
    for name in _NAMES:
        keys = [str(item.get(name, "")) for item in items]
        if all(keys) and len(set(keys)) == len(keys):
            return keys
    return positions


def _is_numbers(value: list[Any]) -> bool:
    return all(is_number(item) for item in value)


def is_number(value: Any) -> TypeGuard[Number]:
    """True for a finite number, which a truth value is not."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value)


def is_spread(value: Any) -> bool:
    """True for a median with its range."""
    return isinstance(value, dict) and any(
        set(names) <= set(value) for names in _MEDIAN_AND_RANGE
    )


def differences(old: Any, new: Any) -> Iterator[Change]:
    """Leaves that differ at all, by their dotted keys as in `--set`."""
    a, b = flatten(old), flatten(new)
    for key in {**a, **b}:
        left, right = a.get(key, ABSENT), b.get(key, ABSENT)
        # A number may be written as 1 and as 1.0.
        if left != right or isinstance(left, bool) != isinstance(right, bool):
            yield Change(key, left, right)


def differ(
    old: Number, new: Number, relative: float = ROUNDING, absolute: Number = 0.0
) -> bool:
    """True if two numbers differ by more than their noise."""
    return abs(new - old) > max(relative * max(abs(old), abs(new)), absolute)


def time_change(
    key: str, old: Sequence[Number], new: Sequence[Number]
) -> Change | None:
    """Change of a time [s] or a ratio that was measured several times, if it is one.

    The ranges of both must not overlap; a time measured once must change by half.
    """
    if not old or not new:
        return None
    a, b = statistics.median(old), statistics.median(new)
    if a <= 0 or b <= 0:
        return None
    ratio = b / a
    if min(len(old), len(new)) == 1:
        beyond = max(ratio, 1 / ratio) > _MAX_SINGLE_RATIO
        note = f"{ratio:.3g} times; measured once"
    else:
        apart = min(new) > max(old) or min(old) > max(new)
        beyond = apart and max(ratio, 1 / ratio) > _MIN_RATIO
        note = (
            f"{ratio:.3g} times; ranges {min(old):.3g}-{max(old):.3g} and "
            f"{min(new):.3g}-{max(new):.3g}"
        )
    return Change(key=key, old=a, new=b, note=note) if beyond else None


def plain_changes(old: Any, new: Any) -> Iterator[Change]:
    """Leaves of two experiments' values that differ beyond noise.

    Numbers to rounding, times by their spread, everything else exactly.
    """
    a, b = flatten(old, named=True), flatten(new, named=True)
    for key in {**a, **b}:
        left, right = a.get(key, ABSENT), b.get(key, ABSENT)
        if change := _leaf_change(key, left, right):
            yield change


def _leaf_change(key: str, old: Any, new: Any) -> Change | None:
    if old == new:
        return None
    if ABSENT in (old, new):
        return Change(key, old, new)
    if is_spread(old) and is_spread(new):
        return time_change(key, _samples(old), _samples(new))
    if _is_time(key) and is_number(old) and is_number(new):
        return time_change(key, [old], [new])
    if isinstance(old, list) and isinstance(new, list):
        if _is_time(key) and _is_numbers(old) and _is_numbers(new):
            return time_change(key, old, new)
        if len(old) != len(new):
            return Change(key, f"{len(old)} values", f"{len(new)} values")
        return _list_change(key, old, new)
    if is_number(old) and is_number(new):
        return Change(key, old, new) if differ(old, new) else None
    return Change(key, old, new)


def _samples(spread: dict[str, Number]) -> list[Number]:
    names = next(names for names in _MEDIAN_AND_RANGE if set(names) <= set(spread))
    return [spread[name] for name in names]


def _list_change(key: str, old: list[Number], new: list[Number]) -> Change | None:
    # The value that changed most stands for all.
    noise = ROUNDING * max(map(abs, [*old, *new]))
    sizes = [abs(b - a) for a, b in zip(old, new, strict=True)]
    n = sizes.index(max(sizes))
    found = Change(
        key=f"{key}.{n}",
        old=old[n],
        new=new[n],
        note=f"the largest of {len(old)} values",
    )
    return found if sizes[n] > noise else None


# A name that ends in the unit of a time, or says that it is measured by one.
_TIME_ENDINGS = ("_s", "_ms", "_us", "_ns")
_TIME_WORDS = ("took", "seconds", "faster", "slower", "step_ms", "per_s", "ratio")


def _is_time(key: str) -> bool:
    # Steps and saved times of a run are inputs.
    parts = key.split(".")
    if any(part in ("dt_s", "save_at", "end_s", "saved_s") for part in parts):
        return False
    return any(
        part.endswith(_TIME_ENDINGS) or any(word in part for word in _TIME_WORDS)
        for part in parts
    )
