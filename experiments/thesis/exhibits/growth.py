"""Chapter 3: how nodes, memory and time of the whole method grow on a body."""

from collections.abc import Mapping, Sequence

import jax
import numpy as np

import jaxthermo as jt
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart

from ...benchmarks.mixed import Runner, step_spans
from ...harness.line_chart import curve, log_chart
from ...harness.meshes import START, STEEL
from ...harness.power_law import Power, fitted_power
from ..bodies import buddha
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged
from ..resolution import BUILDS, timed_runner
from ..table_6_1 import FULL, IRREGULAR, SHELL


# Voxels along up, at even ratios.
_HEIGHTS = (56, 80, 112, 160, 224, 320)
_QUICK_HEIGHTS = (48, 72, 108)
_REPEATS = 30
_TERMS = (
    jt.Sun((-1.0, 0.0, 0.0), 5000.0),
    jt.Wind((3.0, 0.0, 0.0), START),
)
_QUANTITIES = {
    "nodes": "nodes",
    "memory": "memory_bytes",
    "step": "step_s",
    "stable step": "stable_step_s",
    "simulated second": "second_s",
}


@exhibit("section-3-growth", "3")
def _order_of_growth(quick: bool) -> Finding:
    """Fit powers of the resolution to sizes and times of the statue's structures."""
    heights = np.array(_QUICK_HEIGHTS if quick else _HEIGHTS)
    # Each structure takes long to compile.
    names = (SHELL, IRREGULAR, FULL) if quick else tuple(BUILDS)
    rows = [row for height in heights.tolist() for row in _rows_at(height, names)]
    columns = {
        name: {
            key: _column(rows, name, key)
            for key in (*_QUANTITIES.values(), "surface_cells", "box")
        }
        for name in names
    }
    powers = {
        name: {
            quantity: fitted_power(heights, columns[name][key])
            for quantity, key in _QUANTITIES.items()
        }
        for name in names
    }
    step_ms = {name: 1e3 * columns[name]["step_s"] for name in names}
    nodes = {name: columns[name]["nodes"] for name in names}
    over_shell = fitted_power(heights, nodes[IRREGULAR] / nodes[SHELL])
    # Irregular nodes if they were the shell's times log n, equal at the first height.
    law = nodes[SHELL] * np.log(heights)
    scale = nodes[IRREGULAR][0] / law[0]
    nodes["shell's times log n, as claimed"] = scale * law
    logarithm = fitted_power(heights, np.log(heights))
    surface = fitted_power(heights, columns[FULL]["surface_cells"])
    box = fitted_power(heights, columns[FULL]["box"])
    claimed = fitted_power(heights, heights**2 * np.log(heights))
    return Finding(
        verdict_of_growth(powers[IRREGULAR]),
        {
            "mesh": buddha().name,
            "heights": heights,
            "rows": rows,
            "powers": {
                name: {key: [*power] for key, power in by_quantity.items()}
                for name, by_quantity in powers.items()
            },
            "texts": {
                name: {key: power.text for key, power in by_quantity.items()}
                for name, by_quantity in powers.items()
            },
            "surface_cells": list(surface),
            "claimed": list(claimed),
            "irregular_over_shell": list(over_shell),
            "logarithm": list(logarithm),
            "surface_text": surface.text,
            "box_text": box.text,
            "over_shell_text": over_shell.text,
            "nearer_to_none": is_without_logarithm(over_shell, logarithm),
            "processor": processor(),
        },
        {
            "growth_nodes": _chart(heights, nodes, "nodes"),
            "growth_time": _chart(heights, step_ms, "time of a step [ms]"),
        },
    )


def _column(rows: Sequence[Numbers], structure: str, key: str) -> np.ndarray:
    """Values of a structure over the resolution."""
    values = [row[key] for row in rows if row["structure"] == structure]
    return np.array(values, float)


def verdict_of_growth(powers: Mapping[str, Power]) -> Verdict:
    """Verdict by the powers of irregular levels: are they nearer to n² than to n³?"""
    # By what is counted, since times vary; a logarithm is less than half a power.
    holds = all(powers[quantity].power < 2.5 for quantity in ("nodes", "memory"))
    return judged(False, different=holds)


def is_without_logarithm(over_shell: Power, logarithm: Power) -> bool:
    """True if growth beyond the shell is nearer to none than to a logarithm."""
    return abs(over_shell.power) < abs(over_shell.power - logarithm.power)


def _rows_at(height: int, names: Sequence[str]) -> list[Numbers]:
    """Sizes of the structures at one resolution, and their times, measured in turn."""
    grid = buddha().grid(height)
    runners = {}
    for name in names:
        body = jt.Body(BUILDS[name](grid), STEEL, temperature=START)
        runners[name] = timed_runner(jt.Scene((body,), _TERMS))
    spans = step_spans(runners, _REPEATS)
    rows = []
    for name, runner in runners.items():
        # The fastest: what else the machine does only makes a step slower.
        step = min(spans[name])
        receipt = runner.compiled.receipt
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
    arrays = jax.tree.leaves((runner.compiled.programs, runner.compiled.state))
    return sum(np.asarray(array).nbytes for array in arrays)


def _chart(heights: np.ndarray, values: Mapping[str, np.ndarray], title: str) -> Chart:
    return log_chart(
        points=[
            point
            for name, column in values.items()
            for point in curve(name, heights, column)
        ],
        x_title="voxels along up",
        y_title=title,
        title=f"Chapter 3: {title}",
    )
