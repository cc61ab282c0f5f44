"""Chapter 3: how nodes, memory and time of the whole method grow on a body."""

from typing import Any, NamedTuple

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart
from jaxthermo.report.numbers import significant
from jaxthermo.report.table import Table

from ...benchmarks.mixed import Runner, step_spans
from ...harness.meshes import START, STEEL
from ...harness.present import Rows, table_of
from ..bodies import buddha
from ..exhibit import Exhibit, Finding, Plot, Row, Verdict
from ..line_chart import log_chart, point
from ..resolution import FULL, KINDS, timed_runner


# Voxels along up, at even ratios.
_HEIGHTS, _QUICK_HEIGHTS = (56, 80, 112, 160, 224, 320), (48, 72, 108)
_REPEATS = 30
_TERMS = (
    jt.Sun((-1.0, 0.0, 0.0), 5000.0),
    jt.Wind((3.0, 0.0, 0.0), START),
)
_SHELL, _IRREGULAR = "single shell", "irregular levels"
_QUANTITIES = {
    "nodes": "nodes",
    "memory": "memory_bytes",
    "step": "step_s",
    "stable step": "stable_step_s",
    "simulated second": "second_s",
}


class _Power(NamedTuple):
    """Power of the resolution that a quantity grows with, and its standard error."""

    power: float
    error: float

    @property
    def text(self) -> str:
        return f"{self.power:.2f} ± {self.error:.2f}"


def _fitted(sizes: Any, values: Any) -> _Power:
    """Least squares through the logarithms."""
    line, covariance = np.polyfit(np.log(sizes), np.log(values), 1, cov=True)
    return _Power(float(line[0]), float(np.sqrt(covariance[0, 0])))


def _measured(height: int, kinds: tuple[str, ...]) -> Rows:
    """Size and time of each structure at one resolution; the times in turn."""
    grid = buddha().grid(height)
    runners = {}
    for name in kinds:
        body = jt.Body(KINDS[name](grid), STEEL, temperature=START)
        runners[name] = timed_runner(jt.Scene((body,), _TERMS))
    spans = step_spans(runners, _REPEATS)
    rows = []
    for name, runner in runners.items():
        # The fastest: what else the machine does only makes a step slower.
        step, receipt = min(spans[name]), runner.compiled.receipt
        stable = float(runner.compiled.stable_step)
        rows.append(
            {
                "structure": name,
                "height": height,
                "box": grid.lattice.cells,
                "surface_cells": receipt.fragments,
                "nodes": receipt.nodes,
                "memory_bytes": _held_bytes(runner),
                "step_s": step,
                "stable_step_s": stable,
                "second_s": step / stable,
            }
        )
    return rows


def _held_bytes(runner: Runner) -> int:
    """Size of the arrays that steps read and write [bytes]."""
    held = runner.compiled.programs, runner.compiled.state
    return sum(np.asarray(leaf).nbytes for leaf in jax.tree.leaves(held))


def _measure(quick: bool) -> Finding:
    heights = np.array(_QUICK_HEIGHTS if quick else _HEIGHTS)
    # Each takes some seconds to compile.
    kinds = (_SHELL, _IRREGULAR, FULL) if quick else tuple(KINDS)
    rows = [row for height in heights.tolist() for row in _measured(height, kinds)]
    column = lambda name, key: [r[key] for r in rows if r["structure"] == name]
    powers = {
        name: {
            what: _fitted(heights, column(name, key))
            for what, key in _QUANTITIES.items()
        }
        for name in kinds
    }
    surface = _fitted(heights, column(FULL, "surface_cells"))
    box = _fitted(heights, column(FULL, "box"))
    claimed = _fitted(heights, heights**2 * np.log(heights))
    chosen = (
        *buddha().stands_in,
        ("n", f"voxels along up, {', '.join(map(str, heights))}"),
        ("method", "steel in sun and wind, explicit steps in float32"),
        ("error", "the standard error of a straight line through the logarithms"),
        ("memory", "arrays that a step reads and writes, of one scene"),
        ("order", "in chapter 3 of convection, in 6.1 of voxels: both are counted"),
        ("multi-level", "ten levels, as in table 6.1, not in the reduced size"),
    )
    caption = "The claim is drawn from the first point of irregular levels on."
    timed = f"The fastest of {_REPEATS} calls, structures in turn, on {processor()}."
    parts = (
        _power_table(powers, claimed),
        Plot("growth_nodes", _chart(rows, "nodes", "nodes", 1.0), caption),
        Plot("growth_time", _chart(rows, "step_s", "time of a step [ms]", 1e3), timed),
        _size_table(rows),
    )
    shells, nested = (
        np.array(column(name, "nodes"), float) for name in (_SHELL, _IRREGULAR)
    )
    beyond = _fitted(heights, nested / shells), _fitted(heights, np.log(heights))
    numbers = {
        "rows": rows,
        "powers": {
            name: {k: list(p) for k, p in own.items()} for name, own in powers.items()
        },
        "surface_cells": list(surface),
        "claimed": list(claimed),
        "irregular_over_shell": list(beyond[0]),
        "logarithm": list(beyond[1]),
    }
    verdict, reason = _judged(powers, surface, beyond)
    shown = _rows(surface, box, claimed, beyond)
    return Finding(verdict, reason, shown, {}, chosen, parts, numbers)


def _judged(
    powers: dict[str, dict[str, _Power]], surface: _Power, beyond: tuple[_Power, _Power]
) -> tuple[Verdict, str]:
    own, full = powers[_IRREGULAR], powers[FULL]
    extra, logarithm = beyond
    # Nearer to n² than to n³, whatever the logarithm. Of what is counted: times vary.
    holds = all(own[what].power < 2.5 for what in ("nodes", "memory"))
    without = abs(extra.power) < abs(extra.power - logarithm.power)
    reason = (
        f"Of irregular levels nodes grow with n to the power of {own['nodes'].text}, "
        f"memory {own['memory'].text}, time of a step {own['step'].text}; of the full "
        f"volume {full['nodes'].text}, {full['memory'].text} and {full['step'].text}. "
        "Over the shell's, which is this body's n², irregular nodes grow with n to the "
        f"power of {extra.text}, a logarithm with {logarithm.power:.2f}: this is "
        f"nearer to {'none than to one' if without else 'one than to none'}. "
        f"What convection acts on grows with {surface.text}: the surface alone, in "
        "any structure, so that there the claim needs no logarithm. It is the order "
        "of one step. The largest explicit step goes with n to the power of "
        f"{own['stable step'].text} and {full['stable step'].text}, so that a "
        f"simulated second takes n to the {own['simulated second'].text} and "
        f"{full['simulated second'].text}, of which the thesis says nothing."
    )
    return Verdict.DIFFERENT if holds else Verdict.CONTRADICTED, reason


def _rows(
    surface: _Power, box: _Power, claimed: _Power, beyond: tuple[_Power, _Power]
) -> tuple[Row, ...]:
    law = f"n² log n: {claimed.power:.2f}"
    around = "the box of the body; a flow has at least these cells"
    over, log = "power of n, irregular nodes over the shell's", beyond[1].power
    return (
        Row(over, f"log n: {log:.2f}", beyond[0].text),
        Row("power of n, cells that convection acts on", law, surface.text),
        Row("power of n, cells of a flow around it", "n³: 3", box.text, around),
    )


def _power_table(powers: dict[str, dict[str, _Power]], claimed: _Power) -> Table:
    lines = [
        [name, *(own[what].text for what in _QUANTITIES)]
        for name, own in powers.items()
    ]
    title = "Powers of n, with their standard errors"
    caption = (
        "The thesis: n³ of the full volume, n² log n of irregular levels, which has "
        f"{claimed.power:.2f} over these sizes."
    )
    return Table(("structure", *_QUANTITIES), lines, title, caption)


def _size_table(rows: Rows) -> Table:
    columns = [
        ("high", "{height}"),
        ("structure", "{structure}"),
        ("nodes", "{nodes:,}"),
        ("surface cells", "{surface_cells:,}"),
        ("memory [MB]", lambda row: significant(row["memory_bytes"] / 1e6)),
        ("step [ms]", lambda row: significant(1e3 * row["step_s"])),
        ("stable step [s]", lambda row: significant(row["stable_step_s"])),
        ("simulated second [ms]", lambda row: significant(1e3 * row["second_s"])),
    ]
    return table_of(rows, columns, "Sizes and times", left=(1,))


def _chart(rows: Rows, key: str, title: str, scale: float) -> Chart:
    points = []
    for name in dict.fromkeys(row["structure"] for row in rows):
        for row in (r for r in rows if r["structure"] == name):
            value = scale * row[key]
            text = f"{name}, {row['height']} high: {significant(value)}"
            points.append(point(name, row["height"], value, text))
    if key == "nodes":
        points += _claimed(rows)
    return log_chart(points, "voxels along up", title, f"Chapter 3: {title}")


def _claimed(rows: Rows) -> Any:
    """Irregular nodes, were they the shell's times a logarithm, from the first on."""
    of = lambda name: [row for row in rows if row["structure"] == name]
    law = [row["nodes"] * np.log(row["height"]) for row in of(_SHELL)]
    scale = of(_IRREGULAR)[0]["nodes"] / law[0]
    return [
        point("shell's times log n, as claimed", row["height"], scale * each)
        for row, each in zip(of(_SHELL), law, strict=True)
    ]


EXHIBIT = Exhibit(
    name="section-3-growth",
    title="order of growth of the whole method",
    place="3",
    claims=(),
    measure=_measure,
)
