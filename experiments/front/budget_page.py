from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from calibrate.runs.truth import Truth
from jaxthermo.host_memory import readable_bytes
from jaxthermo.report import page
from jaxthermo.report.numbers import padded, seconds

from ..harness.present import Column, publish, table_of
from ..harness.record import Row
from ..sweep.config import SweepConfig, to_yaml
from ..sweep.summary import goals_table


_DASH = "\N{EN DASH}"


def _number(name: str) -> Callable[[Row], str]:
    def words(line: Row) -> str:
        value = line.get(name)
        return _DASH if value is None else padded(value)

    return words


def _of_voxels(line: Row) -> str:
    if line["shares_voxels"]:
        return "same voxels"
    return _number("discretisation_kelvin")(line)


_LINE: list[Column] = [
    ("nodes", "{nodes:,}"),
    ("error K", _number("whole_kelvin")),
    ("error %", _number("rms_percent")),
    ("voxels K", _of_voxels),
    ("structure K", _number("structure_kelvin")),
    ("time K", _number("time_kelvin")),
    ("reading K", _number("reading_kelvin")),
    ("run", lambda line: seconds(line["run_time_s"])),
]


def _by_time(name: str) -> Callable[[Row], str]:
    def words(row: Row) -> str:
        values = row["whole"][name]
        return ", ".join(_DASH if v is None else padded(v) for v in values)

    return words


_BY_LOAD: list[Column] = [
    ("load", "{load}"),
    ("K at each time", _by_time("rms_kelvin")),
    ("% at each time", _by_time("rms_percent")),
    ("p99 K", lambda row: padded(row["whole"]["worst_p99_kelvin"])),
    ("mean K", lambda row: padded(row["whole"]["worst_bias_kelvin"])),
    ("lost", lambda row: padded(row["whole"]["worst_lost_fraction"])),
]

_TERMS = {
    "error": "root mean square, over points spread evenly over the mesh, of the "
    "difference in surface temperature from the reference, in K and in percent of the "
    "reference's range (0.5 to 99.5 %) at that time; the largest of the saved times "
    "and loads",
    "voxels": "error of the full volume of these voxels, or of their octree where there "
    "is none; structures of the reference's own voxels share their error with it",
    "structure": "difference from that full volume or octree",
    "time": "difference from the run in steps a quarter as long; this and the next "
    "are measured up to a million nodes, of runs that control their error in time",
    "reading": "difference between the temperatures of the nearest nodes and those "
    "corrected by the heat flux, as in all other columns",
    "run": "all passes of the solver until the error in time holds, compiled; the "
    "fastest of the loads",
}


def _cost(name: str, form: Callable[[Any], str]) -> Callable[[Row], str]:
    return lambda row: ", ".join(form(cost[name]) for cost in row["costs"])


def _own_by_time(row: Row) -> str:
    own_error = row["own_error"]
    pairs = zip(own_error["rms_kelvin"], own_error["is_bound"], strict=True)
    return ", ".join(f"bound {padded(v)}" if b else padded(v) for v, b in pairs)


def _orders(row: Row) -> str:
    orders = row["own_error"]["order"]
    return ", ".join(_DASH if p is None else f"{p:.2f}" for p in orders)


# The reference and its two coarser runs, the finest first.
_REFERENCE: list[Column] = [
    ("pitch mm", _cost("pitch_m", lambda pitches: f"{1e3 * pitches[0]:.3g}")),
    ("nodes", _cost("nodes", "{:,}".format)),
    ("memory", _cost("memory_bytes", readable_bytes)),
    ("run", _cost("run_time_s", seconds)),
    ("own error K at each time", _own_by_time),
    ("observed order", _orders),
]


def write_budget(
    lines: Sequence[Row], truths: Sequence[Truth], config: SweepConfig, folder: Path
) -> None:
    """Print the table, and write it with all its loads and times as a page."""
    references = [truth._asdict() for truth in truths]
    own_kelvin = max(truth.own_error["worst_rms_kelvin"] for truth in truths)
    is_bound = any(any(truth.own_error["is_bound"]) for truth in truths)
    structure = config.truth.structure.kind.replace("_", " ")
    caption = (
        f"Reference: {structure} of {references[0]['costs'][0]['nodes']:,} nodes, itself "
        f"off by {'at most about' if is_bound else 'about'} {padded(own_kelvin)} K"
    )
    names: list[Column] = [
        (axis.replace("_", " "), lambda line, axis=axis: line["choice"][axis])
        for axis in config.axes
    ]
    left = tuple(range(len(names)))
    by_load = [
        {**line, "load": load, **errors}
        for line in lines
        for load, errors in line["by_load"].items()
    ]
    all_loads = table_of(by_load, columns=[*names, *_BY_LOAD], left=left)
    sections: list[page.Section] = [
        table_of(
            lines,
            columns=[*names, *_LINE],
            title="parts of the error",
            caption=caption,
            names=len(names),
            left=left,
        ),
        page.paragraph(caption, note=True),
        *goals_table(config, lines),
        page.terms(list(_TERMS.items())),
        page.details("Every load and time", all_loads),
        page.details("References", table_of(references, _REFERENCE)),
        page.details("The config", page.pre(to_yaml(config))),
    ]
    publish(folder, "Where errors come from", sections)
