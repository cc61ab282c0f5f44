"""Figures 6.8 and 6.10: time of a step over the resolution, of both bodies."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from jaxthermo.provenance import processor
from jaxthermo.report.numbers import significant, with_range
from jaxthermo.report.table import Table

from ..bodies import statue
from ..counting import TIMES
from ..exhibit import Exhibit, Finding, Plot, Verdict, skipped
from ..line_chart import log_chart, point
from ..resolution import FULL, HIGHEST_WITH_ERROR, KINDS, errors, step_times


_HEIGHTS, _QUICK_HEIGHTS = (50, 100, 150, 200, 250, 350, 450, 550), (50, 100, 150)
_QUICK_ERRORS = (150,)
_FIGURES = {"figure-6.8": "Happy Buddha", "figure-6.10": "Max Planck"}


def _measure(name: str, quick: bool) -> Finding:
    if statue(name) is None:
        return skipped(f"the mesh of {name} is not in JAXTHERMO_MESHES")
    heights = _QUICK_HEIGHTS if quick else _HEIGHTS
    times = [step_times(name, height) for height in heights]
    with_error = [
        h for h in heights if (h in _QUICK_ERRORS if quick else h <= HIGHEST_WITH_ERROR)
    ]
    wrong = {height: errors(name, height) for height in with_error}
    slope = {kind: _slope(times, kind) for kind in KINDS}
    last = times[-1]["times_faster"]
    ordered = last["single shell"][0] > last["irregular levels"][0] > 1
    verdict = Verdict.REPRODUCED if ordered else Verdict.CONTRADICTED
    words = ", ".join(f"{kind} {value:.2f}" for kind, value in slope.items())
    reason = (
        f"At {heights[-1]} voxels high the shell is {last['single shell'][0]:.2g} and "
        f"irregular levels {last['irregular levels'][0]:.2g} times as fast as the full "
        "volume. Between the two highest resolutions n the time of a step grows with n "
        f"to the power of: {words}; nodes grow with n³ in the full volume, with n² in "
        "shell and irregular levels. The thesis has the curves without their errors."
    )
    parts = (
        Plot(name.lower().replace(" ", "_"), _chart(name, times), _caption(name)),
        _table(times, wrong),
    )
    chosen = (
        ("resolution", "voxels along up: the text names only 225 x 550 x 225"),
        ("multi-level", "ten levels"),
        ("error", "worst RMS over the surface against the full volume, as in C12"),
    )
    numbers = {"times": times, "error_percent": wrong, "power_of_n": slope}
    return Finding(verdict, reason, chosen=chosen, parts=parts, numbers=numbers)


def _slope(times: list[dict[str, Any]], kind: str) -> float:
    """Power of the resolution that the time grows with between the last two."""
    a, b = times[-2:]
    ratio = np.median(b["step_s"][kind]) / np.median(a["step_s"][kind])
    return float(np.log(ratio) / np.log(b["height"] / a["height"]))


def _chart(name: str, times: list[dict[str, Any]]) -> Any:
    points = []
    for kind in KINDS:
        for row in times:
            step = 1e3 * float(np.median(row["step_s"][kind]))
            text = f"{kind}, {row['height']} voxels high: {significant(step)} ms"
            points.append(point(kind, row["height"], step, text))
    if name == "Happy Buddha":
        keys = ("shell", "irregular", "multi_level", "full_volume")
        theirs = zip(KINDS, keys, strict=True)
        for kind, key in theirs:
            text = f"{kind}, thesis: {1e3 * TIMES[key]:g} ms"
            points.append(point(kind, 550, 1e3 * TIMES[key], text, mark=True))
    x, y = "voxels along up", "time of a step of conduction [ms]"
    return log_chart(points, x, y, f"{name}: time of a step")


def _caption(name: str) -> str:
    theirs = "Diamonds: table 6.1 of the thesis, on an NVIDIA 9800 GT. "
    return f"{theirs if name == 'Happy Buddha' else ''}Lines: here, on {processor()}."


def _table(times: list[dict[str, Any]], wrong: dict[int, dict[str, float]]) -> Table:
    rows = []
    for row in times:
        for kind in KINDS:
            found = wrong.get(row["height"], {}).get(kind)
            rows.append(
                [
                    str(row["height"]),
                    kind,
                    f"{row['nodes'][kind]:,}",
                    f"{significant(1e3 * float(np.median(row['step_s'][kind])))}",
                    with_range(*row["times_faster"][kind]),
                    "0" if kind == FULL else "" if found is None else f"{found:.2g} %",
                ]
            )
    columns = ("high", "structure", "nodes", "step [ms]", "times faster", "error")
    return Table(columns, rows, "Time of a step and error", left=(1,))


def _exhibit(figure: str, name: str) -> Exhibit:
    measure: Callable[[bool], Finding] = partial(_measure, name)
    title, number = f"{name}: time of a step", figure.split("-")[1]
    return Exhibit(figure, title, f"6.3, figure {number}", (), measure)


EXHIBITS = tuple(_exhibit(*item) for item in _FIGURES.items())
