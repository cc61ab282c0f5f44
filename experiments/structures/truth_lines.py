"""Truth errors in lines, columns and words."""

from typing import Any

from jaxthermo.arrays import readable_bytes
from jaxthermo.report.numbers import padded, seconds

from ..harness.present import Column
from ..harness.record import Row


_DASH = "\N{EN DASH}"
_SHARED = "has the voxels of the reference"


def worst_truth(rows: list[Row]) -> dict[str, Any] | None:
    """Largest truth errors of a structure over its loads; None if there are none."""
    found = [(row["load"], row["truth"]) for row in rows if row.get("truth")]
    if not found:
        return None
    _, worst = max(found, key=lambda pair: pair[1]["error"]["worst_rms_kelvin"])
    errors = [truth["error"] for _, truth in found]
    percent = [e["worst_rms_percent"] for e in errors]
    return {
        "rms_kelvin": {
            load: truth["error"]["worst_rms_kelvin"] for load, truth in found
        },
        "worst_rms_kelvin": worst["error"]["worst_rms_kelvin"],
        "worst_rms_percent": max((p for p in percent if p is not None), default=None),
        "worst_p99_kelvin": max(e["worst_p99_kelvin"] for e in errors),
        "worst_bias_kelvin": max((e["worst_bias_kelvin"] for e in errors), key=abs),
        "worst_lost_fraction": max(e["worst_lost_fraction"] for e in errors),
        # The reference's own, under the load of the largest error.
        "own_kelvin": worst["own_error"]["worst_rms_kelvin"],
        "own_is_bound": any(worst["own_error"]["is_bound"]),
        "remarks": list(dict.fromkeys(r for e in errors for r in e["remarks"])),
    }


def _of_truth(line: Row, name: str) -> str:
    value = (line.get("truth") or {}).get(name)
    return _DASH if value is None else padded(value)


def _by_load(line: Row) -> str:
    errors = (line.get("truth") or {}).get("rms_kelvin", {})
    return ", ".join(f"{k}: {padded(v)}" for k, v in errors.items()) or _DASH


def _own(line: Row) -> str:
    truth = line.get("truth")
    if not truth:
        return _DASH
    own = padded(truth["own_kelvin"])
    words = f"bound {own}" if truth["own_is_bound"] else own
    shares = any(_SHARED in remark for remark in truth["remarks"])
    return f"{words}, same voxels" if shares else words


TRUTH_COLUMNS: list[Column] = [
    ("truth K", lambda line: _of_truth(line, "worst_rms_kelvin")),
    ("truth %", lambda line: _of_truth(line, "worst_rms_percent")),
    ("truth's own K", _own),
]
"""Error against finer voxels, and the error of these."""

ALL_TRUTH_COLUMNS: list[Column] = [
    ("truth RMS K by load", _by_load),
    ("truth %", lambda line: _of_truth(line, "worst_rms_percent")),
    ("truth p99 K", lambda line: _of_truth(line, "worst_p99_kelvin")),
    ("truth mean K", lambda line: _of_truth(line, "worst_bias_kelvin")),
    ("lost", lambda line: _of_truth(line, "worst_lost_fraction")),
    ("truth's own K", _own),
]


def _at_each_time(part: str, name: str) -> Any:
    def words(row: Row) -> str:
        values = ((row.get("truth") or {}).get(part) or {}).get(name, ())
        return ", ".join(_DASH if v is None else padded(v) for v in values) or _DASH

    return words


TRUTH_BY_TIME: list[Column] = [
    ("truth K at each time", _at_each_time("error", "rms_kelvin")),
    ("truth % at each time", _at_each_time("error", "rms_percent")),
]
"""Errors of one structure under one load."""


def _own_by_time(row: Row) -> str:
    own = row["own_error"]
    pairs = zip(own["rms_kelvin"], own["is_bound"], strict=True)
    return ", ".join(f"bound {padded(v)}" if b else padded(v) for v, b in pairs)


def _orders(row: Row) -> str:
    orders = row["own_error"]["order"]
    return ", ".join(_DASH if p is None else f"{p:.2f}" for p in orders)


def _cost(name: str, form: Any) -> Any:
    return lambda row: ", ".join(form(cost[name]) for cost in row["costs"])


REFERENCE_COLUMNS: list[Column] = [
    ("body", "{body}"),
    ("load", "{load}"),
    ("pitch mm", _cost("pitch_m", lambda pitches: f"{1e3 * pitches[0]:.3g}")),
    ("nodes", _cost("nodes", "{:,}".format)),
    ("memory", _cost("memory_bytes", readable_bytes)),
    ("run", _cost("run_time_s", seconds)),
    ("cached", _cost("cached", lambda cached: "yes" if cached else "no")),
    ("own error K at each time", _own_by_time),
    ("observed order", _orders),
]
"""The three runs of finer voxels of a load, the finest first, and its error."""


def truth_notes(lines: list[Row]) -> list[str]:
    """The reference's own error, and what is not independent of it, of one body."""
    found = [(line["label"], line["truth"]) for line in lines if line.get("truth")]
    if not found:
        return []
    _, worst = max(found, key=lambda pair: pair[1]["own_kelvin"])
    about = "at most about" if worst["own_is_bound"] else "about"
    notes = [
        "truth: against finer voxels, whose own error is "
        f"{about} {padded(worst['own_kelvin'])} K"
    ]
    for remark in dict.fromkeys(r for _, truth in found for r in truth["remarks"]):
        labels = [label for label, truth in found if remark in truth["remarks"]]
        whose = "all rows" if len(labels) == len(found) else ", ".join(labels)
        notes.append(f"note: {whose}: {remark}")
    return notes
