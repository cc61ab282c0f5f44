"""5.2 and 6.1: the statue in the sun by structure and by number of levels."""

from itertools import pairwise

import numpy as np

import jaxthermo as jt
from jaxthermo.report.sheet import Tile, sheet

from ...harness.meshes import START
from ..bodies import AXES, HEIGHT, buddha, levels_at
from ..exhibit import Finding, Verdict, exhibit, judged, rms
from ..heated import (
    END,
    QUICK_HEIGHT,
    Heated,
    difference,
    full_volume_sheet,
    heated,
    statue_sheet,
)
from ..irregular import (
    LEVELS,
    hand_of_surface,
    readings,
    regions,
    shares_of_readings,
)
from ..slices import Slice, cover_legend, cover_picture, level_legend, with_frame


_FULL = "full volume"
_SHELL = "single shell"
_TEN = "10 levels"
_HUNDRED = "100 levels"
_NESTED = "irregular levels"
# Of figure 6.1, the last of which are 180 s, and of figure 6.3.
_ITERATIONS = 3600
_ITERATIONS_6_3 = 4000
# Edge of a voxel in slices [px].
_EDGE = 4


def _quarters(last: float) -> tuple[float, ...]:
    return tuple(last * quarter / 4 for quarter in (1, 2, 3, 4))


def _iterations(time: float) -> str:
    return f"{round(_ITERATIONS * time / END)} iterations"


@exhibit("figure-5.2", "5.2, figure 5.2")
def _heat_by_structure(quick: bool) -> Finding:
    """Compare shell, levels and full volume at 30, 60, 90 and 180 s."""
    height = QUICK_HEIGHT if quick else HEIGHT
    times = (30.0, 60.0, 90.0, END)
    names = (_SHELL, _TEN, _NESTED, _FULL)
    runs = {name: heated(name, height, times) for name in names}
    full = runs[_FULL]
    approximations = {name: runs[name] for name in names[:-1]}
    errors = {name: difference(run, full) for name, run in approximations.items()}
    worst = {name: max(error.percent) for name, error in errors.items()}
    falls = all(worst[coarse] > worst[fine] for coarse, fine in pairwise(worst))
    letters = dict(zip(times, "abcd", strict=True))
    return Finding(
        judged(falls, different=True),
        {
            "mesh": buddha().name,
            "height_voxels": height,
            "ten_levels_here": levels_at(height, 10),
            "times_s": times,
            "rms_percent": {name: error.percent for name, error in errors.items()},
            "rms_kelvin": {name: error.kelvin for name, error in errors.items()},
            "worst_rms_percent": worst,
            "falls": falls,
            "rise_over_full_volume": {
                name: {
                    "rise at 180 s": run.final_rise / full.final_rise,
                    "capacity": run.capacity_ratio,
                }
                for name, run in approximations.items()
            },
            "nodes": {name: run.structure.node_count for name, run in runs.items()},
            "steps": {name: int(run.solution.run.steps) for name, run in runs.items()},
        },
        {
            "figure-5.2": statue_sheet(
                runs=runs,
                label=lambda time: f"({letters[time]}) {time:.0f} s",
                views=("front",),
                columns=2,
            ),
            "figure-5.2-difference": full_volume_sheet(
                approximations, full, "Difference after 180 s"
            ),
        },
    )


@exhibit("figure-6.1", "6.1, figure 6.1")
def _heat_by_levels(quick: bool) -> Finding:
    """Compare 1, 10, 100 and all levels through 3600 iterations."""
    height = QUICK_HEIGHT if quick else HEIGHT
    names = (_SHELL, _TEN, _HUNDRED, _FULL)
    runs = {name: heated(name, height, _quarters(END)) for name in names}
    full = runs[_FULL]
    errors = {name: difference(runs[name], full) for name in names[:-1]}
    worst = {name: max(error.percent) for name, error in errors.items()}
    depth = int(np.max(runs[_HUNDRED].structure.nodes().level)) + 1
    falls = worst[_SHELL] > worst[_TEN] > worst[_HUNDRED]
    is_filled = levels_at(height, 100) >= depth
    return Finding(
        judged(falls and not is_filled, different=falls),
        {
            "mesh": buddha().name,
            "height_voxels": height,
            "levels_here": [levels_at(height, 10), levels_at(height, 100)],
            "worst_rms_percent": worst,
            "levels_that_fill": depth,
            "is_filled": is_filled,
            "nodes": {name: run.structure.node_count for name, run in runs.items()},
        },
        {
            "figure-6.1": statue_sheet(runs=runs, label=_iterations),
            "figure-6.1-difference": full_volume_sheet(
                {name: runs[name] for name in (_SHELL, _TEN)},
                full,
                "Difference after 3600 iterations",
            ),
        },
    )


@exhibit("figure-6.2", "6.1, figure 6.2")
def _cracks_and_overlaps(_: bool) -> Finding:
    """Count overlaps and cracks of irregular levels in two readings of the text."""
    grid = buddha().grid(HEIGHT, "dominant_axis")
    # The slice across the thesis' z with the most of the left hand.
    left_hand = regions()["left hand"]
    voxels_of_hand = (grid.solid & left_hand).sum(axis=(0, 2))
    plane = int(voxels_of_hand.argmax())
    frame = _frame_of(left_hand)
    cells = Slice(
        jt.IrregularMultiLevel(grid), axis=AXES["z"], plane=plane + 0.5, edge=_EDGE
    )
    where = f"slice at {(plane + 0.5) * grid.pitch * 1e3:.0f} mm along z"
    tile = Tile(with_frame(cells.pixels, frame), "cells by depth")
    covered = []
    for name, reading in readings().items():
        picture = cover_picture(reading.count[:, plane], grid.solid[:, plane], _EDGE)
        covered.append(
            Tile(with_frame(picture, frame), name, f"{reading.levels} levels")
        )
    return Finding(
        Verdict.DIFFERENT,
        {
            "mesh": buddha().name,
            "thesis_levels": LEVELS,
            "readings": shares_of_readings(),
        },
        {
            "figure-6.2-cells": sheet(
                [tile], level_legend(cells.levels), f"Levels, {where}"
            ),
            "figure-6.2-cover": sheet(
                covered, cover_legend(), f"Cells that cover a voxel, {where}"
            ),
        },
    )


def _frame_of(region: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of a region in a picture of a slice [px]."""
    x, _, z = np.nonzero(region)
    height = region.shape[2]
    left = _EDGE * int(x.min())
    top = _EDGE * int(height - 1 - z.max())
    right = _EDGE * int(x.max() + 1)
    bottom = _EDGE * int(height - z.min())
    return left + 1, top + 1, right - 2, bottom


@exhibit("figure-6.3", "6.1, figure 6.3")
def _irregular_and_full(quick: bool) -> Finding:
    """Compare irregular levels with the full volume through 4000 iterations."""
    height = QUICK_HEIGHT if quick else HEIGHT
    times = _quarters(END * _ITERATIONS_6_3 / _ITERATIONS)
    nested = heated(_NESTED, height, times)
    full = heated(_FULL, height, times)
    error = difference(nested, full)
    by_place = {
        name: _error_in(nested, full, is_there)
        for name, is_there in hand_of_surface(full.structure.voxels).items()
    }
    hand = by_place["left hand"]
    # The sun heats that side most: only what is relative to its own rise is the hand's.
    is_worse = hand["percent"] > 1.5 * by_place["whole surface"]["percent"]
    levels = nested.structure.nodes().level.max() + 1
    runs = {_NESTED: nested, _FULL: full}
    title = f"Difference after {_ITERATIONS_6_3} iterations"
    return Finding(
        judged(is_worse, different=True),
        {
            "mesh": buddha().name,
            "height_voxels": height,
            "levels": levels,
            "hand_capacity": shares_of_readings()["by depth"]["left hand"],
            "hand_is_worse": is_worse,
            "rms_percent": error.percent,
            "rms_kelvin": error.kelvin,
            "at_the_end_K": by_place,
        },
        {
            "figure-6.3": statue_sheet(runs=runs, label=_iterations),
            "figure-6.3-difference": full_volume_sheet({_NESTED: nested}, full, title),
        },
    )


def _error_in(run: Heated, full: Heated, is_there: np.ndarray) -> dict[str, float]:
    """Difference of two runs on a part of the surface at the end [K], and relative."""
    area = full.structure.grid.fragment_area[is_there]
    expected = full.surface[-1][is_there]
    error = run.surface[-1][is_there] - expected
    kelvin = rms(error, area)
    return {
        "mean": float(np.average(error, weights=area)),
        "rms": kelvin,
        "percent": 100 * kelvin / rms(expected - START, area),
    }
