"""Compare the surface temperatures of two sets of runs, scene by scene.

    python tests/tools/compare_solutions.py BEFORE AFTER

Both are folders of run folders, such as `jaxthermo simulate scene.yaml --out
BEFORE/scene` leaves them. For each scene that both have, the table gives the largest
and the root mean square difference over all saved times and fragments [K]. The exit
status is 1 if any scene differs by more than LIMIT, is missing, or has other fragments
or saved times.
"""

import sys
from pathlib import Path

import numpy as np


LIMIT = 2e-3
"""Largest difference that counts as equal [K]."""


def difference(before: Path, after: Path) -> tuple[float, float] | str:
    """Maximum and RMS difference of two `solution.npz` [K], or why there is none."""
    with np.load(before) as old, np.load(after) as new:
        times = [np.asarray(each["times"]) for each in (old, new)]
        if times[0].shape != times[1].shape or not np.allclose(times[0], times[1]):
            return "other saved times"
        a, b = (each["surface_temperature"].astype(float) for each in (old, new))
    if a.shape != b.shape:
        return f"other fragments: {a.shape} and {b.shape}"
    gap = np.abs(a - b)
    return float(gap.max()), float(np.sqrt((gap**2).mean()))


def main() -> int:
    """Print the table."""
    before, after = Path(sys.argv[1]), Path(sys.argv[2])
    worst = 0.0
    print(f"{'scene':24}{'max [K]':>12}{'RMS [K]':>12}")
    for path in sorted(before.glob("*/solution.npz")):
        name, other = path.parent.name, after / path.parent.name / path.name
        found = difference(path, other) if other.is_file() else "missing"
        if isinstance(found, str):
            print(f"{name:24}  {found}")
            worst = float("inf")
            continue
        print(f"{name:24}{found[0]:>12.1e}{found[1]:>12.1e}")
        worst = max(worst, found[0])
    return int(worst > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
