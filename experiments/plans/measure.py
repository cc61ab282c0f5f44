"""A plan of a part, and the true error of the model that it chose."""

import math
import warnings
from pathlib import Path
from typing import NamedTuple, TypedDict

import numpy as np

from calibrate.plan.candidate import Candidate, pitches_of
from calibrate.plan.predict import scene_size
from calibrate.plan.references import SETTINGS
from calibrate.plan.search import search
from calibrate.plan.tolerance import Tolerance
from calibrate.problem.reference import COARSENING, program_hash, refined_run
from calibrate.study.rows import Rows
from jaxthermo.accuracy.discretization_error import discretization_error
from jaxthermo.accuracy.error_records import finite_numbers
from jaxthermo.accuracy.truth_error import AtPoints, TruthPoints, truth_points
from jaxthermo.config.loader import load_config
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.simulate import simulate
from jaxthermo.progress import Progress


_FINER = 1.5
"""Pitch of the plan's finest reference over that of the finest run."""


class PlanRow(TypedDict):
    """A plan; errors are None where nothing was chosen."""

    voxels: int
    """Volume of the part over that of a voxel of its own pitch."""
    chosen: str
    """The model in words; empty where nothing is within the tolerance."""
    difference_percent: float | None
    """Difference of the model from the plan's reference [%]."""
    reference_percent: float
    """Error that the plan takes its reference to have [%]."""
    true_percent: float | None
    """True error of the model [%]."""
    order: list[float | None]
    """Observed order of the three finest runs at the saved times; None where they have
    none, and the finest one itself is taken as the truth."""


class _Truth(NamedTuple):
    points: TruthPoints
    order: list[float | None]


def measure(path: Path, percent: float, folder: Path, progress: Progress) -> PlanRow:
    """Plan a part, then compare the model with the truth.

    The truth is extrapolated from the plan's two finest references and from a run in
    voxels 1.5 times as fine.

    Args:
        path: of the scene of the part.
        percent: tolerance [%].
        folder: for the candidates that were run.
        progress: receives that of the search.
    """
    scene = load_config(path)
    pitches = pitches_of(scene)
    folder.mkdir(parents=True, exist_ok=True)
    rows = Rows(folder / "rows.jsonl", program_hash(True))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            choice = search(
                scene,
                tolerance=Tolerance(percent=percent),
                rows=rows,
                search_time=math.inf,
                progress=progress,
            )
        finally:
            rows.close()
        row: PlanRow = {
            "voxels": round(scene_size(scene, pitches).volume),
            "chosen": "",
            "difference_percent": None,
            "reference_percent": choice.reference.percent,
            "true_percent": None,
            "order": [],
        }
        if choice.best is None:
            return row
        candidate = choice.best.measured.candidate
        truth = _truth(scene, pitches, choice.reference.refinement)
        model = candidate.applied(scene, pitches)
        solution = simulate(
            model.build(),
            t1=model.time.end,
            save_at=model.time.save_times,
            solver=model.solver.build(),
        )
        true_error = truth.points.error(solution)
    return {
        **row,
        "chosen": candidate.words(pitches),
        "difference_percent": choice.best.percent,
        "true_percent": float(true_error.worst_rms_percent),
        "order": truth.order,
    }


def _truth(scene: SceneConfig, pitches: tuple[float, ...], refinement: float) -> _Truth:
    """Temperatures at points, extrapolated to voxels of no size.

    T = T_1 + (T_1 - T_2) / (r^p - 1), r = 1.5, with p as observed over the surface at
    each saved time.
    """

    def run(times_as_fine: float) -> StoredSolution:
        config = Candidate(times_as_fine, "full_volume").applied(scene, pitches)
        return refined_run(config, settings=SETTINGS, log=_ignored)[0]

    finest = run(_FINER * refinement)
    middle = run(refinement)
    error = discretization_error(
        finest,
        middle=middle,
        coarsest=run(refinement / COARSENING),
        count=SETTINGS.points,
    )
    points = truth_points(finest, SETTINGS.points)
    reading = points.reading(middle.surfaces)
    factor = np.where(error.is_bound, 0.0, 1 / (_FINER**error.order - 1))
    temperature = points.expected.temperature
    step = temperature - reading.read(np.asarray(middle.surface_temperature))
    expected = AtPoints(
        temperature + factor[:, None] * step, points.expected.is_lost | reading.is_lost
    )
    order = finite_numbers(np.where(error.is_bound, np.nan, error.order))
    return _Truth(points._replace(expected=expected), order)


def _ignored(text: str) -> None:
    pass
