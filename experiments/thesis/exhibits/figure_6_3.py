"""Figure 6.3: irregular levels beside the full volume through 4000 iterations."""

from typing import NamedTuple

import numpy as np

from ..bodies import buddha
from ..coverage import measured
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..heated import (
    CHOSEN,
    END,
    HEIGHT,
    QUICK_HEIGHT,
    START,
    Heated,
    difference,
    difference_sheet,
    heated,
    thermal_sheet,
)


_ITERATIONS, _OF_END = 4000, 3600
_TIMES = tuple(END * k / 4 * _ITERATIONS / _OF_END for k in (1, 2, 3, 4))
_NAMES = ("irregular levels", "full volume")


class _Part(NamedTuple):
    """Difference on a part of the surface at the end."""

    mean: float
    """[K]"""
    rms: float
    """[K]"""
    percent: float
    """RMS over that of the part's own rise [%]."""


def _in_part(run: Heated, full: Heated, part: np.ndarray) -> _Part:
    area = full.structure.grid.fragment_area[part]
    found, right = (
        np.asarray(each.solution.surface_temperature)[-1][part] for each in (run, full)
    )
    wrong = found - right
    rms = lambda kelvin: float(np.sqrt(np.average(kelvin**2, weights=area)))
    mean = float(np.average(wrong, weights=area))
    return _Part(mean, rms(wrong), 100 * rms(wrong) / rms(right - START))


def _parts(full: Heated) -> dict[str, np.ndarray]:
    position = full.structure.grid.fragment_position
    low, high = full.structure.grid.mesh.bounds
    above = position[:, 2] > low[2] + 0.84 * (high[2] - low[2])
    left = position[:, 0] > (low[0] + high[0]) / 2
    return {
        "whole surface": np.ones(len(position), bool),
        "left hand": above & left,
        "right hand": above & ~left,
    }


def _measure(quick: bool) -> Finding:
    height = QUICK_HEIGHT if quick else HEIGHT
    runs = {name: heated(name, height, _TIMES) for name in _NAMES}
    nested, full = runs.values()
    found = difference(nested, full)
    wrong = {name: _in_part(nested, full, part) for name, part in _parts(full).items()}
    label = lambda time: f"{round(_OF_END * time / END)} iterations"
    whole = thermal_sheet(runs, range(len(_TIMES)), label, " | ".join(_NAMES))
    title = f"Difference after {_ITERATIONS} iterations"
    less = difference_sheet({_NAMES[0]: nested}, full, -1, title)
    hand, everywhere = wrong["left hand"], wrong["whole surface"]
    capacity = measured()["by depth"]["left hand"]["capacity"]
    # The sun heats that side most: only what is relative to its own rise is the hand's.
    shows = hand.percent > 1.5 * everywhere.percent
    reason = (
        f"Irregular levels follow the full volume to {found.percent[-1]:.1f} % of the "
        f"RMS rise after {_ITERATIONS} iterations. On the left hand they are "
        f"{hand.rms:.2f} K off (RMS), on the whole surface {everywhere.rms:.2f} K; "
        f"over the rise of each part {hand.percent:.1f} and "
        f"{everywhere.percent:.1f} %. "
    )
    if shows:
        reason += (
            f"The hand has the error that the thesis sees: its cells hold "
            f"{capacity:.3f} of the capacity there at 250 voxels."
        )
    else:
        reason += (
            "So the hand is no worse than the rest, though the sun makes it warmest "
            f"and its cells hold {capacity:.3f} of its capacity at 250 voxels."
        )
    rows = (
        *(
            Row(
                f"RMS difference, {round(_OF_END * t / END)} iterations [% of rise]",
                "resembles the full volume",
                found.percent[k],
                f"{found.kelvin[k]:.3g} K",
            )
            for k, t in enumerate(_TIMES)
        ),
        *(
            Row(
                f"RMS difference at the end, {name} [K]",
                "an error" if name == "left hand" else None,
                part.rms,
                f"mean {part.mean:+.3g} K, {part.percent:.2g} % of its rise",
            )
            for name, part in wrong.items()
        ),
    )
    chosen = (
        *buddha().stands_in,
        *CHOSEN,
        (
            "size",
            f"{height} voxels high: {nested.structure.nodes().level.max() + 1} levels "
            "by depth, of the 7 that are allowed",
        ),
    )
    parts = (
        Picture(
            "figure-6.3",
            whole,
            "Each row: one time from three sides; in each picture irregular levels on "
            "the left, the full volume on the right. Iterations are those of 250 "
            "voxels.",
        ),
        Picture("figure-6.3-difference", less, "Irregular levels less full volume."),
    )
    numbers = {
        "height_voxels": height,
        "rms_percent": found.percent,
        "rms_kelvin": found.kelvin,
        "at_the_end_K": {name: part._asdict() for name, part in wrong.items()},
    }
    verdict = Verdict.REPRODUCED if shows else Verdict.DIFFERENT
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-6.3",
    title="irregular levels beside the full volume",
    place="6.1, figure 6.3",
    claims=("C15",),
    measure=_measure,
)
