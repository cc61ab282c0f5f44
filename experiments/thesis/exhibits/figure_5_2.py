"""Figure 5.2: the statue as shell, levels and full volume at 30, 60, 90 and 180 s."""

from itertools import pairwise

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


_TIMES = (30.0, 60.0, 90.0, END)
_LETTERS = dict(zip(_TIMES, "abcd", strict=True))
_FULL, _SHELL, _LEVELS, _NESTED = (
    "full volume",
    "single shell",
    "10 levels",
    "irregular levels",
)


def _measure(quick: bool) -> Finding:
    height = QUICK_HEIGHT if quick else HEIGHT
    names = (_SHELL, _LEVELS, _NESTED, _FULL)
    runs = {name: heated(name, height, _TIMES) for name in names}
    full = runs[_FULL]
    found = {name: difference(run, full) for name, run in runs.items() if name != _FULL}
    label = lambda time: f"({_LETTERS[time]}) {time:.0f} s"
    title = " | ".join(names)
    whole = thermal_sheet(runs, range(len(_TIMES)), label, title, ("front",), 2)
    others = {name: run for name, run in runs.items() if name != _FULL}
    less = difference_sheet(others, full, -1, "Difference after 180 s")
    worst = {name: max(e.percent) for name, e in found.items()}
    what = "RMS difference from the full volume"
    rows = [
        Row(
            f"{what}, {name}, {time:.0f} s [% of its rise]",
            "distorted" if name == _SHELL else "close, distinct in detail",
            found[name].percent[k],
            f"{found[name].kelvin[k]:.3g} K",
        )
        for name in found
        for k, time in enumerate(_TIMES)
    ]
    rows += [
        Row(
            f"mean rise at 180 s over the full volume's, {name}",
            "close to 1",
            run.rise(-1) / full.rise(-1),
            f"capacity {float(run.solution.receipt.capacity_ratios[0]):.4f}",
        )
        for name, run in others.items()
    ]
    falls = all(worst[a] > worst[b] for a, b in pairwise((_SHELL, _LEVELS, _NESTED)))
    deep = levels_at(height, 10)
    reason = (
        f"At the worst time the shell is {worst[_SHELL]:.0f} % off the full volume, "
        f"{deep} levels {worst[_LEVELS]:.0f} % and irregular levels "
        f"{worst[_NESTED]:.1f} % (RMS, of the RMS rise). The shell spreads the heat of "
        "thin arms and folds over the whole capacity, and leads it round the middle; "
        "levels over a hole hold "
        f"{runs[_LEVELS].solution.receipt.capacity_ratios[0]:.0%} of the capacity and "
        "end too warm. "
        + (
            "The order is the thesis' one."
            if falls
            else f"{deep} levels are the closest here: in a statue this coarse they "
            "nearly fill it."
        )
    )
    chosen = (
        *buddha().stands_in,
        *CHOSEN,
        ("size", f"{height} voxels high; 10 levels of 250 voxels are {deep} here"),
        ("middle", "caption: multi-level; text: irregular multi-level; both are shown"),
    )
    caption = (
        f"From left to right {', '.join(names)}; (a) to (d) at 30, 60, 90 and 180 s, "
        "all on one scale."
    )
    parts = (
        Picture("figure-5.2", whole, caption),
        Picture(
            "figure-5.2-difference",
            less,
            "What each structure is warmer or colder than the full volume after 180 s.",
        ),
    )
    numbers = {
        "height_voxels": height,
        "times_s": list(_TIMES),
        "rms_percent": {name: each.percent for name, each in found.items()},
        "nodes": {n: r.structure.node_count for n, r in runs.items()},
        "steps": {n: int(r.solution.run.steps) for n, r in runs.items()},
    }
    verdict = Verdict.REPRODUCED if falls else Verdict.DIFFERENT
    return Finding(verdict, reason, tuple(rows), {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-5.2",
    title="heat in the Happy Buddha by structure",
    place="5.2, figure 5.2",
    claims=("C12",),
    measure=_measure,
)
