"""Where the error is: by how thick the body is under each piece of its surface."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxthermo.voxels.grid import VoxelGrid

from .record import Row
from .study import Study


def thickness(grid: VoxelGrid) -> Int[np.ndarray, " s"]:
    """Solid voxels in a row under each fragment, along its dominant axis."""
    found = np.zeros(len(grid.fragment_axis), np.int64)
    for axis in range(3):
        here = grid.fragment_axis == axis
        run = _run_length(np.moveaxis(grid.solid, axis, -1))
        voxel = np.moveaxis(grid.fragment_voxel[here], 1, 0)
        x, y, z = (*np.delete(voxel, axis, axis=0), voxel[axis])
        found[here] = run[x, y, z]
    return found


def _run_length(solid: Bool[np.ndarray, "a b c"]) -> Int[np.ndarray, "a b c"]:
    """Of the solid voxels in a row along the last axis that each one is among."""
    count = solid.shape[-1]
    index = np.arange(count, dtype=np.int32)
    before = np.maximum.accumulate(np.where(solid, -1, index), axis=-1)
    backward = np.where(solid, count, index)[..., ::-1]
    after = np.minimum.accumulate(backward, axis=-1)[..., ::-1]
    return np.where(solid, after - before - 1, 0).astype(np.int32)


def classes(thick: Int[np.ndarray, " s"]) -> list[tuple[int, int]]:
    """Ranges of thickness that double: 1, 2, 3-4, 5-8, ... up to the thickest."""
    ranges, low, high = [], 1, 1
    while low <= int(thick.max(initial=0)):
        ranges.append((low, high))
        low, high = high + 1, 2 * high
    return ranges


class LocalError:
    """Differences from the reference on parts of one body's surface."""

    def __init__(self, grid: VoxelGrid):
        """Find how thick the body is under each fragment."""
        self.thick = thickness(grid)
        self.share = grid.fragment_area / grid.fragment_area.sum()

    def part(
        self, difference: Float[np.ndarray, " s"], low: int, high: float | int
    ) -> dict[str, float] | None:
        """RMS [K] and share of the area where `low` to `high` voxels are in a row."""
        here = (self.thick >= low) & (self.thick <= high)
        share = float(self.share[here].sum())
        if share == 0:
            return None
        square = float((self.share[here] * difference[here].astype(float) ** 2).sum())
        return {"rms_kelvin": (square / share) ** 0.5, "area_share": share}

    def by_class(self, difference: Float[np.ndarray, " s"]) -> list[dict[str, Any]]:
        """The same for each class of thickness that the body has."""
        found = []
        for low, high in classes(self.thick):
            part = self.part(difference, low, high)
            if part is not None:
                found.append({"voxels": [low, high], **part})
        return found


def local_rows(study: Study, rows: list[Row]) -> list[Row]:
    """The error by thickness of each row that the pictures show, at their time."""
    shown = study.config.picture
    expected = study.shown_reference
    local = LocalError(study.subject.grid)
    found = []
    for row in rows:
        if "refused" in row or row["load"] != shown.load:
            continue
        difference = study.record.arrays_of(row)["surface"] - expected
        found.append(
            {
                "label": row["label"],
                "time_s": shown.time,
                "parts": local.by_class(difference),
                "rms_kelvin": _filled_and_hollow(local, difference, row),
            }
        )
    return found


def _filled_and_hollow(
    local: LocalError, difference: Float[np.ndarray, " s"], row: Row
) -> dict[str, float | None]:
    """RMS [K] where levels from both sides meet in the middle, and where not."""
    options = row["structure"]["options"]
    if row["kind"] != "multi_level" or options["hollow"] != "empty":
        return {"filled": None, "hollow": None}
    reach = 2 * int(options["levels"])
    parts = {
        "filled": local.part(difference, 1, reach),
        "hollow": local.part(difference, reach + 1, np.inf),
    }
    return {k: None if p is None else p["rms_kelvin"] for k, p in parts.items()}
