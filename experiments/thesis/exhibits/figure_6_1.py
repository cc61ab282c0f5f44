"""Figure 6.1: the statue with 1, 10, 100 and all levels, from three sides."""

import numpy as np

from ..bodies import buddha
from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..heated import (
    CHOSEN,
    END,
    HEIGHT,
    QUICK_HEIGHT,
    difference,
    difference_sheet,
    heated,
    levels_at,
    thermal_sheet,
)


_ITERATIONS = 3600
_TIMES = (END / 4, END / 2, 3 * END / 4, END)
_NAMES = ("single shell", "10 levels", "100 levels", "full volume")


def _measure(quick: bool) -> Finding:
    height = QUICK_HEIGHT if quick else HEIGHT
    runs = {name: heated(name, height, _TIMES) for name in _NAMES}
    full = runs[_NAMES[-1]]
    found = {name: difference(runs[name], full) for name in _NAMES[:-1]}
    worst = {name: max(each.percent) for name, each in found.items()}
    depth = int(np.max(runs["100 levels"].structure.nodes().level)) + 1
    deep = {name: levels_at(height, int(name.split()[0])) for name in _NAMES[1:3]}
    label = lambda time: f"{round(_ITERATIONS * time / END)} iterations"
    title = " | ".join(_NAMES)
    whole = thermal_sheet(runs, range(len(_TIMES)), label, title)
    others = {name: runs[name] for name in _NAMES[:2]}
    less = difference_sheet(others, full, -1, "Difference after 3600 iterations")
    falls = worst[_NAMES[0]] > worst[_NAMES[1]] > worst[_NAMES[2]]
    rows = (
        *(
            Row(
                f"largest RMS difference from the full volume, {name} [% of its rise]",
                "falls with the levels",
                each,
                f"{runs[name].structure.node_count:,} of "
                f"{full.structure.node_count:,} voxels",
            )
            for name, each in worst.items()
        ),
        Row("levels that fill the statue", None, depth, f"{height} voxels high"),
    )
    filled = deep["100 levels"] >= depth
    reason = (
        f"The largest difference falls from {worst[_NAMES[0]]:.0f} % (shell) to "
        f"{worst[_NAMES[1]]:.0f} % (10 levels) and {worst[_NAMES[2]]:.0e} % (100), of "
        "the RMS rise: more levels are more precise. "
        + (
            f"But {depth} levels fill this statue: 100 levels are the full volume, "
            "node for node, and cannot differ from it at 100x250x100."
            if filled
            else ""
        )
    )
    chosen = (
        *buddha().stands_in,
        *CHOSEN,
        (
            "size",
            f"{height} voxels high; 10 and 100 levels of 250 voxels are "
            f"{deep['10 levels']} and {deep['100 levels']} here",
        ),
    )
    caption = (
        "Each row: one time from three sides; in each picture from left to right "
        f"{', '.join(_NAMES)}. Iterations are those of 250 voxels."
    )
    parts = (
        Picture("figure-6.1", whole, caption),
        Picture("figure-6.1-difference", less, "Difference from the full volume."),
    )
    numbers = {
        "height_voxels": height,
        "worst_rms_percent": worst,
        "levels_that_fill": depth,
        "nodes": {name: run.structure.node_count for name, run in runs.items()},
    }
    verdict = Verdict.REPRODUCED if falls else Verdict.CONTRADICTED
    if falls and filled:
        verdict = Verdict.DIFFERENT
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-6.1",
    title="the Happy Buddha by number of levels",
    place="6.1, figure 6.1",
    claims=("C13",),
    measure=_measure,
)
