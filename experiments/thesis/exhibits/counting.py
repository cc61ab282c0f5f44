"""6.1 and 6.3: cells of cubes, voxels and times over the resolution, and table 6.1."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import jaxthermo as jt
from jaxthermo.geometry.shapes import box
from jaxthermo.provenance import processor
from jaxthermo.report.chart import Chart
from jaxthermo.structures.partition.assignment import nested_cells, voxel_depth

from ...harness.line_chart import ALONE, CurvePoint, curve, curves, log_chart
from ...harness.power_law import power
from ..bodies import buddha, required_statue
from ..exhibit import Finding, Numbers, Verdict, exhibit, judged
from ..resolution import (
    BUILDS,
    HIGHEST_WITH_ERROR,
    StepTimes,
    counts,
    errors,
    power_of_time,
    step_times,
    time_table,
)
from ..table_6_1 import (
    FULL,
    IRREGULAR,
    SHELL,
    TABLE_HEIGHT,
    TABLE_TIMES,
    TABLE_VOXELS,
    TEN,
)


_BUDDHA = "Happy Buddha"
_PLANCK = "Max Planck"
# Voxels along up.
_HEIGHTS = (50, 100, 150, 200, 250, 350, 450, TABLE_HEIGHT)
_QUICK_COUNTED = _HEIGHTS[:5]
_QUICK_TIMED = _HEIGHTS[:3]
_QUICK_TABLE_HEIGHT = 150
# What is stored, and of what; the thesis says neither.
_CURVES = {
    "shell, of the body's voxels": "shell_of_body",
    "irregular, of the body's voxels": "irregular_of_body",
    "shell, of the box": "shell_of_box",
    "irregular, of the box": "irregular_of_box",
    "shell, texels of the box": "texels_shell_of_box",
    "irregular, texels of the box": "texels_irregular_of_box",
}
# A ratio of times within this factor of the thesis' is equal: other hardware.
_SAME = 1.5


@exhibit("section-6.1-cubes", "6.1")
def _cells_of_cubes(quick: bool) -> Finding:
    """Count the irregular cells of cubes, n² log n or n²."""
    # Powers of 2: cubes of 8 to 256 voxels a side, over which a logarithm grows by 8/3.
    numbers = _count_cubes(range(3, 8) if quick else range(3, 9))
    slope = numbers["slope_of_the_largest"]
    claimed = numbers["slope_claimed_there"]
    is_quadratic = abs(slope - 2) < abs(slope - claimed)
    return Finding(
        judged(False, different=not is_quadratic),
        numbers,
        {"cubes": _cube_chart(numbers["rows"])},
    )


def _count_cubes(powers: Sequence[int]) -> Numbers:
    """Cells of cubes with n = 2^p voxels a side, and which law they follow.

    The level l of a cube has about 6 (n / 2^l)^2 cells, so the sum is 4/3 of the shell
    however many levels there are: n^2. Only if the depth, not the cells, doubled from
    level to level would n^2 log n come out.
    """
    rows = [_count_cells(1 << power) for power in powers]
    side = np.array([row["side_voxels"] for row in rows], float)
    cells = np.array([row["cells"] for row in rows], float)
    log_side = np.log(side)
    law = side**2 * log_side
    slope = power(side[-2:], cells[-2:])
    over_square = cells / side**2
    return {
        "rows": rows,
        "slope_fitted": power(side, cells),
        "slope_of_the_largest": slope,
        "slope_claimed_there": power(side[-2:], law[-2:]),
        "slope_of_the_largest_is_2": abs(slope - 2) <= 0.05,
        "growth_beyond_n2": float(over_square[-1] / over_square[0]),
        "growth_beyond_n2_claimed": float(log_side[-1] / log_side[0]),
    }


def _count_cells(side: int) -> Numbers:
    grid = jt.voxelize(box((1.0, 1.0, 1.0)), 1.0 / side)
    levels = nested_cells(voxel_depth(grid))
    cells = sum(len(level) for level in levels)
    return {
        "side_voxels": side,
        "full_volume": grid.solid_count,
        "levels": len(levels),
        "shell": len(levels[0]),
        "cells": cells,
        "cells_over_shell": cells / len(levels[0]),
        "cells_over_n2": cells / side**2,
        "cells_over_n2_log2_n": cells / (side**2 * np.log2(side)),
    }


def _cube_chart(rows: Sequence[Numbers]) -> Chart:
    side = np.array([row["side_voxels"] for row in rows], float)
    cells = np.array([row["cells"] for row in rows], float)
    law = side**2 * np.log(side)
    counted = {"irregular levels": "cells", "shell": "shell"}
    return log_chart(
        points=[
            *curves(rows, x="side_voxels", y=counted),
            *curve("n³", side, side**3),
            *curve("n² log n, as claimed", side, cells[-1] * law / law[-1]),
        ],
        x_title="voxels along an edge",
        y_title="cells",
        title="C05: cells of a cube of side n",
    )


@exhibit("figure-6.8", "6.3, figure 6.8")
def _step_times_of_the_buddha(quick: bool) -> Finding:
    """Time steps of the Happy Buddha's structures over the resolution."""
    return _step_times(_BUDDHA, quick)


@exhibit("figure-6.10", "6.3, figure 6.10")
def _step_times_of_the_head(quick: bool) -> Finding:
    """Time steps of Max Planck's structures over the resolution."""
    return _step_times(_PLANCK, quick)


def _step_times(name: str, quick: bool) -> Finding:
    required_statue(name)
    heights = _QUICK_TIMED if quick else _HEIGHTS
    times = [step_times(name, height) for height in heights]
    if quick:
        with_error = [_QUICK_TIMED[-1]]
    else:
        with_error = [height for height in heights if height <= HIGHEST_WITH_ERROR]
    error_percent = {height: errors(name, height) for height in with_error}
    last = times[-1].times_faster
    shell = last[SHELL].median
    irregular = last[IRREGULAR].median
    return Finding(
        judged(shell > irregular > 1),
        {
            "times": times,
            "error_percent": error_percent,
            "power_of_n": {
                structure: power_of_time(times, structure) for structure in BUILDS
            },
            "highest": heights[-1],
            "shell_times_faster": shell,
            "irregular_times_faster": irregular,
            "processor": processor(),
            "table": time_table(times, error_percent),
        },
        {name.lower().replace(" ", "_"): _time_chart(name, times)},
    )


def _time_chart(name: str, times: Sequence[StepTimes]) -> Chart:
    points = []
    for structure in BUILDS:
        for row in times:
            step = 1e3 * row.median(structure)
            points.append(CurvePoint(structure, x=row.height, y=step))
    if name == _BUDDHA:
        for structure, seconds in TABLE_TIMES.items():
            points += curve(structure, [TABLE_HEIGHT], [1e3 * seconds], marks=ALONE)
    return log_chart(
        points=points,
        x_title="voxels along up",
        y_title="time of a step of conduction [ms]",
        title=f"{name}: time of a step",
    )


@exhibit("figure-6.9", "6.3, figure 6.9")
def _voxels_of_the_buddha(quick: bool) -> Finding:
    """Count what the Happy Buddha's structures store, over the resolution."""
    numbers, picture = _stored_voxels(_BUDDHA, quick)
    return Finding(Verdict.DIFFERENT, numbers, {"compression_happy_buddha": picture})


@exhibit("figure-6.11", "6.3, figure 6.11")
def _voxels_of_the_head(quick: bool) -> Finding:
    """Count what Max Planck's structures store, and compare both bodies."""
    numbers, picture = _stored_voxels(_PLANCK, quick)
    bodies = _compared_bodies(numbers["highest"])
    statue, head, smaller = bodies.values()
    head_layers = sum(head["layers_packed"])
    statue_layers = sum(statue["layers_packed"])
    has_fewer = smaller["shell"] < statue["shell"]
    is_simpler = head_layers < statue_layers
    comparison = {
        "head_layers": head_layers,
        "statue_layers": statue_layers,
        "smaller_shell": smaller["shell"],
        "head_shell": head["shell"],
        "statue_shell": statue["shell"],
        "full_volume_ratio": head["body"] / statue["body"],
    }
    return Finding(
        Verdict.DIFFERENT,
        {**numbers, "compared": bodies, "comparison": comparison},
        {"compression_max_planck": picture},
        {"C26": judged(False, different=has_fewer and is_simpler)},
    )


def _stored_voxels(name: str, quick: bool) -> tuple[Numbers, Chart]:
    required_statue(name)
    heights = _QUICK_COUNTED if quick else _HEIGHTS
    rows = [counts(name, height) for height in heights]
    within = [
        row["height_voxels"] for row in rows if 0.10 <= row["irregular_of_body"] <= 0.25
    ]
    numbers = {
        "rows": rows,
        "first": rows[0],
        "last": rows[-1],
        "highest": heights[-1],
        "between_10_and_25_percent": [str(height) for height in within],
    }
    return numbers, _compression_chart(name, rows)


def _compression_chart(name: str, rows: Sequence[Mapping[str, Any]]) -> Chart:
    return log_chart(
        points=curves(rows, x="height_voxels", y=_CURVES),
        x_title="voxels along up",
        y_title="stored, as a fraction",
        title=f"{name}: compression over the resolution",
    )


_COMPARED = (
    "box",
    "body",
    "layers_peeled",
    "layers_packed",
    "shell",
    "irregular",
    "texels_shell",
)
"""Counts by which two bodies are compared."""


def _compared_bodies(height: int) -> dict[str, Numbers]:
    """Both bodies as high, and Max Planck in a box of as many cells."""
    statue = counts(_BUDDHA, height)
    head = counts(_PLANCK, height)
    smaller_height = round(height * (statue["box"] / head["box"]) ** (1 / 3))
    smaller_name = f"{_PLANCK}, {smaller_height} high: as many cells"
    bodies = {
        f"{_BUDDHA}, {height} high": statue,
        f"{_PLANCK}, {height} high": head,
        smaller_name: counts(_PLANCK, smaller_height),
    }
    return {name: {key: row[key] for key in _COMPARED} for name, row in bodies.items()}


@exhibit("table-6.1", "6.3, table 6.1")
def _voxels_and_times(quick: bool) -> Finding:
    """Count voxels and time steps of the four structures of the Happy Buddha."""
    name = buddha().name
    height = _QUICK_TABLE_HEIGHT if quick else TABLE_HEIGHT
    count = counts(name, height)
    times = step_times(name, height)
    error_height = min(height, HIGHEST_WITH_ERROR)
    error_percent = errors(name, error_height)
    faster = {name: ratio.median for name, ratio in times.times_faster.items()}
    thesis = {
        structure: TABLE_TIMES[FULL] / TABLE_TIMES[structure] for structure in BUILDS
    }
    is_near = {
        structure: thesis[structure] / _SAME
        <= faster[structure]
        <= thesis[structure] * _SAME
        for structure in BUILDS
    }
    is_ordered = faster[SHELL] > faster[IRREGULAR] > 1
    in_order = judged(False, different=is_ordered)
    both_near = is_near[SHELL] and is_near[IRREGULAR]
    return Finding(
        in_order,
        {
            "mesh": name,
            "height": height,
            "error_height": error_height,
            "counts": count,
            "times": times,
            "error_percent": error_percent,
            "faster": faster,
            "faster_thesis": thesis,
            "is_ordered": is_ordered,
            "lattice": " x ".join(map(str, count["lattice_shape"])),
            "processor": processor(),
            "table": _table_6_1(count, times, error_percent),
            "texels": _texel_counts(count),
        },
        claims={
            "C07": judged(is_near[TEN], different=True),
            "C08": Verdict.REPRODUCED if both_near else in_order,
        },
    )


def _table_6_1(
    count: Numbers, times: StepTimes, error_percent: Mapping[str, float]
) -> list[Numbers]:
    rows: list[Numbers] = []
    for structure in BUILDS:
        step = times.median(structure)
        nodes = times.nodes[structure]
        rows.append(
            {
                "structure": structure,
                "voxels, thesis": f"{TABLE_VOXELS[structure]:.2g}",
                "occupied here": nodes,
                "of the body": nodes / count["body"],
                "time, thesis_ms": 1e3 * TABLE_TIMES[structure],
                "time of a step here_ms": 1e3 * step,
                "of a node_ns": 1e9 * step / nodes,
                "times faster": times.times_faster[structure].median,
                "error_percent": error_percent.get(structure, 0.0),
            }
        )
    return rows


def _texel_counts(count: Numbers) -> dict[str, int]:
    """Counts that the shell's number of table 6.1 may be."""
    layers = "/".join(map(str, count["layers_packed"]))
    # Layers along the file's x, y, z: y is up, 225 x 550 x 225.
    thesis = {
        f"thesis: layers {name}": 225 * 550 * (x + z) + 225 * 225 * y
        for name, (x, y, z) in {
            "18/20/8, as peeled (figure 4.3)": (18, 20, 8),
            "8/11/6, packed (figure 4.6)": (8, 11, 6),
            "8/14/8 (6.3)": (8, 14, 8),
        }.items()
    }
    return {
        **thesis,
        f"here: layers {layers} along x, y, z (z is up), packed": count["texels_shell"],
        "of these occupied, each piece of surface once": count["texels_occupied"],
        "surface voxels of the shell": count["shell"],
        "surface cells with all their crossings": count["fragments"],
        "thesis: voxel number of the shell": int(TABLE_VOXELS[SHELL]),
    }
