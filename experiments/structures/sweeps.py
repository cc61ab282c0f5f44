"""Further studies: number of levels, equilibrium, error by thickness of the body."""

import math
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

import jaxthermo as jt

from ..harness.record import Arrays, Row
from .config import FULL, LevelsConfig
from .measure import build_timed, error_row, finish, prepare
from .study import NEAREST, Case, Study, Subject, all_cases, rays


# As many levels as there are.
ALL = "all"


def level_rows(study: Study, sweep: LevelsConfig) -> Iterator[Row]:
    """One row for each number of levels, of the load that the pictures show."""
    load = study.config.picture.load
    for hollow in sweep.hollow:
        for count in (*sweep.counts, ALL):
            identity = {**study.identity, "load": load, "levels": [count, hollow]}
            head = {"what": "levels", "body": study.body.name, "load": load}
            head |= {"hollow": hollow, "asked_for": count}
            make = partial(_level_row, study, count, hollow, load)
            yield study.record.once(identity, head, make)


def _level_row(
    study: Study, count: int | str, hollow: str, load: str
) -> tuple[Row, Arrays]:
    # At the full volume's own step, so that all levels are the full volume.
    subject, full = study.subject, study.baseline(load)
    # No body is deeper than its box is wide.
    levels = count if isinstance(count, int) else max(subject.grid.solid.shape)
    make = lambda: jt.MultiLevel(subject.grid, levels=levels, hollow=hollow)
    structure, _ = build_timed(make)
    scene = subject.scene(structure, study.surface_map, load)
    span = study.config.time
    step = full.solution.run.stable_step
    solution = finish(prepare(scene, span.end, span.save_times, step))
    row = {
        "levels": int(structure.nodes().level.max()) + 1,
        "nodes": structure.node_count,
        "capacity_ratio": structure.capacity_ratio,
        "error": error_row(solution, study.reference(load)),
        "from_full_volume_at_the_same_step": error_row(solution, full.solution),
    }
    return row, {}


# Duration in time constants of a bar of the body's height, H^2 / (pi^2 alpha): e^-40 is
# below float64's digits, with room for structures that even out more slowly.
_TIME_CONSTANTS = 40.0


def equilibrium_rows(study: Study, voxels_high: int) -> Iterator[Row]:
    """One row for each structure of the comparison: coarse, insulated, in float64."""
    # Loaded once, and only if a row is missing.
    subject = cache(lambda: Subject.load(study.body, study.config, voxels_high))
    for case in all_cases(study.config):
        identity = {**study.identity, "equilibrium": [voxels_high, case.identity]}
        head = {"what": "equilibrium", "body": study.body.name, "label": case.label}
        make = partial(_even_row, study, subject, case)
        yield study.record.once(identity, head, make)


def _even_row(
    study: Study, load: Callable[[], Subject], case: Case
) -> tuple[Row, Arrays]:
    config, subject = study.config, load()
    structure, _ = build_timed(lambda: case.make(subject.grid))
    surface_map = NEAREST if case.label == FULL else study.surface_map
    body = subject.body(structure, surface_map)
    # The sun sets at the latest where the comparison ends; then nothing is exchanged.
    hot = jt.Until(config.sun.irradiance, config.sun.until or config.time.end)
    sun = jt.Sun(rays(subject.grid.mesh.axes, config.picture.load), irradiance=hot)
    height = float(np.ptp(subject.grid.mesh.bounds[:, 2]))
    diffusivity = float(config.material.build().diffusivity)
    end = _TIME_CONSTANTS * height**2 / (math.pi**2 * diffusivity)
    solution = finish(prepare(jt.Scene((body,), (sun,), dtype="float64"), end, (end,)))
    surface = np.asarray(solution.surface_temperature[0])
    mean = float(solution.mean_temperature[0, 0])
    row = {
        "nodes": solution.receipt.nodes,
        "capacity_ratio": solution.receipt.capacity_ratios[0],
        "steps": solution.run.steps,
        "end_s": end,
        "mean_K": mean,
        "rise_K": mean - float(config.temperature),
        "surface_range_K": float(surface.max() - surface.min()),
    }
    return row, {}


def _thickness(grid: jt.VoxelGrid) -> Int[np.ndarray, " s"]:
    # Solid voxels in a row under each fragment, along its dominant axis.
    found = np.zeros(len(grid.fragment_axis), np.int64)
    for axis in range(3):
        here = grid.fragment_axis == axis
        run = _run_length(np.moveaxis(grid.solid, axis, -1))
        voxel = np.moveaxis(grid.fragment_voxel[here], 1, 0)
        x, y, z = (*np.delete(voxel, axis, axis=0), voxel[axis])
        found[here] = run[x, y, z]
    return found


def _run_length(solid: Bool[np.ndarray, "a b c"]) -> Int[np.ndarray, "a b c"]:
    # Along the last axis, around each voxel: the distance between the last empty voxel
    # before it and the first one after it.
    count = solid.shape[-1]
    index = np.arange(count, dtype=np.int32)
    before = np.maximum.accumulate(np.where(solid, -1, index), axis=-1)
    backward = np.where(solid, count, index)[..., ::-1]
    after = np.minimum.accumulate(backward, axis=-1)[..., ::-1]
    return np.where(solid, after - before - 1, 0).astype(np.int32)


def _classes(thick: Int[np.ndarray, " s"]) -> list[tuple[int, int]]:
    # Ranges that double, 1, 2, 3-4, 5-8, ... up to the thickest: thin parts differ.
    ranges, low, high = [], 1, 1
    while low <= int(thick.max(initial=0)):
        ranges.append((low, high))
        low, high = high + 1, 2 * high
    return ranges


class _LocalError:
    # Differences from the reference on parts of one body's surface.
    def __init__(self, grid: jt.VoxelGrid):
        self.thick = _thickness(grid)
        self.fraction = grid.fragment_area / grid.fragment_area.sum()

    def part(
        self, difference: Float[np.ndarray, " s"], low: int, high: float | int
    ) -> dict[str, float] | None:
        # RMS [K] and share of the area where `low` to `high` voxels are in a row.
        here = (self.thick >= low) & (self.thick <= high)
        fraction = float(self.fraction[here].sum())
        if fraction == 0:
            return None
        square = float(self.fraction[here] @ difference[here].astype(float) ** 2)
        return {"rms_kelvin": (square / fraction) ** 0.5, "area_share": fraction}

    def by_class(self, difference: Float[np.ndarray, " s"]) -> list[dict[str, Any]]:
        ranges = _classes(self.thick)
        parts = [(r, self.part(difference, *r)) for r in ranges]
        # A doubled range may hold no fragment of a body with parts of few sizes.
        return [{"voxels": [*r], **part} for r, part in parts if part is not None]


def local_rows(study: Study, rows: list[Row]) -> list[Row]:
    """The error by thickness of each row that the pictures show, at their time."""
    shown, expected = study.config.picture, study.shown_reference
    local, found = _LocalError(study.subject.grid), []
    for row in rows:
        if "refused" in row or row["load"] != shown.load:
            continue
        difference = study.record.arrays_of(row)["surface"] - expected
        kelvin = _filled_and_hollow(local, difference, row)
        head = {"label": row["label"], "time_s": shown.time}
        parts = local.by_class(difference)
        found.append({**head, "parts": parts, "rms_kelvin": kelvin})
    return found


def _filled_and_hollow(
    local: _LocalError, difference: Float[np.ndarray, " s"], row: Row
) -> dict[str, float | None]:
    # RMS [K] where levels from both sides meet in the middle, and where not.
    options = row["structure"]["options"]
    if row["kind"] != "multi_level" or options["hollow"] != "empty":
        return {"filled": None, "hollow": None}
    filled_depth = 2 * int(options["levels"])
    parts = {
        "filled": local.part(difference, 1, filled_depth),
        "hollow": local.part(difference, filled_depth + 1, np.inf),
    }
    return {k: None if p is None else p["rms_kelvin"] for k, p in parts.items()}
