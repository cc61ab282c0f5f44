"""`experiments run reduction`: reduced models of a sweep's best choice, as its rivals.

A model is made for the pattern of each load, and judged by the sweep's own reference.
Its rows are added to `rivals.jsonl` in the sweep's folder, where `experiments run
front` shows them with the time to make them, `offline_s`, apart from their run time.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from calibrate.runs.case import Case
from calibrate.runs.scenes import build_case
from calibrate.runs.truth import find_truth
from jaxthermo.arrays import precision
from jaxthermo.cli.console import open_console, print_line
from jaxthermo.errors import InputError
from jaxthermo.provenance import processor
from jaxthermo.reduction.reduce import reduce
from jaxthermo.reduction.reduced_model import ReducedModel
from jaxthermo.report.numbers import seconds, significant

from ..harness.record import fingerprint, program_hash
from ..harness.timing import timed_call
from ..sweep.config import load_sweep, resolved
from .folder import append_rows, read_folder
from .pareto import Point, Row, points_of
from .run import cases, loads_of


NAME = "reduced model"
_TOLERANCES = (1e-1, 1e-2, 1e-3)
"""Errors of the reduction over the surface's range [-]."""
_REPEATS = 7
_SOURCES = (Path(__file__),)


def run(folder: Path, config: Path | None = None) -> dict[str, Any]:
    """Reduced models of the most accurate choice of a sweep, to three tolerances.

    Raises:
        InputError: if no folder of a sweep is named, or its scene is not linear.
    """
    if config is None or not config.is_dir():
        raise InputError("reduction: name the folder of a sweep that was run")
    console = open_console()
    given, rows = load_sweep(config / "config.yaml"), read_folder(config)
    points = points_of(rows.rows, rows.times, set(loads_of(given)))
    if not points:
        raise InputError(f"{config}: no choice has been run under every load")
    best = min(points, key=lambda point: point.errors["rms_percent"])
    log = lambda text: print_line(console, text)
    found = []
    for load, case in cases(given, best).items():
        for tolerance in _TOLERANCES:
            row = _row(case, load, best, tolerance)
            append_rows(config / "rivals.jsonl", [row])
            log(f"{load}: {_words(row)}")
            found.append(row)
    return {
        "config": resolved(given),
        "sweep": str(config),
        "choice": best.choice,
        "choice_error": best.errors,
        "rows": found,
        "sentences": [_words(row) for row in found],
    }


def _row(case: Case, load: str, point: Point, tolerance: float) -> Row:
    """A model under one load, its error and its times."""
    scene, span = build_case(case.config).scene, case.config.time
    model = reduce(scene, span.last, span.save_times, tolerance=tolerance)
    truth = find_truth(case, lambda text: None)
    label = f"{point.name}, within {100 * tolerance:g} %"
    return {
        "id": fingerprint([case.id, tolerance, program_hash(_SOURCES)]),
        "name": NAME,
        "load": load,
        "choice": {"of": label},
        "error": truth.points.error(model()).as_dict(),
        "own_error": truth.own_error,
        "loop_s": _spans(model),
        "offline_s": model.about.offline_s,
        "nodes": model.size,
        "full_nodes": model.about.nodes,
        "estimate_percent": model.about.estimate_percent,
        "residual_bound_kelvin": list(model.about.residual_bound_kelvin),
        # The matrices, in the precision of the run.
        "memory_bytes": _bytes(model),
        "processor": processor(),
    }


def _spans(model: ReducedModel) -> list[float]:
    with precision(model.dtype):
        function = jax.jit(model.as_function())
        amplitudes = jnp.asarray(model.amplitudes, model.dtype)
        call = lambda: jax.block_until_ready(function(amplitudes))
        call()
        return [timed_call(call)[1] for _ in range(_REPEATS)]


def _bytes(model: ReducedModel) -> int:
    values = model.output.size + model.direct.size + model.drive.size + 3 * model.size
    return values * (8 if model.dtype == "float64" else 4)


def _words(row: Row) -> str:
    error = row["error"]
    percent = error["worst_rms_percent"]
    return (
        f"{row['nodes']} vectors of {row['choice']['of']}: "
        f"{significant(error['worst_rms_kelvin'])} K ({significant(percent)} %) in "
        f"{seconds(sorted(row['loop_s'])[len(row['loop_s']) // 2])}, made in "
        f"{seconds(row['offline_s'])}"
    )
