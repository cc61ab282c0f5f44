"""Changes between plain values, and the noise below which there is none."""

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple, TypeGuard

from jaxthermo.timing import Spread


class _Absent(Enum):
    """Mark of a key that is missing in one of two results; None is a value."""

    ABSENT = "absent"

    def __bool__(self) -> bool:
        """False, like an empty value."""
        return False


ABSENT = _Absent.ABSENT
Number = int | float
ROUNDING = 1e-4
"""Relative difference that float32 leaves between two machines [-]: a thousand
roundings of 1e-7."""
_MAX_SINGLE_RATIO = 1.5
"""Ratio of two times measured once that the load of a machine explains [-]."""
_MIN_RATIO = 1.02
"""Ratio of medians below which a time has not changed, however small its spread is."""
_NAMES = ("id", "name", "label", "title")
# Names of a median and its range in the files of all versions.
_MEDIAN_AND_RANGE = (
    ("median", "fastest", "slowest"),
    ("median", "least", "most"),
    ("median", "low", "high"),
    ("median", "min", "max"),
)


class Change(NamedTuple):
    """A value that differs between two results."""

    key: str
    old: Any
    new: Any
    note: str = ""

    def as_dict(self) -> dict[str, object]:
        """Plain values; a value that is absent has no key."""
        fields = self._asdict().items()
        return {key: value for key, value in fields if value not in (ABSENT, "")}


class _Pair(NamedTuple):
    """Values of one key in two results."""

    key: str
    old: Any
    new: Any


def pairs(
    old: Mapping[str, Any], new: Mapping[str, Any], keys: Sequence[str] | None = None
) -> Iterator[_Pair]:
    """Values by the keys of both, or by some keys; ABSENT for a missing one."""
    for key in {**old, **new} if keys is None else keys:
        yield _Pair(key, old=old.get(key, ABSENT), new=new.get(key, ABSENT))


def presence(value: object, words: str) -> object:
    """Words for a value that a result has; ABSENT for one that it has not."""
    return ABSENT if value is ABSENT else words


def flatten(value: Any, prefix: str = "", named: bool = False) -> dict[str, object]:
    """Leaves of nested values by their dotted keys.

    A list of numbers, such as a direction, is one leaf.

    Args:
        value: plain values.
        prefix: of all keys.
        named: use the names of the items of a list, where all differ, as their keys,
            and leave a median with its range as one leaf.
    """
    if isinstance(value, dict) and value and not (named and _is_spread(value)):
        pairs = value.items()
    elif isinstance(value, list) and not _is_numbers(value):
        pairs = zip(_keys(value, named), value, strict=True)
    else:
        return {prefix: value}
    leaves: dict[str, object] = {}
    for key, item in pairs:
        leaves |= flatten(
            item, prefix=f"{prefix}.{key}" if prefix else str(key), named=named
        )
    return leaves


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


def _is_spread(value: Any) -> bool:
    """True for a median with its range."""
    return isinstance(value, dict) and any(
        set(names) <= set(value) for names in _MEDIAN_AND_RANGE
    )


def differences(old: Any, new: Any) -> Iterator[Change]:
    """Leaves that differ at all, by their dotted keys as in `--set`."""
    for key, left, right in pairs(flatten(old), flatten(new)):
        # A number may be written as 1 and as 1.0.
        if left != right or isinstance(left, bool) != isinstance(right, bool):
            yield Change(key, old=left, new=right)


def differ(
    old: Number, new: Number, relative: float = ROUNDING, absolute: Number = 0.0
) -> bool:
    """True if two numbers differ by more than their noise."""
    return abs(new - old) > max(relative * max(abs(old), abs(new)), absolute)


def number_changes(
    key: str,
    old: Any,
    new: Any,
    relative: float = ROUNDING,
    absolute: Number = 0.0,
    unit: str = "",
) -> Iterator[Change]:
    """Change of a number beyond its noise, or of what is no number, if any."""
    if not is_number(old) or not is_number(new):
        if old != new:
            yield Change(key, old=old, new=new)
    elif differ(old, new, relative=relative, absolute=absolute):
        yield Change(key=key, old=old, new=new, note=f"{new - old:+.3g}{unit}")


def time_changes(
    key: str, old: Sequence[Number], new: Sequence[Number]
) -> Iterator[Change]:
    """Change of a time [s] or a ratio that was measured several times, if any.

    The ranges of both must not overlap; a time measured once must change by half.
    """
    if not old or not new:
        return
    old_spread = Spread.of(old)
    new_spread = Spread.of(new)
    if old_spread.median <= 0 or new_spread.median <= 0:
        return
    ratio = new_spread.median / old_spread.median
    if min(len(old), len(new)) == 1:
        beyond = max(ratio, 1 / ratio) > _MAX_SINGLE_RATIO
        note = f"{ratio:.3g} times; measured once"
    else:
        are_apart = new_spread.low > old_spread.high or old_spread.low > new_spread.high
        beyond = are_apart and max(ratio, 1 / ratio) > _MIN_RATIO
        note = (
            f"{ratio:.3g} times; ranges {old_spread.low:.3g}-{old_spread.high:.3g} and "
            f"{new_spread.low:.3g}-{new_spread.high:.3g}"
        )
    if beyond:
        yield Change(key=key, old=old_spread.median, new=new_spread.median, note=note)


def plain_changes(old: Any, new: Any) -> Iterator[Change]:
    """Leaves of two experiments' values that differ beyond noise.

    Numbers to rounding, times by their spread, everything else exactly.
    """
    old_leaves = flatten(old, named=True)
    new_leaves = flatten(new, named=True)
    for key, left, right in pairs(old_leaves, new_leaves):
        if left != right:
            yield from _leaf_changes(key, old=left, new=right)


def _leaf_changes(key: str, old: Any, new: Any) -> Iterator[Change]:
    old_samples = _samples(key, old)
    new_samples = _samples(key, new)
    if old_samples and new_samples:
        yield from time_changes(key, old=old_samples, new=new_samples)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield Change(key, old=f"{len(old)} values", new=f"{len(new)} values")
        else:
            yield from _list_changes(key, old=old, new=new)
    elif not is_number(old) or not is_number(new) or differ(old, new):
        yield Change(key, old=old, new=new)


def _samples(key: str, value: Any) -> list[Number]:
    """Values of a measured time, by its range, alone or repeated; none for others."""
    if _is_spread(value):
        names = next(names for names in _MEDIAN_AND_RANGE if set(names) <= set(value))
        return [value[name] for name in names]
    values = value if isinstance(value, list) else [value]
    return values if _is_time(key) and _is_numbers(values) else []


def _list_changes(key: str, old: list[Number], new: list[Number]) -> Iterator[Change]:
    # The value that changed most stands for all.
    noise = ROUNDING * max(map(abs, [*old, *new]))
    sizes = [abs(b - a) for a, b in zip(old, new, strict=True)]
    n = sizes.index(max(sizes))
    if sizes[n] > noise:
        yield Change(
            key=f"{key}.{n}",
            old=old[n],
            new=new[n],
            note=f"the largest of {len(old)} values",
        )


# A name that ends in the unit of a time, or says that it is measured by one.
_TIME_ENDINGS = ("_s", "_ms", "_us", "_ns")
_TIME_WORDS = ("took", "seconds", "faster", "slower", "step_ms", "per_s", "ratio")


def _is_time(key: str) -> bool:
    words = key.split(".")
    # Steps and saved times of a run are inputs.
    if any(word in ("dt_s", "save_at", "end_s", "saved_s") for word in words):
        return False
    return any(
        word.endswith(_TIME_ENDINGS) or any(mark in word for mark in _TIME_WORDS)
        for word in words
    )
