"""One body: the full volume, and every structure beside it, under every load."""

from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxthermo.errors import InputError
from jaxthermo.integrate.run.solution import Solution
from jaxthermo.integrate.run.solution_file import StoredSolution
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.structures.report import structure_report

from ..harness.record import Arrays, Record, Row
from .cases import NEAREST, Case, Subject, case_loads, load_subject, make_map
from .config import (
    FULL,
    ComparedBody,
    ComparisonConfig,
    body_identity,
    common_identity,
)
from .measure import (
    Baseline,
    Scenery,
    Timed,
    build_timed,
    error_row,
    frame_error,
    ratio_row,
    run_reference,
    run_timed,
    scenery,
    surface_at,
)


class Study:
    """Data that all rows of one body use; computed once, when first needed."""

    def __init__(self, body: ComparedBody, config: ComparisonConfig, record: Record):
        """Nothing is loaded or run yet."""
        self.body = body
        self.config = config
        self.record = record
        self.surface_map = make_map(config.surface_map)
        self._baselines: dict[str, Baseline] = {}
        self._references: dict[str, StoredSolution] = {}

    @cached_property
    def subject(self) -> Subject:
        """The body, voxelized."""
        return load_subject(self.body, self.config, self.config.voxels_high)

    @cached_property
    def scenery(self) -> Scenery:
        """The body as the camera sees it."""
        return scenery(self.config.camera, (self.subject.surface,))

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Inputs of all rows of this body, as plain values."""
        return {
            "common": common_identity(self.config),
            "body": body_identity(self.body),
        }

    def baseline(self, load: str) -> Baseline:
        """The full volume at its own stable step, timed in this process.

        Ratios are of times measured in one process, also after an interruption.
        """
        if load not in self._baselines:
            full = FullVolume(self.subject.grid)
            scene = self.subject.scene(full, NEAREST, load)
            solution, timing, cost = run_timed(scene, self.config)
            work = self.subject.lattice_voxels * cost["steps"]
            cost["lattice_voxels_per_s"] = work / timing.median
            self._baselines[load] = Baseline(solution, timing, cost)
        return self._baselines[load]

    def reference(self, load: str) -> StoredSolution:
        """The reference of all errors: the full volume at a fraction of its step."""
        if load not in self._references:
            row = self.reference_row(load)
            if "refused" in row:
                raise InputError(f"the reference: {row['refused']}")
            kept = self.record.arrays_of(row)
            self._references[load] = StoredSolution(
                jnp.asarray(kept["times"]),
                jnp.asarray(kept["surface_temperature"]),
                (self.subject.surface,),
            )
        return self._references[load]

    def reference_rows(self) -> Iterator[Row]:
        """The reference rows, one for each load."""
        return map(self.reference_row, self.config.loads)

    def reference_row(self, load: str) -> Row:
        """Run data of a load's reference; its surface is in the row's arrays."""
        return self.record.once(
            {**self.identity, "load": load, "reference": True},
            {"what": "reference", "body": self.body.name, "load": load},
            partial(self._reference, load),
        )

    @property
    def shown_reference(self) -> Float[np.ndarray, " s"]:
        """The reference's surface at the time and load of the pictures [K]."""
        shown = self.config.picture
        return surface_at(self.reference(shown.load), shown.time)

    def _reference(self, load: str) -> tuple[Row, Arrays]:
        stable_step = self.baseline(load).solution.run.stable_step
        scene = self.subject.scene(FullVolume(self.subject.grid), NEAREST, load)
        solution = run_reference(scene, self.config, stable_step)
        return {"steps": solution.run.steps, "dt_s": solution.run.dt}, {
            "times": np.asarray(solution.times),
            "surface_temperature": np.asarray(solution.surface_temperature),
        }

    def check(self) -> None:
        """Voxelize the body and build the scenes, to report mistakes before any run.

        Raises:
            InputError: for terms that do not fit the body or one another, or a camera
                that does not see it.
        """
        _ = self.scenery
        full = FullVolume(self.subject.grid)
        for load in self.config.loads:
            self.subject.scene(full, NEAREST, load)

    def rows(self, case: Case) -> Iterator[Row]:
        """One row a load; the structure is built if any of them is missing."""
        built = cache(partial(self._built, case))
        for load in case_loads(case, self.config):
            head = {
                "what": "structure",
                "body": self.body.name,
                "load": load,
                "label": case.label,
                "kind": case.kind,
            }
            identity = {**self.identity, "load": load, "case": case.identity}
            make = self._full_row if case.label == FULL else self._row
            yield self.record.once(identity, head, partial(make, load, built))

    def _built(self, case: Case) -> Timed:
        grid = self.subject.grid
        return build_timed(lambda: case.make(grid))

    def _row(self, load: str, built: Callable[[], Timed]) -> tuple[Row, Arrays]:
        # First, since it may be refused.
        structure, build_time = built()
        full = self.baseline(load)
        scene = self.subject.scene(structure, self.surface_map, load)
        solution, timing, cost = run_timed(scene, self.config)
        row = {
            "build_time_s": build_time,
            **cost,
            "full_run_time_s": full.time._asdict(),
            "times_faster": ratio_row(timing, full.time),
            "structure": structure_report(structure),
        }
        return self._finished(load, row, solution)

    def _full_row(self, load: str, built: Callable[[], Timed]) -> tuple[Row, Arrays]:
        structure, build_time = built()
        full = self.baseline(load)
        row = {
            "build_time_s": build_time,
            **full.row,
            "full_run_time_s": full.time._asdict(),
            "times_faster": {"median": 1.0, "least": 1.0, "most": 1.0},
            "structure": structure_report(structure),
        }
        return self._finished(load, row, full.solution)

    def _finished(self, load: str, row: Row, solution: Solution) -> tuple[Row, Arrays]:
        """With errors; and with the surface that the pictures show."""
        reference = self.reference(load)
        whole = {
            **row,
            "error": error_row(solution, reference),
            "frame": frame_error(self.scenery, solution, reference),
        }
        shown = self.config.picture
        if load != shown.load:
            return whole, {}
        return whole, {"surface": surface_at(solution, shown.time)}
