"""Measured quantity beside that of a named peer, in the form that all benchmarks share.

Values of the same index were measured in turn, so that a ratio is one of two values
that saw the same state of the machine.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from jaxthermo.report.numbers import with_range

from .timing import ratio_of


# Units of times, with the shortest median [s] that each is used for; then ns.
_SCALES = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6))
_FACTORS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def time_unit(seconds: float) -> tuple[str, float]:
    """The unit that fits a time [s], and how many of it a second has."""
    # A difference of times may be negative.
    units = (name for name, least in _SCALES if abs(seconds) >= least)
    unit = next(units, "ns")
    return unit, _FACTORS[unit]


Spread = tuple[float, float, float]
"""Median, lowest and highest value."""


@dataclass(frozen=True)
class Measurement:
    """A quantity of which less is better, each value of it, and what is asked of it."""

    name: str
    unit: str
    """Unit of the values; times in "s" are shown in the one that fits them."""
    ours: Sequence[float]
    """Every repeat."""
    peer_name: str = ""
    """Name of what it is compared with; empty if with nothing."""
    peer: Sequence[float] = ()
    """As many as of ours, or one for all of them."""
    bound: float | None = None
    """Smallest speed relative to the peer; else largest overhead, or largest value."""
    overhead: bool = False
    """The ratio is ours over the peer's, as of a cost; otherwise how many times as fast
    as the peer ours is."""
    note: str = ""

    @property
    def ratio(self) -> Spread | None:
        """Ratio to the peer; None without one."""
        if not len(self.peer):
            return None
        pair = (self.ours, self.peer) if self.overhead else (self.peer, self.ours)
        median, low, high = ratio_of(*pair)
        return median, low, high

    @property
    def met(self) -> bool | None:
        """True if the median keeps the bound; None if none is asked."""
        if self.bound is None:
            return None
        if self.ratio is None:
            return _spread(self.ours)[0] <= self.bound
        ratio = self.ratio[0]
        return ratio <= self.bound if self.overhead else ratio >= self.bound

    @property
    def asked(self) -> str:
        """The bound in words; empty if none is asked."""
        if self.bound is None:
            return ""
        is_speed = self.ratio is not None and not self.overhead
        return f"{'at least' if is_speed else 'at most'} {self.bound:g}"

    @property
    def ratio_text(self) -> str:
        """The ratio with its range and meaning; empty without a peer."""
        if self.ratio is None:
            return ""
        what = "x the time" if self.unit == "s" else "x as much"
        return f"{with_range(*self.ratio)} {what if self.overhead else 'x as fast'}"

    @property
    def shown(self) -> tuple[str, str, str]:
        """Unit, ours and the peer's with their ranges, for a table."""
        own, unit, factor = _spread(self.ours), self.unit, 1.0
        if unit == "s":
            unit, factor = time_unit(own[0])
        text = lambda values: with_range(*(factor * v for v in _spread(values)))
        return unit, text(self.ours), text(self.peer) if len(self.peer) else ""

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for `result.json`; `measurement_of` reads them."""
        plain = asdict(self)
        plain["ours"] = [float(value) for value in self.ours]
        plain["peer"] = [float(value) for value in self.peer]
        return plain

    def as_row(self) -> dict[str, Any]:
        """The same summed up, for a line of a CSV file."""
        names = ("median", "low", "high")
        parts = {"ours": _spread(self.ours), "peer": None, "ratio": self.ratio}
        if len(self.peer):
            parts["peer"] = _spread(self.peer)
        row: dict[str, Any] = {"name": self.name, "unit": self.unit}
        for part, values in parts.items():
            if part == "peer":
                row["peer"] = self.peer_name
            row |= {
                f"{part}_{name}": None if values is None else float(values[n])
                for n, name in enumerate(names)
            }
        direction = "ours / peer" if self.overhead else "peer / ours"
        return {
            **row,
            "ratio_of": direction if len(self.peer) else "",
            "asked": self.asked,
            "met": self.met,
            "note": self.note,
        }


def measurement_of(plain: dict[str, Any]) -> Measurement:
    """The measurement that `as_dict` wrote."""
    return Measurement(**plain)


def plain_rows(rows: Iterable[Measurement]) -> list[dict[str, Any]]:
    """Measurements for the result of a benchmark, under the key "measurements"."""
    return [row.as_dict() for row in rows]


def _spread(values: Sequence[float]) -> Spread:
    return float(np.median(values)), float(np.min(values)), float(np.max(values))
