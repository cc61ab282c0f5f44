"""The error against the number of levels, up to all of them (thesis figure 6.1)."""

from collections.abc import Iterator
from functools import partial

from jaxthermo.structures.kinds.multilevel import MultiLevel

from .config import LevelsConfig
from .measure import build_timed, error_row
from .record import Arrays, Row
from .runner import finish, prepare
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
            make = partial(_row, study, count, hollow, load)
            yield study.record.once(identity, head, make)


def _row(study: Study, count: int | str, hollow: str, load: str) -> tuple[Row, Arrays]:
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
