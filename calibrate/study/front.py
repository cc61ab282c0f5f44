"""Choices by error and cost, and the front of those that no other choice beats.

A choice is judged by its worst load: the largest error and the largest median time.
"""

import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from jaxthermo.timing import Spread, ratio_of

from ..config.schema import Changes
from .rows import Row


Measure = Literal["rms_percent", "rms_kelvin", "p99_percent", "p99_kelvin"]

Cost = Literal["time_s", "memory_bytes", "nodes"]

MEASURES: tuple[Measure, ...] = (
    "rms_percent",
    "rms_kelvin",
    "p99_percent",
    "p99_kelvin",
)


@dataclass(frozen=True)
class Point:
    """A choice, or a rival, over all loads."""

    name: str
    choice: dict[str, str]
    """Label on each axis of the sweep."""
    errors: dict[Measure, float]
    """Largest error of all saved times and loads [K], [%]."""
    own_error_percent: float | None
    """Error of the reference itself, in percent of the same range."""
    nodes: int
    memory_bytes: int
    steps: int | None
    time: Spread | None
    """Run time of the slowest load [s]; None if it was not timed."""
    call_s: float | None = None
    """Time of a user's second call [s]."""
    known_set_up_s: float | None = None
    """Time for voxels, structure and plan of a scene whose geometry is cached [s]."""
    compile_s: float | None = None
    ratio: Spread | None = None
    """Time of the full volume's explicit loop over that of the choice [-]."""
    processor: str | None = None
    offline_s: float | None = None
    """Time of the single preparation of a reduced model [s]."""
    picture: str | None = None
    """File with its differences under the worst load."""
    words: str | None = None
    """Structure with its sizes in millimetres."""
    set: Changes | None = None
    """Changes of the scene by dotted key."""
    loads: tuple[str, ...] = ()
    models: dict[str, str] | None = None
    """File of a reduced model by load, in the folder of the sweep."""

    @property
    def kind(self) -> str:
        """Name without voxels and steps, common to rivals of one kind."""
        return self.name.split(",")[0]

    @property
    def time_s(self) -> float | None:
        """Median run time [s]."""
        return None if self.time is None else self.time.median

    def cost(self, cost: Cost) -> float | int | None:
        """Run time [s], memory [bytes] or number of nodes; None if not known."""
        return getattr(self, cost)


def errors_of(error: Row) -> dict[Measure, float]:
    """Largest errors of a row over its saved times; infinite where one is not finite.

    The percent of the 99th percentile are of the same range as those of the RMS.
    """
    rms = _finite_or_infinite(error["rms_kelvin"])
    percent = _finite_or_infinite(error["rms_percent"])
    p99 = _finite_or_infinite(error["p99_kelvin"])
    has_range = (rms > 0) & np.isfinite(percent)
    scaled = percent.copy()
    scaled[has_range] *= p99[has_range] / rms[has_range]
    return {
        "rms_percent": float(percent.max()),
        "rms_kelvin": float(rms.max()),
        "p99_percent": float(scaled.max()),
        "p99_kelvin": float(p99.max()),
    }


def _finite_or_infinite(values: Sequence[float | None]) -> Float[np.ndarray, " t"]:
    return np.array([np.inf if value is None else value for value in values], float)


def points_of(
    rows: Sequence[Row], times: Iterable[Row], loads: set[str]
) -> list[Point]:
    """Points of the choices that have a row under every load.

    Args:
        rows: of the errors, without those of failed cases.
        times: of the timed cases, by the same ids.
        loads: names of all loads.
    """
    timed = {row["id"]: row for row in times if row.get("loop_s")}
    return [
        _point(group, [timed.get(row["id"]) for row in group])
        for group in _groups(rows, loads)
    ]


def _groups(rows: Sequence[Row], loads: set[str]) -> list[list[Row]]:
    """Rows of each choice, or rival, that has one under every load."""
    groups: dict[str, dict[str, Row]] = {}
    for row in rows:
        if "failed" not in row:
            key = json.dumps([row.get("name"), row["choice"]], sort_keys=True)
            # A row measured again replaces the one before.
            groups.setdefault(key, {})[row["load"]] = row
    return [list(group.values()) for group in groups.values() if set(group) == loads]


def _point(rows: list[Row], times: list[Row | None]) -> Point:
    errors = [errors_of(row["error"]) for row in rows]
    worst = rows[int(np.argmax([error["rms_percent"] for error in errors]))]
    timed = [row for row in times if row is not None]
    all_timed = len(timed) == len(rows)
    slowest = max(timed, key=lambda row: statistics.median(row["loop_s"]), default={})
    full = slowest.get("full_volume_loop_s")
    own_errors = [
        v for row in rows for v in row.get("own_error", {}).get("rms_percent", ()) if v
    ]
    choice = rows[0]["choice"]
    return Point(
        name=", ".join(_label(axis, value) for axis, value in choice.items()),
        choice=choice,
        errors={
            measure: max(error[measure] for error in errors) for measure in MEASURES
        },
        own_error_percent=max(own_errors, default=None),
        nodes=_largest(rows, "nodes"),
        memory_bytes=_largest(rows, "memory_bytes"),
        steps=_largest(rows, "steps") or None,
        time=Spread.of(slowest["loop_s"]) if all_timed else None,
        call_s=_median(timed, "call_s"),
        known_set_up_s=_median(timed, "known_set_up_s"),
        compile_s=_median(timed, "compile_s"),
        ratio=ratio_of(full, slowest["loop_s"]) if all_timed and full else None,
        processor=slowest.get("processor"),
        picture=worst.get("picture"),
        set=rows[0].get("set"),
        loads=tuple(row["load"] for row in rows),
    )


def _largest(rows: Sequence[Row], name: str) -> int:
    return max(row.get(name) or 0 for row in rows)


def _median(rows: Sequence[Row], name: str) -> float | None:
    """Largest median of the rows with such a time [s]; None without any."""
    values = [row[name] for row in rows if row.get(name)]
    medians = (float(np.median(value)) for value in values)
    return max(medians, default=None)


def _label(axis: str, value: str) -> str:
    """A label that is clear without its axis: a number alone is not."""
    spoken = any(letter.isalpha() for letter in value)
    return value if spoken else f"{axis.replace('_', ' ')} {value}"


def rivals_of(rows: Sequence[Row], loads: set[str]) -> list[Point]:
    """Points of the rivals that have a row under every load."""
    return [_rival(group) for group in _groups(rows, loads)]


def _rival(rows: list[Row]) -> Point:
    point = _point(rows, [*rows])
    labels = [_label(axis, value) for axis, value in point.choice.items()]
    offline = [row["offline_s"] for row in rows if row.get("offline_s") is not None]
    models = {row["load"]: row["model"] for row in rows if row.get("model")}
    return replace(
        point,
        name=", ".join([rows[0]["name"], *labels]),
        offline_s=max(offline, default=None),
        models=models if len(models) == len(rows) else None,
    )


def _non_dominated(values: Float[np.ndarray, "n m"]) -> Bool[np.ndarray, " n"]:
    """True for the rows that no other row beats.

    A row is better than another if it is smaller in one column and larger in none.
    """
    no_larger = (values[:, None] <= values[None]).all(axis=2)
    smaller = (values[:, None] < values[None]).any(axis=2)
    return np.logical_not((no_larger & smaller).any(axis=0))


def front(
    points: Sequence[Point], cost: Cost = "time_s", error: Measure = "rms_percent"
) -> list[Point]:
    """Points that no other point beats in error and cost, the cheapest first."""
    comparable = [p for p in points if p.cost(cost) is not None]
    comparable = [p for p in comparable if np.isfinite(p.errors[error])]
    if not comparable:
        return []
    values = np.array([[p.cost(cost), p.errors[error]] for p in comparable], float)
    keep = _non_dominated(values)
    best = [point for point, is_best in zip(comparable, keep, strict=True) if is_best]
    return sorted(best, key=lambda p: (p.cost(cost), p.errors[error]))


def fastest_within(points: Iterable[Point], percent: float) -> Point | None:
    """The fastest point with an RMS error of at most so many percent, if any."""
    within = [
        p for p in points if p.time is not None and p.errors["rms_percent"] <= percent
    ]
    return min(within, key=lambda p: p.time_s or 0.0, default=None)
