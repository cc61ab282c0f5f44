"""Time of a step over the number of nodes, of the stencil and of links, for balls.

Both forms of a ball must give the same temperatures.

A step that is linear in the nodes takes the same time a node at every size. Arrays
that no cache holds take longer than those that one does: the growth is that beyond, the
slope of the logarithms from 1 million nodes on.
"""

from functools import partial
from pathlib import Path
from typing import TypedDict

import numpy as np

import jaxthermo as jt
from jaxthermo.report.chart import Chart, write_chart
from jaxthermo.timing import interleaved

from ..harness.agreement import largest_difference
from ..harness.line_chart import CurvePoint, log_chart
from ..harness.measurement import MeasuredResult, Measurement, plain_rows
from ..harness.power_law import power
from .steps import conduction_of


QUICK = {"height": 58, "repeats": 2}

_RADIUS = 0.1
_ACROSS = (28, 40, 58, 84, 122, 180, 264, 386)
"""Voxels across the balls: from ten thousand to thirty million nodes."""
_MOST_LINKED = 4_000_000
"""Nodes up to which there are links: each node's take a hundred bytes to set up."""
_BEYOND_CACHE = 900_000
_WORK = 6e8
_MOST_STEPS = 2000
"""Nodes times steps of a call, and its largest number of steps."""
_MAX_DIFFERENCE = 1e-5
"""Largest difference of the states of both forms, which are 0 to 1 at the start."""
_COMPARED = 100
"""Steps after which they are compared."""
_FIRST = 2
"""Steps of a call to compare with: memory is new to the first, which takes its time."""


class _Row(TypedDict):
    """Times of a ball in one form."""

    form: str
    across: int
    nodes: int
    step_s: list[float]
    node_ns: float


class _Result(MeasuredResult):
    rows: list[_Row]
    growth: dict[str, float | None]
    charts: dict[str, str]
    files: list[str]


def run(folder: Path, height: int = _ACROSS[-1], repeats: int = 5) -> _Result:
    """Times of balls up to `height` voxels across, their growth, and a chart."""
    rows: list[_Row] = []
    for across in _ACROSS:
        if across <= height:
            rows += _measured(across, repeats)
    growth = {form: _growth(rows, form) for form in ("stencil", "links")}
    write_chart(_chart(rows), folder / "growth")
    by_form = sorted(rows, key=lambda row: row["form"], reverse=True)
    measured = [_measurement(row) for row in by_form]
    measured += [
        Measurement(f"{form}: power of the nodes from 1 million on", "-", [exponent])
        for form, exponent in growth.items()
        if exponent is not None
    ]
    return {
        "rows": rows,
        "growth": growth,
        "charts": {"growth": "Time of a step over the number of nodes"},
        "measurements": plain_rows(measured),
        "files": ["growth.svg", "growth.png"],
    }


def _measurement(row: _Row) -> Measurement:
    nodes = row["nodes"]
    name = f"{row['form']}: step over its {nodes:,} nodes"
    return Measurement(name, "s", [span / nodes for span in row["step_s"]])


def _measured(across: int, repeats: int) -> list[_Row]:
    ball = jt.shapes.sphere(_RADIUS)
    grid = jt.voxelize(ball, 2 * _RADIUS / across, "dominant_axis")
    forms = {"stencil": jt.FullVolume(grid)}
    if grid.solid_count <= _MOST_LINKED:
        forms["links"] = jt.FullVolume(grid, stencil=False)
    count = int(np.clip(_WORK / grid.solid_count, 4, _MOST_STEPS)) // 2 * 2
    calls = {}
    states = {}
    for form, structure in forms.items():
        conduct = conduction_of(structure)
        states[form] = conduct(_COMPARED)[structure.node_address()]
        calls[form] = partial(conduct, count + _FIRST)
        calls[f"{form}, first steps"] = partial(conduct, _FIRST)
    largest_difference(
        f"state of {grid.solid_count} nodes", states, tolerance=_MAX_DIFFERENCE
    )
    spans = interleaved(calls, repeats)
    rows: list[_Row] = []
    for form in forms:
        step = (np.array(spans[form]) - spans[f"{form}, first steps"]) / count
        rows.append(
            {
                "form": form,
                "across": across,
                "nodes": grid.solid_count,
                "step_s": step.tolist(),
                "node_ns": 1e9 * float(np.median(step)) / grid.solid_count,
            }
        )
    return rows


def _growth(rows: list[_Row], form: str) -> float | None:
    """Power of the number of nodes that the time grows with, beyond the caches."""
    large = [r for r in rows if r["form"] == form and r["nodes"] >= _BEYOND_CACHE]
    if len(large) < 2:
        return None
    nodes = np.array([row["nodes"] for row in large])
    node_times = np.array([row["node_ns"] for row in large])
    return power(nodes, node_times * nodes)


def _chart(rows: list[_Row]) -> Chart:
    points = [CurvePoint(row["form"], x=row["nodes"], y=row["node_ns"]) for row in rows]
    return log_chart(
        points,
        x_title="nodes",
        y_title="time of a step over nodes [ns]",
        title="Time of a step over the number of nodes",
    )
