"""`experiments run budget`: how much of an error is due to voxels, structure and time.

One run, the reference, has the finest voxels. The surface temperatures of all runs are
read at the same points of the mesh, so that a part of the error is the difference
between two runs that differ in one thing alone.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

import jaxthermo as jt
from calibrate.config.schema import RefinedReference
from calibrate.problem.reference import refined_reference
from jaxthermo.arrays import precision
from jaxthermo.cli.console import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.plan import Plan, initial_state, plan_run
from jaxthermo.integrate.run.simulate import integrate, make_solution, run_plan
from jaxthermo.integrate.run.surface_reading import SurfaceReading, surface_reading
from jaxthermo.integrate.run.time_error import of_pass
from jaxthermo.integrate.surface_error import AnySolution
from jaxthermo.scene.scene import BodyGeometry
from jaxthermo.structures.structure import AbstractStructure
from jaxthermo.voxels.voxelize import SurfaceCells

from ..harness.record import Arrays, Record, Row, program_hash
from ..harness.timing import timed_call
from .budget_table import budget_lines, write_budget
from .config import (
    BudgetConfig,
    BudgetEntry,
    ComparisonConfig,
    body_identity,
    config_hash,
    load_comparison,
    resolved,
    structure_identity,
)
from .study import Subject
from .truth import scene_config


_FURTHER = 2
"""Number of times that steps are halved for the run that gives the error in time."""

_MAX_NODES = 1_000_000
"""Number of nodes above which a run's parts of time and reading are not measured."""

_LONG = 30.0
"""Time of a run that is not repeated to be timed warm [s]."""

_DEFAULT = Path(__file__).parents[2] / "configs" / "experiments" / "structures.yaml"
_MEASURING = tuple(
    Path(__file__).with_name(f"{name}.py") for name in ("budget", "study", "truth")
)


class _Voxels:
    """The body in voxels of one height and one kind of surface."""

    def __init__(self, budget: "Budget", cells: SurfaceCells, height: int):
        """Nothing is computed yet."""
        self.budget, self.height = budget, height
        self.cells: SurfaceCells = cells

    @cached_property
    def subject(self) -> Subject:
        """The voxels, and scenes of them."""
        budget = self.budget
        return Subject.load(budget.body, budget.config, self.height, self.cells)

    @cached_property
    def reading(self) -> SurfaceReading:
        """Temperatures at the points of the budget, from those of the fragments."""
        return self.budget.reading_of(self.subject.surface.geometry)

    def run(
        self, load: str, built: Callable[[], AbstractStructure]
    ) -> tuple[Row, Arrays]:
        """A run as by default, one in shorter steps, one read where the nodes are."""
        scene = self.subject.scene(built(), jt.FluxCorrectedMap(), load)
        plan = self.plan(scene)
        with precision(scene.dtype):
            found, took = timed_call(lambda: run_plan(plan))
            # Once more without what is compiled.
            if took < _LONG:
                found, took = timed_call(lambda: run_plan(plan))
        if found.result != jt.RESULTS.successful:
            raise InputError(jt.RESULTS[found.result])
        runs = {"surface": found}
        if found.receipt.nodes <= _MAX_NODES:
            # Passes of the solver differ in their steps only: nothing is compiled.
            last = round(math.log2(found.run.steps / plan.steps))
            (body,) = scene.bodies
            constant = replace(body, surface_map=jt.ConstantMap())
            other = self.plan(replace(scene, bodies=(constant,)))
            runs["converged"] = _one_pass(plan, last + _FURTHER)
            runs["constant"] = _one_pass(other, last)
        row = {
            "nodes": found.receipt.nodes,
            "steps": found.run.steps,
            "run_time_s": took,
            "time_error_K": found.run.time_error,
            "times_s": np.asarray(found.times, float).tolist(),
            "energy_residual": float(np.abs(found.energy.residual_relative).max()),
        }
        points = {name: _read(self.reading, run) for name, run in runs.items()}
        return row, {**points, "is_lost": self.reading.is_lost}

    def plan(self, scene: jt.Scene) -> Plan:
        """Passes in ever shorter steps, as without a given solver."""
        time = self.budget.config.time
        with precision(scene.dtype):
            return plan_run(scene, time.end, time.save_times, control_error=True)


def _read(reading: SurfaceReading, run: AnySolution) -> np.ndarray:
    return np.asarray(reading.read(np.asarray(run.surface_temperature)))


def _one_pass(plan: Plan, number: int) -> jt.Solution:
    """A run with the steps of one pass alone."""
    now = of_pass(plan, number)
    with precision(plan.scene.dtype):
        return make_solution(now, integrate(now, initial_state(now)))


class Budget:
    """All runs of one body, each a row of the record."""

    def __init__(self, config: ComparisonConfig, given: BudgetConfig, record: Record):
        """Nothing is loaded or run yet."""
        self.config, self.given, self.record = config, given, record
        chosen = given.body or config.bodies[0].name
        self.body = next(body for body in config.bodies if body.name == chosen)

    @cached_property
    def mesh(self) -> jt.Mesh:
        """The body's."""
        source = self.body.mesh or self.body.shape
        assert source is not None
        return source.build()

    def reading_of(self, geometry: BodyGeometry) -> SurfaceReading:
        """Fragments of some voxels, and their weights, at the points of the mesh."""
        sample = jt.mesh_sample(self.mesh, self.given.points)
        return surface_reading(geometry, sample.position, sample.normal)

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Inputs of all rows, as plain values."""
        plain = resolved(self.config)
        keys = ("material", "temperature", "sun", "terms", "time")
        own: dict[str, Any] = {key: plain.get(key) for key in keys}
        own["points"] = self.given.points
        return {"budget": own, "body": body_identity(self.body)}

    def references(self) -> Iterator[Row]:
        """One row a load: the reference, its own error, what it took."""
        given = self.given
        kind = {
            "voxels_high": given.reference_voxels_high,
            "structure": structure_identity(given.reference),
        }
        for load in self.config.loads:
            head = {"what": "reference", "body": self.body.name, "load": load}
            identity = {**self.identity, "load": load, "reference": kind}
            yield self.record.once(identity, head, partial(self._reference, load))

    def _reference(self, load: str) -> tuple[Row, Arrays]:
        given = self.given
        high = {"voxels_high": given.reference_voxels_high}
        config = self.config.model_copy(update=high)
        scene = scene_config(self.body, config, self.mesh.axes, load)
        wanted = RefinedReference(
            refinement=1.0, structure=given.reference, points=given.points
        )
        found = refined_reference(scene, wanted, lambda _: None)
        run = found.solution
        reading = self.reading_of(run.surfaces[0].geometry)
        row = {
            "times_s": np.asarray(run.times, float).tolist(),
            "own_error": found.own_error.as_dict(),
            "costs": list(found.costs),
        }
        return row, {"surface": _read(reading, run), "is_lost": reading.is_lost}

    def rows(self) -> Iterator[Row]:
        """A row for every height, structure and load, the coarsest voxels first."""
        common = self.given.voxels_high
        entries = self.given.structures
        wanted = [(e, h) for e in entries for h in e.voxels_high or common]
        kinds: dict[tuple[int, SurfaceCells], None] = dict.fromkeys(
            (h, e.surface_cells) for e, h in wanted
        )
        for height, cells in sorted(kinds, key=lambda kind: kind[0]):
            # Voxels of one kind at a time: those of the finest take gigabytes.
            voxels = _Voxels(self, cells, height)
            for entry, high in wanted:
                if (high, entry.surface_cells) == (height, cells):
                    yield from self._rows_of(voxels, entry)

    def _rows_of(self, voxels: _Voxels, entry: BudgetEntry) -> Iterator[Row]:
        kind = {"voxels_high": voxels.height, "surface_cells": voxels.cells}
        own = {**kind, "structure": structure_identity(entry.structure)}
        built = cache(lambda: entry.structure.build(voxels.subject.grid))
        for load in self.config.loads:
            head = {"what": "structure", "body": self.body.name, "load": load}
            head |= {"label": entry.label, "kind": entry.structure.kind, **kind}
            identity = {**self.identity, "load": load, "entry": own}
            make = partial(voxels.run, load, built)
            yield self.record.once(identity, head, make)


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """The parts of the error of every structure of the config's `budget`.

    A run that was cut off in the same folder goes on.

    Raises:
        InputError: for a mistake in the config, no `budget` in it, a mesh that is not
            there, or a reference that cannot be run.
    """
    path = config or _DEFAULT
    if config is None and not _DEFAULT.is_file():
        raise InputError(f"the standard budget, {path}, is not installed: name a file")
    comparison = load_comparison(path)
    if comparison.budget is None:
        raise InputError(f"{path}: no `budget`: give its voxels_high and structures")
    record, console = Record(folder, _MEASURING), open_console()
    budget = Budget(comparison, comparison.budget, record)
    references, rows = [], []
    for each in budget.references():
        if "refused" in each:
            raise InputError(f"the reference, load {each['load']}: {each['refused']}")
        references.append(each)
        own = each["own_error"]["worst_rms_kelvin"]
        words = f"reference, {each['load']}: {each['costs'][0]['nodes']:,} nodes"
        print_line(console, f"{words}, own error about {own:.3g} K")
    for each in budget.rows():
        rows.append(each)
        where = f"{each['label']}, {each['voxels_high']} high, {each['load']}"
        said = each.get("refused") or f"{each['nodes']:,} nodes, {each['steps']} steps"
        print_line(console, f"{where}: {said}")
    lines = budget_lines(rows, references, record, comparison.budget)
    write_budget(lines, references, comparison, folder)
    return {
        "config": resolved(comparison),
        "config_hash": config_hash(comparison),
        "program_hash": program_hash(_MEASURING),
        "table": lines,
        "rows": rows,
        "references": references,
        "files": ["report.html"],
    }
