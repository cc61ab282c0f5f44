"""Further studies: number of levels, equilibrium, error by thickness of the body."""

import math
from collections.abc import Iterator
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxthermo.physics.radiation.source import Sun
from jaxthermo.physics.time_varying import Until
from jaxthermo.scene.scene import Scene
from jaxthermo.structures.kinds.groups import MultiLevel
from jaxthermo.voxels.grid import VoxelGrid

from ..harness.record import Arrays, Row
from .cases import NEAREST, Case, Subject, all_cases, load_subject
from .config import FULL, EquilibriumConfig, LevelsConfig
from .measure import build_timed, error_row, finish, prepare
from .study import Study


ALL = "all"


def level_rows(study: Study, sweep: LevelsConfig) -> Iterator[Row]:
    """One row for each number of levels, of the load that the pictures show."""
    load = study.config.picture.load
    for hollow in sweep.hollow:
        for count in (*sweep.counts, ALL):
            identity = {**study.identity, "load": load, "levels": [count, hollow]}
            head = {
                "what": "levels",
                "body": study.body.name,
                "load": load,
                "hollow": hollow,
                "asked_for": count,
            }
            make = partial(_level_row, study, count, hollow, load)
            yield study.record.once(identity, head, make)


def _level_row(
    study: Study, count: int | str, hollow: str, load: str
) -> tuple[Row, Arrays]:
    """At the full volume's own step, so that all levels are the full volume."""
    subject, full = study.subject, study.baseline(load)
    # No body is deeper than its box is wide.
    levels = count if isinstance(count, int) else max(subject.grid.solid.shape)
    structure, _ = build_timed(
        lambda: MultiLevel(subject.grid, levels=levels, hollow=hollow)
    )
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


TIME_CONSTANTS = 40.0
"""Duration in time constants of a bar of the body's height, H^2 / (pi^2 alpha)."""


class Equilibrium:
    """One body of the comparison, coarse, insulated, in float64."""

    def __init__(self, study: Study, config: EquilibriumConfig):
        """Nothing is loaded or run yet."""
        self.study = study
        self.config = config

    @cached_property
    def subject(self) -> Subject:
        """The body at the pitch of this claim."""
        study = self.study
        return load_subject(study.body, study.config, self.config.voxels_high)

    def rows(self) -> Iterator[Row]:
        """One row for each structure of the comparison."""
        study, high = self.study, self.config.voxels_high
        for case in all_cases(study.config):
            identity = {**study.identity, "equilibrium": [high, case.identity]}
            head = {
                "what": "equilibrium",
                "body": study.body.name,
                "label": case.label,
            }
            yield study.record.once(identity, head, partial(self._row, case))

    @property
    def end(self) -> float:
        """When the body is even to rounding, or nearly so for a slow structure [s]."""
        subject = self.subject
        height = float(np.ptp(subject.grid.mesh.bounds[:, 2]))
        diffusivity = float(subject.material.diffusivity)
        return TIME_CONSTANTS * height**2 / (math.pi**2 * diffusivity)

    def _scene(self, case: Case) -> Scene:
        config, subject = self.study.config, self.subject
        structure, _ = build_timed(lambda: case.make(subject.grid))
        nearest = case.label == FULL
        body = subject.body(structure, NEAREST if nearest else self.study.surface_map)
        sun = subject.sun(config.picture.load)
        hot = Until(config.sun.irradiance, config.sun.until or config.time.end)
        heat = Sun(direction=sun.direction, irradiance=hot)
        return Scene((body,), (heat,), dtype="float64")

    def _row(self, case: Case) -> tuple[Row, Arrays]:
        scene, end = self._scene(case), self.end
        solution = finish(prepare(scene, end, (end,)))
        surface = np.asarray(solution.surface_temperature[0])
        row = {
            "nodes": solution.receipt.nodes,
            "capacity_ratio": solution.receipt.capacity_ratios[0],
            "steps": solution.run.steps,
            "end_s": end,
            "mean_K": float(solution.mean_temperature[0, 0]),
            "rise_K": float(solution.mean_temperature[0, 0]) - self._start,
            "surface_range_K": float(surface.max() - surface.min()),
        }
        return row, {}

    @property
    def _start(self) -> float:
        return float(self.study.config.temperature)


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
    """Length of the run of solid voxels along the last axis around each voxel."""
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
        self.fraction = grid.fragment_area / grid.fragment_area.sum()

    def part(
        self, difference: Float[np.ndarray, " s"], low: int, high: float | int
    ) -> dict[str, float] | None:
        """RMS [K] and share of the area where `low` to `high` voxels are in a row."""
        here = (self.thick >= low) & (self.thick <= high)
        fraction = float(self.fraction[here].sum())
        if fraction == 0:
            return None
        square = float(
            (self.fraction[here] * difference[here].astype(float) ** 2).sum()
        )
        return {"rms_kelvin": (square / fraction) ** 0.5, "area_share": fraction}

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
    filled_depth = 2 * int(options["levels"])
    parts = {
        "filled": local.part(difference, 1, filled_depth),
        "hollow": local.part(difference, filled_depth + 1, np.inf),
    }
    return {k: None if p is None else p["rms_kelvin"] for k, p in parts.items()}
