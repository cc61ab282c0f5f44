"""`experiments run reduction`: reduced models of a sweep's choices, on its front.

A model is built for the pattern of each load, and judged by the sweep's reference. Its
rows are added to `rivals.jsonl` in the sweep's folder, where `experiments run
front` shows them with the time to make them, `offline_s`, apart from their run time.
"""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibrate.study.case import Case, build_case
from calibrate.study.config import load_sweep
from calibrate.study.evaluate import find_truth
from calibrate.study.front import Point, points_of
from calibrate.study.rows import Row, append_rows
from jaxthermo.config.loader import resolved
from jaxthermo.console.terminal import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor
from jaxthermo.reduction.reduce import reduce
from jaxthermo.reduction.reduced_model import ReducedModel
from jaxthermo.report.numbers import seconds, significant
from jaxthermo.timing import interleaved

from ..harness.record import fingerprint, program_hash
from .comparisons import model_loop
from .rivals import read_folder
from .run import TOLERANCES, SweepCases


_NAME = "reduced model"
_REDUCTIONS = (1e-2, 1e-3)
"""Errors of the reduction over the surface's range [-]."""
_REPEATS = 7
_MARGIN = 0.9
"""Error of a choice that is reduced over the tolerance [-]: the rest is the model's."""
_SOURCES = (Path(__file__),)


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """Reduced models of the choices of a sweep that are read the fastest.

    Each tolerance of the front has one choice within it. Models in the folder are not
    built again.

    Raises:
        InputError: if no folder of a sweep is named, or its scene is not linear.
    """
    if config is None or not config.is_dir():
        raise InputError("reduction: name the folder of a sweep that was run")
    console = open_console()
    sweep_config = load_sweep(config / "config.yaml")
    rows = read_folder(config)
    cases = SweepCases(sweep_config)
    points = points_of(rows.rows, rows.times, set(cases.loads))
    if not points:
        raise InputError(f"{config}: no choice has been run under every load")
    reduced_rows = []
    chosen_points = _chosen(cases, points)
    rows_by_id = {row["id"]: row for row in rows.rivals if "id" in row}
    for point in chosen_points:
        for load, case in cases(point).items():
            for tolerance in _REDUCTIONS:
                key = fingerprint([case.id, tolerance, program_hash(_SOURCES)])
                row = rows_by_id.get(key)
                if row is None or not (config / row["model"]).exists():
                    row = _row(
                        key,
                        case=case,
                        load=load,
                        point=point,
                        tolerance=tolerance,
                        folder=config,
                    )
                    append_rows(config / "rivals.jsonl", [row])
                print_line(console, f"{load}: {_words(row)}")
                reduced_rows.append(row)
    return {
        "config": resolved(sweep_config),
        "sweep": str(config),
        "choices": [{"choice": p.choice, "errors": p.errors} for p in chosen_points],
        "rows": reduced_rows,
        "sentences": [_words(row) for row in reduced_rows],
    }


def _chosen(cases: SweepCases, points: Sequence[Point]) -> list[Point]:
    """A choice within each tolerance; the most accurate one where none is."""
    chosen_points: list[Point] = []
    for tolerance in TOLERANCES:
        limit = _MARGIN * tolerance
        within = [p for p in points if p.errors["rms_percent"] <= limit]
        if within:
            chosen_points.append(min(within, key=lambda point: _size(cases, point)))
    if not chosen_points:
        chosen_points = [min(points, key=lambda point: point.errors["rms_percent"])]
    return list({point.name: point for point in chosen_points}.values())


def _size(cases: SweepCases, point: Point) -> tuple[float, int]:
    """Voxels along z, with which the time of a reduced model grows, then nodes."""
    body = next(iter(cases(point).values())).config.bodies[0]
    return float(body.voxels_high or 1 / float(body.pitch or 1)), point.nodes


def _row(
    key: str, case: Case, load: str, point: Point, tolerance: float, folder: Path
) -> Row:
    """A model under one load, its error and its times."""
    span = case.config.time
    model = reduce(
        build_case(case.config).scene,
        t1=span.last,
        save_at=span.save_times,
        tolerance=tolerance,
    )
    truth = find_truth(case, lambda text: None)
    label = f"{point.name}, within {100 * tolerance:g} %"
    file = Path("models") / f"{key}.npz"
    (folder / file.parent).mkdir(exist_ok=True)
    model.save(folder / file)
    return {
        "id": key,
        "name": _NAME,
        "load": load,
        "choice": {"of": label},
        "error": truth.points.error(model()).as_dict(),
        "own_error": truth.own_error,
        "loop_s": interleaved({"model": model_loop(model)}, _REPEATS)["model"],
        "offline_s": model.about.offline_s,
        "model": str(file),
        "nodes": model.size,
        "full_nodes": model.about.nodes,
        "estimate_percent": model.about.estimate_percent,
        "residual_bound_kelvin": list(model.about.residual_bound_kelvin),
        # The matrices, in the precision of the run.
        "memory_bytes": _bytes(model),
        "processor": processor(),
    }


def _bytes(model: ReducedModel) -> int:
    values = model.output.size + model.direct.size + model.drive.size + 3 * model.size
    return values * (8 if model.dtype == "float64" else 4)


def _words(row: Row) -> str:
    error = row["error"]
    percent = error["worst_rms_percent"]
    return (
        f"{row['nodes']} vectors of {row['choice']['of']}: "
        f"{significant(error['worst_rms_kelvin'])} K ({significant(percent)} %) in "
        f"{seconds(statistics.median(row['loop_s']))}, made in "
        f"{seconds(row['offline_s'])}"
    )
