"""Section 5.4: the cylinder's number in place of a flow, beside that flow."""

from typing import Any

import altair as alt
import numpy as np
from PIL import Image

from jaxthermo.flow.run import FlowRun
from jaxthermo.report.chart import Chart, legend
from jaxthermo.report.numbers import significant
from jaxthermo.report.sheet import Tile, enlarged, sheet

from ...harness.present import Rows, colour_bar, table_of, thermal_tile
from ..convection_numbers import FAST, HEIGHT, SHADES, WIDTH, angle_axis
from ..exhibit import Exhibit, Finding, Picture, Plot, Row, Verdict
from ..flow_closure import (
    DEGREES,
    FACES,
    RoundRod,
    SquareRod,
    local_number,
    round_rod,
    square_rod,
)


# Reynolds numbers of steady flows; cells across a rod on each lattice, the finest last;
# and how often the stream passes from end to end.
_REYNOLDS, _QUICK_REYNOLDS = (20.0, 40.0), (20.0,)
_CELLS, _QUICK_CELLS = (10, 16), (8,)
_PASSES, _QUICK_PASSES = 3.0, 2.0
# Errors up to which the number stands for the flow [-].
_WITHIN = 0.1
# Of a picture: half its width [diameters], and its edge [px].
_AROUND, _EDGE = 3, 480


def _measure(quick: bool) -> Finding:
    lattices = _QUICK_CELLS if quick else _CELLS
    passes = _QUICK_PASSES if quick else _PASSES
    rounds: list[RoundRod] = []
    squares: list[SquareRod] = []
    rows: Rows = []
    for reynolds in _QUICK_REYNOLDS if quick else _REYNOLDS:
        for cells in lattices:
            rod = round_rod(reynolds, cells, passes)
            box = square_rod(reynolds, cells, passes)
            rows += [*_round_rows(rod, cells), *_square_rows(box, cells)]
        # Of the finest lattice.
        rounds.append(rod)
        squares.append(box)
    chosen = (
        ("flow", "steady, in a plane, air of Pr 0.71; walls that slip 30 widths apart"),
        ("lattice", f"{lattices[-1]} cells across a rod"),
        ("number", "our table of figure 5.6 with its own averages"),
        (
            "length of a square",
            "the diameter of a round rod as large, as our wind takes it; the thesis "
            "leaves it open",
        ),
    )
    verdict, reason = _judged(rounds, squares)
    air = _picture(rounds[-1].run, squares[-1].run)
    parts = (
        Plot("closure_around", _chart(rounds), "Lines: the number. Points: the flow."),
        Picture(
            "closure_air", air, f"Re {rounds[-1].reynolds:g}, the wind from the left."
        ),
        table_of(rows, _COLUMNS, "Nusselt numbers", left=(2,)),
    )
    return Finding(
        verdict, reason, _rows(rounds, squares), {}, chosen, parts, {"rows": rows}
    )


def _judged(rounds: list[RoundRod], squares: list[SquareRod]) -> tuple[Verdict, str]:
    rms = max(rod.rms for rod in rounds)
    means = [_off(rod.closure_mean, rod.flow_mean) for rod in rounds]
    mean = max(means, key=abs)
    each = [
        (_off(box.closure[face], box.flow[face]), face, box.reynolds)
        for box in squares
        for face in FACES
    ]
    worst, face, reynolds = max(each, key=lambda item: abs(item[0]))
    totals = [_off(closure, flow) for flow, closure in (box.means for box in squares)]
    total = max(totals, key=abs)
    is_round = max(rms, abs(mean)) < _WITHIN
    if not is_round:
        verdict = Verdict.CONTRADICTED
    else:
        holds = max(abs(worst), abs(total)) < _WITHIN
        verdict = Verdict.REPRODUCED if holds else Verdict.DIFFERENT
    updates = rounds[-1].run.channel.shape[0] * rounds[-1].run.channel.shape[1]
    updates *= int(rounds[-1].run.step[-1])
    return verdict, (
        f"On a cylinder the number stands for the flow: {rms:.1%} RMS around it, its "
        f"mean {mean:+.1%}. The thesis sets every surface to the number of its normal; "
        f"on a square rod the {face} at Re {reynolds:g} is then {worst:+.0%} off and "
        f"the whole rod {total:+.0%}: a flat face is no stagnation point all over. "
        f"What is saved are {updates:.1e} updates of cells of one flow in a plane, "
        "for a polynomial at each surface cell. Both flows are steady and in a plane; "
        f"the thesis' figure begins at Re {FAST[0]:g}, which no flow here reaches."
    )


def _off(closure: float, flow: float) -> float:
    return closure / flow - 1


def _rows(rounds: list[RoundRod], squares: list[SquareRod]) -> tuple[Row, ...]:
    said = "the cylinder's number"
    shown = []
    for rod in rounds:
        what = f"round rod, Re {rod.reynolds:g}"
        mean, rms = f"{_off(rod.closure_mean, rod.flow_mean):+.1%}", f"{rod.rms:.1%}"
        shown.append(Row(f"{what}: RMS of the number off the flow", said, rms))
        shown.append(Row(f"{what}: mean of the number off the flow's", said, mean))
    for box in squares:
        flow, closure = box.means
        what = f"square rod, Re {box.reynolds:g}"
        front = f"{_off(box.closure['front'], box.flow['front']):+.1%}"
        shown.append(Row(f"{what}: front", said, front))
        shown.append(Row(f"{what}: whole", said, f"{_off(closure, flow):+.1%}"))
        (number,) = local_number(np.zeros(1), box.reynolds)
        off = f"{_off(number, box.flow['front']):+.1%}"
        shown.append(Row(f"{what}: front, with its width as length", said, off))
    return tuple(shown)


_COLUMNS = (
    ("Re", "{Re:g}"),
    ("cells", "{cells}"),
    ("", "{what}"),
    ("flow", lambda row: significant(row["flow"])),
    ("number", lambda row: significant(row["closure"])),
)


def _line(
    reynolds: float, cells: int, what: str, flow: float, closure: float
) -> dict[str, Any]:
    names = {"Re": reynolds, "cells": cells, "what": what}
    return {**names, "flow": flow, "closure": closure}


def _round_rows(rod: RoundRod, cells: int) -> Rows:
    at = lambda degrees: int(np.flatnonzero(degrees == DEGREES)[0])
    line = lambda what, *numbers: _line(rod.reynolds, cells, what, *numbers)
    return [
        line("round rod, mean", rod.flow_mean, rod.closure_mean),
        line("round rod, Churchill-Bernstein", rod.flow_mean, rod.correlation_mean),
        *(
            line(
                f"round rod, {degrees:g}°",
                float(rod.flow[at(degrees)]),
                float(rod.closure[at(degrees)]),
            )
            for degrees in FACES.values()
        ),
    ]


def _square_rows(box: SquareRod, cells: int) -> Rows:
    line = lambda what, *numbers: _line(box.reynolds, cells, what, *numbers)
    return [
        line("square rod, mean", *box.means),
        *(line(f"square rod, {n}", box.flow[n], box.closure[n]) for n in FACES),
    ]


def _chart(rounds: list[RoundRod]) -> Chart:
    points = [
        {"angle": float(degrees), "value": float(value), "Re": name, "kind": kind}
        for rod in rounds
        for name in (f"Re {rod.reynolds:g}",)
        for kind in ("flow", "closure")
        for degrees, value in zip(DEGREES, getattr(rod, kind), strict=True)
        # Points every 15 degrees, which one can tell from the line.
        if kind == "closure" or degrees % 15 == 0
    ]
    names = [f"Re {rod.reynolds:g}" for rod in rounds]
    scale = alt.Scale(domain=names, range=[*SHADES[1:5:2]][: len(names)])
    of = lambda kind: alt.Chart(
        alt.Data(values=[each for each in points if each["kind"] == kind])
    ).encode(
        x=angle_axis(),
        y=alt.Y("value:Q", title="local Nusselt number"),
        color=alt.Color("Re:N", scale=scale, sort=names, legend=legend()),
    )
    dots = of("flow").mark_point(filled=True, size=60, opacity=1)
    chart = alt.layer(of("closure").mark_line(strokeWidth=2), dots)
    title = "Round rod in air: number and flow"
    return chart.properties(width=WIDTH, height=HEIGHT, title=title)


def _picture(round_run: FlowRun, square_run: FlowRun) -> Image.Image:
    tiles = [
        _air(run, name)
        for run, name in ((round_run, "round rod"), (square_run, "square rod"))
    ]
    bar = colour_bar(0.0, 1.0, "excess over the wind's temperature, 1 at the rod")
    return sheet(tiles, bar, "Temperature of the air")


def _air(run: FlowRun, name: str) -> Tile:
    channel = run.channel
    solid, warm = channel.body.mask(channel.shape), run.mean.temperature
    assert warm is not None
    rows, columns = np.nonzero(solid)
    half = _AROUND * (np.ptp(columns) + 1)
    middle = (round(float(each.mean())) for each in (rows, columns))
    part = tuple(slice(m - half, m + half) for m in middle)
    # The lattice counts rows upwards.
    large = lambda a: enlarged(a[part][::-1, :, None], _EDGE)[..., 0]
    return thermal_tile(large(np.asarray(warm, float)), ~large(solid), (0.0, 1.0), name)


EXHIBIT = Exhibit(
    name="section-5.4-closure",
    title="a cylinder's number in place of the flow",
    place="5.4",
    claims=("C20",),
    measure=_measure,
)
