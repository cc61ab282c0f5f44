"""Reduced models of choices on the front: offline and online time apart."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp

from calibrate.runs.case import Case
from calibrate.runs.scenes import build_case
from calibrate.runs.truth import find_truth
from jaxthermo.arrays import precision
from jaxthermo.provenance import processor
from jaxthermo.reduction.reduce import reduce

from ..harness.record import fingerprint, program_hash
from ..harness.timing import interleaved
from .folder import append_rows, read_rows
from .pareto import Point, Row, fastest_within, front


_MAX_NODES = 200_000
"""Nodes of a choice up to which it is reduced: its vectors are kept in memory."""
_WITHIN = 1.0
"""Error of the fastest choice that is reduced, beside the most accurate one [%]."""


def to_reduce(points: Sequence[Point]) -> list[Point]:
    """The most accurate choice of the front, and the fastest within 1 %."""
    small = [p for p in front(points) if p.nodes <= _MAX_NODES]
    found = [fastest_within(small, _WITHIN), *small[-1:]]
    return list({p.name: p for p in found if p is not None}.values())


def reduced_rows(
    point: Point,
    cases: Mapping[str, Case],
    path: Path,
    repeats: int,
    log: Callable[[str], None],
) -> list[Row]:
    """Rows of a choice's reduced models, one for each load, from the file or measured.

    The time of a row is that of the compiled model with the surface at the saved
    times; `offline_s` is the preparation, once for all amplitudes of the load.

    Raises:
        InputError: naming the term that is not linear.
    """
    known = {row["id"]: row for row in read_rows(path) if "id" in row}
    found = []
    for load, case in cases.items():
        key = fingerprint(["reduced", case.id, program_hash((Path(__file__),))])
        if key not in known:
            log(f"reducing {point.name}, {load}")
            known[key] = {"id": key, **_measured(point, case, repeats)}
            append_rows(path, [known[key]])
        found.append(known[key])
    return found


def _measured(point: Point, case: Case, repeats: int) -> Row:
    config, scene = case.config, build_case(case.config).scene
    with precision(scene.dtype):
        model = reduce(scene, config.time.last, config.time.save_times)
        function = jax.jit(model.as_function())
        amplitudes = jnp.asarray(model.amplitudes, model.dtype)
        spans = interleaved({"online": lambda: function(amplitudes)}, repeats)
        truth = find_truth(case, lambda text: None)
        error = truth.points.error(model()).as_dict()
    parts = model.rates, model.drive, model.output, model.direct, model.reference
    return {
        "name": "reduced model",
        "load": case.load,
        "choice": {"of": point.name},
        "error": error,
        "own_error": truth.own_error,
        "loop_s": spans["online"],
        "offline_s": model.about.offline_s,
        "nodes": model.size,
        "memory_bytes": sum(part.nbytes for part in parts),
        "processor": processor(),
    }
