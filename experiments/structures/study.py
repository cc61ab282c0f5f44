"""One body: the full volume, and every structure beside it, under every load."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import jaxthermo as jt
from jaxthermo.integrate.run.solution_file import StoredSolution
from jaxthermo.scene.compile.compile import body_geometry
from jaxthermo.scene.scene import SolvedSurface
from jaxthermo.structures.report import structure_report
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.structures.surface_map import AbstractSurfaceMap

from ..harness.record import Arrays, Record, Row
from .config import (
    FULL,
    LINKS,
    ComparedBody,
    ComparisonConfig,
    EntryConfig,
    body_identity,
    common_identity,
    structure_identity,
)
from .measure import (
    Baseline,
    Scenery,
    Timed,
    build_timed,
    error_row,
    finish,
    frame_error,
    prepare,
    ratio_row,
    run_timed,
    scenery,
    surface_at,
)


# Surface map of the full volume: a voxel's temperature is that of its centre.
NEAREST = jt.ConstantMap()


def rays(axes: tuple[str, str, str], load: str) -> tuple[float, float, float]:
    """Direction of rays onto a side that is named in the file's axes."""
    way = [0.0, 0.0, 0.0]
    for i, name in enumerate(axes):
        if name[-1] == load[-1]:
            # Onto the positive side they travel down the axis.
            way[i] = 1.0 if (name[0] == "-") != (load[0] == "-") else -1.0
    return way[0], way[1], way[2]


@dataclass(frozen=True, eq=False)
class Subject:
    """A voxelized body, and the scenes that it is put into."""

    grid: jt.VoxelGrid
    config: ComparisonConfig

    @classmethod
    def load(
        cls,
        body: ComparedBody,
        config: ComparisonConfig,
        voxels_high: int,
        surface_cells: Literal["dominant_axis", "crossings"] = "crossings",
    ) -> "Subject":
        """Voxelize the body's mesh to so many voxels along up."""
        given = body.mesh or body.shape
        if given is None:
            raise jt.InputError("bodies: a body needs a `mesh` or a `shape`")
        mesh = given.build()
        pitch = float(np.ptp(mesh.bounds[:, 2])) / voxels_high
        return cls(jt.voxelize(mesh, pitch, surface_cells), config)

    def body(
        self, structure: AbstractStructure, surface_map: AbstractSurfaceMap
    ) -> jt.Body:
        """The structure with the material and start of the config."""
        config = self.config
        material, start = config.material.build(), config.temperature
        return jt.Body(structure, material, temperature=start, surface_map=surface_map)

    def scene(
        self, structure: AbstractStructure, surface_map: AbstractSurfaceMap, load: str
    ) -> jt.Scene:
        """A structure in the sun from the side that the load names."""
        sun, others = self.config.sun, self.config.terms
        strength: Any = sun.irradiance
        if sun.until is not None:
            strength = jt.Until(strength, sun.until)
        first = jt.Sun(rays(self.grid.mesh.axes, load), irradiance=strength)
        terms = (first, *(term.build() for term in others))
        return jt.Scene((self.body(structure, surface_map),), terms)

    @property
    def surface(self) -> SolvedSurface:
        """The body's shape; black, since only temperatures are looked at."""
        one = jnp.ones((), jnp.float32)
        return SolvedSurface(body_geometry(self.grid, jt.Pose()), one, one)


@dataclass(frozen=True)
class Case:
    """One line of the comparison: its name, and how its structure is made."""

    label: str
    kind: str
    entry: EntryConfig | None = None

    @property
    def identity(self) -> Any:
        """Plain values that distinguish it from all others."""
        options = structure_identity(self.entry.structure) if self.entry else {}
        return [self.label, self.kind, options]

    def make(self, grid: jt.VoxelGrid) -> AbstractStructure:
        """The structure of a body's voxels."""
        if self.entry is None:
            return jt.FullVolume(grid, stencil=self.kind != LINKS)
        return self.entry.structure.build(grid)


def all_cases(config: ComparisonConfig) -> tuple[Case, ...]:
    """The full volume, as links too if asked for, and the config's structures."""
    full = [Case(FULL, FULL)]
    if config.full_volume_as_links:
        full.append(Case(LINKS, LINKS))
    entries = (Case(e.label, e.structure.kind, e) for e in config.structures)
    return (*full, *entries)


def case_loads(case: Case, config: ComparisonConfig) -> tuple[str, ...]:
    """The loads that a case is run under."""
    # As links the full volume says what a link costs, under any load: one will do.
    return (config.picture.load,) if case.kind == LINKS else config.loads


class Study:
    """Data that all rows of one body use; computed once, when first needed."""

    def __init__(self, body: ComparedBody, config: ComparisonConfig, record: Record):
        """Nothing is loaded or run yet."""
        self.body = body
        self.config = config
        self.record = record
        self.surface_map = config.surface_map.build()
        self._baselines: dict[str, Baseline] = {}
        self._references: dict[str, StoredSolution] = {}

    @cached_property
    def subject(self) -> Subject:
        """The body, voxelized."""
        return Subject.load(self.body, self.config, self.config.voxels_high)

    @cached_property
    def scenery(self) -> Scenery:
        """The body as the camera sees it."""
        return scenery(self.config.camera, self.subject.surface)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Inputs of all rows of this body, as plain values."""
        config, body = common_identity(self.config), body_identity(self.body)
        return {"common": config, "body": body}

    def baseline(self, load: str) -> Baseline:
        """The full volume at its own stable step, timed in this process."""
        # Ratios are of times of one process, also after an interruption: no record.
        if load not in self._baselines:
            scene = self.subject.scene(jt.FullVolume(self.subject.grid), NEAREST, load)
            solution, timing, cost = run_timed(scene, self.config)
            # The loop runs over the bounding box, empty voxels included.
            work = self.subject.grid.solid.size * cost["steps"]
            cost["lattice_voxels_per_s"] = work / timing.median
            self._baselines[load] = Baseline(solution, timing, cost)
        return self._baselines[load]

    def reference(self, load: str) -> StoredSolution:
        """The reference of all errors: the full volume at a fraction of its step."""
        if load not in self._references:
            row = self.reference_row(load)
            if "refused" in row:
                raise jt.InputError(f"the reference: {row['refused']}")
            kept = self.record.arrays_of(row)
            times, kelvin = (kept[key] for key in ("times", "surface_temperature"))
            self._references[load] = StoredSolution(
                jnp.asarray(times), jnp.asarray(kelvin), (self.subject.surface,)
            )
        return self._references[load]

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
        config, stable = self.config, self.baseline(load).solution.run.stable_step
        step = None if stable is None else config.reference_step * stable
        span = config.time
        scene = self.subject.scene(jt.FullVolume(self.subject.grid), NEAREST, load)
        solution = finish(prepare(scene, span.end, span.save_times, step))
        surface = np.asarray(solution.surface_temperature)
        row = {"steps": solution.run.steps, "dt_s": solution.run.dt}
        times = np.asarray(solution.times)
        return row, {"times": times, "surface_temperature": surface}

    def check(self) -> None:
        """Voxelize the body and build the scenes, to report mistakes before any run.

        Raises:
            InputError: for terms that do not fit the body or one another, or a camera
                that does not see it.
        """
        _ = self.scenery
        full = jt.FullVolume(self.subject.grid)
        for load in self.config.loads:
            self.subject.scene(full, NEAREST, load)

    def rows(self, case: Case) -> Iterator[Row]:
        """One row a load; the structure is built if any of them is missing."""
        grid = self.subject.grid
        built = cache(lambda: build_timed(lambda: case.make(grid)))
        names = {"label": case.label, "kind": case.kind}
        for load in case_loads(case, self.config):
            head = {"what": "structure", "body": self.body.name, "load": load, **names}
            identity = {**self.identity, "load": load, "case": case.identity}
            make = partial(self._row, case, load, built)
            yield self.record.once(identity, head, make)

    def _row(
        self, case: Case, load: str, built: Callable[[], Timed]
    ) -> tuple[Row, Arrays]:
        # The structure first, since it may be refused.
        structure, build_time = built()
        full = self.baseline(load)
        if case.label == FULL:
            # The run that all others are compared with.
            solution, cost = full.solution, full.row
            ratio = {"median": 1.0, "least": 1.0, "most": 1.0}
        else:
            scene = self.subject.scene(structure, self.surface_map, load)
            solution, timing, cost = run_timed(scene, self.config)
            ratio = ratio_row(timing, full.time)
        reference, shown = self.reference(load), self.config.picture
        row = {
            "build_time_s": build_time,
            **cost,
            "full_run_time_s": full.time._asdict(),
            "times_faster": ratio,
            "structure": structure_report(structure),
            "error": error_row(solution, reference),
            "frame": frame_error(self.scenery, solution, reference),
        }
        # Only the surface that the pictures show is kept.
        if load != shown.load:
            return row, {}
        return row, {"surface": surface_at(solution, shown.time)}
