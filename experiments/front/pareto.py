"""Choices by error and cost, and those that no other choice beats in both.

A choice is judged by its worst load: the largest error and the largest median time.
"""

import json
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float


Row = dict[str, Any]
"""A line of rows.jsonl, times.jsonl or rivals.jsonl."""

Measure = Literal["rms_percent", "rms_kelvin", "p99_percent", "p99_kelvin"]

Cost = Literal["time_s", "memory_bytes", "nodes"]

MEASURES: tuple[Measure, ...] = (
    "rms_percent",
    "rms_kelvin",
    "p99_percent",
    "p99_kelvin",
)


@dataclass(frozen=True)
class Spread:
    """Median, lowest and highest value."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Point:
    """A choice, or a rival, over all loads."""

    name: str
    choice: dict[str, str]
    """Label on each axis of the sweep."""
    errors: dict[Measure, float]
    """Largest of all saved times and loads [K], [%]."""
    own_error_percent: float | None
    """Error of the reference itself, in percent of the same range."""
    nodes: int
    memory_bytes: int
    steps: int | None
    time: Spread | None
    """Run time of the load that takes longest [s]; None if it was not timed."""
    call_s: float | None = None
    """Time that a user waits for a second call [s]."""
    known_set_up_s: float | None = None
    """Voxels, structure and plan of a scene whose geometry is known from earlier runs
    [s]."""
    compile_s: float | None = None
    ratio: Spread | None = None
    """Time of the full volume's explicit loop over that of the choice [-]."""
    processor: str | None = None
    offline_s: float | None = None
    """Preparation that a reduced model needs once [s]."""
    picture: str | None = None
    """File with its differences under the worst load."""
    words: str | None = None
    """Structure with its sizes in millimetres."""
    set: dict[str, Any] | None = None
    """Changes of the scene by dotted key."""
    loads: tuple[str, ...] = ()
    models: dict[str, str] | None = None
    """File of a reduced model by load, in the folder of the sweep."""

    @property
    def kind(self) -> str:
        """Name that rivals share, whatever their voxels and steps."""
        return self.name.split(",")[0]

    @property
    def time_s(self) -> float | None:
        """Median run time [s]."""
        return None if self.time is None else self.time.median

    def cost(self, kind: Cost) -> float | int | None:
        """Run time [s], memory [bytes] or number of nodes; None if not known."""
        return getattr(self, kind)


def key_of(choice: dict[str, str]) -> str:
    """Text that is equal for equal choices."""
    return json.dumps(choice, sort_keys=True)


def errors_of(error: Row) -> dict[Measure, float]:
    """Largest errors of a row over its saved times; infinite where one is not finite.

    The percent of the 99th percentile are of the same range as those of the RMS.
    """
    rms, percent, p99 = (
        [np.inf if v is None else float(v) for v in error[name]]
        for name in ("rms_kelvin", "rms_percent", "p99_kelvin")
    )
    scaled = [
        far * of / near if near > 0 and np.isfinite(of) else of
        for near, of, far in zip(rms, percent, p99, strict=True)
    ]
    return {
        "rms_percent": max(percent),
        "rms_kelvin": max(rms),
        "p99_percent": max(scaled),
        "p99_kelvin": max(p99),
    }


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
    groups: dict[str, list[Row]] = {}
    for row in rows:
        if "failed" not in row:
            groups.setdefault(key_of(row["choice"]), []).append(row)
    return [
        _point(group, [timed.get(row["id"]) for row in group])
        for group in groups.values()
        if {row["load"] for row in group} == loads
    ]


def _point(rows: list[Row], times: list[Row | None]) -> Point:
    found = [errors_of(row["error"]) for row in rows]
    worst = rows[int(np.argmax([error["rms_percent"] for error in found]))]
    known = [row for row in times if row is not None]
    whole = len(known) == len(rows)
    slowest = max(known, key=lambda row: statistics.median(row["loop_s"]), default={})
    most = lambda name: max(row.get(name) or 0 for row in rows)
    median = lambda name: max(
        (statistics.median(np.atleast_1d(row[name])) for row in known if row.get(name)),
        default=None,
    )
    full = slowest.get("full_volume_loop_s")
    own = [v for row in rows for v in row["own_error"].get("rms_percent", ()) if v]
    choice = rows[0]["choice"]
    return Point(
        name=", ".join(_label(*item) for item in choice.items()),
        choice=choice,
        errors={kind: max(error[kind] for error in found) for kind in MEASURES},
        own_error_percent=max(own, default=None),
        nodes=most("nodes"),
        memory_bytes=most("memory_bytes"),
        steps=most("steps") or None,
        time=spread_of(slowest["loop_s"]) if whole else None,
        call_s=median("call_s"),
        known_set_up_s=median("known_set_up_s"),
        compile_s=median("compile_s"),
        ratio=ratio_of(full, slowest["loop_s"]) if whole and full else None,
        processor=slowest.get("processor"),
        picture=worst.get("picture"),
        set=rows[0].get("set"),
        loads=tuple(row["load"] for row in rows),
    )


def _label(axis: str, value: str) -> str:
    """A label that is clear without its axis: a number alone is not."""
    spoken = any(letter.isalpha() for letter in value)
    return value if spoken else f"{axis.replace('_', ' ')} {value}"


def rivals_of(rows: Sequence[Row], loads: set[str]) -> list[Point]:
    """Points of the rivals that have a row under every load."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        key = f"{row['name']} {key_of(row['choice'])}"
        groups.setdefault(key, []).append(row)
    found = []
    for group in groups.values():
        # A row measured again replaces the one before.
        latest = list({row["load"]: row for row in group}.values())
        if {row["load"] for row in latest} == loads:
            found.append(_rival(latest))
    return found


def _rival(rows: list[Row]) -> Point:
    own = [{"own_error": {}, **row} for row in rows]
    point = _point(own, [*rows])
    labels = [_label(*item) for item in point.choice.items()]
    offline = [row["offline_s"] for row in rows if row.get("offline_s") is not None]
    models = {row["load"]: row["model"] for row in rows if row.get("model")}
    more = {
        "name": ", ".join([rows[0]["name"], *labels]),
        "offline_s": max(offline, default=None),
        "models": models if len(models) == len(rows) else None,
    }
    return Point(**{**vars(point), **more})


def spread_of(values: Sequence[float]) -> Spread:
    """Median and extremes."""
    return Spread(statistics.median(values), min(values), max(values))


def ratio_of(above: Sequence[float], below: Sequence[float]) -> Spread:
    """Spread of the ratio of values that were measured in turn."""
    return spread_of([a / b for a, b in zip(above, below, strict=True)])


def non_dominated(values: Float[np.ndarray, "n m"]) -> Bool[np.ndarray, " n"]:
    """True for the rows that no other row is better than.

    A row is better than another if it is smaller in one column and larger in none.
    """
    no_larger = (values[:, None] <= values[None]).all(axis=2)
    smaller = (values[:, None] < values[None]).any(axis=2)
    return np.logical_not((no_larger & smaller).any(axis=0))


def front(
    points: Sequence[Point], cost: Cost = "time_s", error: Measure = "rms_percent"
) -> list[Point]:
    """Points that no other point beats in error and cost, the cheapest first."""
    known = [p for p in points if p.cost(cost) is not None]
    known = [p for p in known if np.isfinite(p.errors[error])]
    if not known:
        return []
    values = np.array([[p.cost(cost), p.errors[error]] for p in known], float)
    chosen = non_dominated(values)
    best = [p for p, is_best in zip(known, chosen, strict=True) if is_best]
    return sorted(best, key=lambda p: (p.cost(cost), p.errors[error]))


def fastest_within(points: Iterable[Point], percent: float) -> Point | None:
    """The fastest point with an RMS error of at most so many percent, if any."""
    within = [
        p for p in points if p.time is not None and p.errors["rms_percent"] <= percent
    ]
    return min(within, key=lambda p: p.time_s or 0.0, default=None)
