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


def difference(old_path: Path, new_path: Path) -> tuple[float, float] | str:
    """Maximum and RMS difference of two `solution.npz` [K], or why there is none."""
    with np.load(old_path) as old, np.load(new_path) as new:
        times = [np.asarray(solution["times"]) for solution in (old, new)]
        if times[0].shape != times[1].shape or not np.allclose(times[0], times[1]):
            return "other saved times"
        a, b = (
            solution["surface_temperature"].astype(float) for solution in (old, new)
        )
    if a.shape != b.shape:
        return f"other fragments: {a.shape} and {b.shape}"
    gap = np.abs(a - b)
    return float(gap.max()), float(np.sqrt((gap**2).mean()))


def main() -> int:
    """Print the table."""
    old_folder = Path(sys.argv[1])
    new_folder = Path(sys.argv[2])
    worst = 0.0
    print(f"{'scene':24}{'max [K]':>12}{'RMS [K]':>12}")
    for path in sorted(old_folder.glob("*/solution.npz")):
        name = path.parent.name
        new_path = new_folder / path.parent.name / path.name
        gap = difference(path, new_path) if new_path.is_file() else "missing"
        if isinstance(gap, str):
            print(f"{name:24}  {gap}")
            worst = float("inf")
            continue
        print(f"{name:24}{gap[0]:>12.1e}{gap[1]:>12.1e}")
        worst = max(worst, gap[0])
    return int(worst > LIMIT)


if __name__ == "__main__":
    sys.exit(main())
