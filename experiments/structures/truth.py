"""Truth errors: the structures of a body against runs of finer voxels."""

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

from calibrate.config.schema import RefinedReference
from calibrate.problem.reference import (
    TruthReference,
    read_at_surface,
    refined_reference,
)
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.integrate.truth_error import truth_error
from jaxthermo.structures.structure import AbstractStructure

from ..harness.record import Arrays, Row
from .config import LINKS, ComparedBody, ComparisonConfig, resolved
from .measure import finish, prepare
from .study import Case, Study, all_cases, rays


class Truth:
    """The runs of finer voxels of one body, and errors against them."""

    def __init__(self, study: Study, given: RefinedReference):
        """Nothing is run yet."""
        self.study, self.given = study, given
        self._references: dict[str, TruthReference] = {}

    @property
    def cases(self) -> tuple[Case, ...]:
        """The full volume and the structures; as links it would be the same again."""
        return tuple(c for c in all_cases(self.study.config) if c.kind != LINKS)

    def reference_rows(self) -> Iterator[Row]:
        """One row a load: the reference's own error, and what its runs cost."""
        for load in self.study.config.loads:
            head = self._head(load) | {"what": "truth reference"}
            identity = self._identity(load) | {"reference": True}
            make = partial(self._reference_row, load)
            yield self.study.record.once(identity, head, make)

    def rows(self, case: Case) -> Iterator[Row]:
        """One row a load; the structure is built if any of them is missing."""
        grid = self.study.subject.grid
        built = cache(lambda: case.make(grid))
        for load in self.study.config.loads:
            head = self._head(load) | {"what": "truth", "label": case.label}
            identity = self._identity(load) | {"case": case.identity}
            yield self.study.record.once(
                identity, head, partial(self._row, load, built)
            )

    def _head(self, load: str) -> Row:
        return {"body": self.study.body.name, "load": load}

    def _identity(self, load: str) -> dict[str, Any]:
        given = self.given.model_dump(mode="json", exclude_none=True)
        return {**self.study.identity, "load": load, "truth": given}

    def _reference(self, load: str) -> TruthReference:
        if load not in self._references:
            study = self.study
            axes = study.subject.grid.mesh.axes
            config = scene_config(study.body, study.config, axes, load)
            self._references[load] = refined_reference(
                config, self.given, lambda _: None
            )
        return self._references[load]

    def _reference_row(self, load: str) -> tuple[Row, Arrays]:
        found = self._reference(load)
        return {"own_error": found.own_error.as_dict(), "costs": list(found.costs)}, {}

    def _row(
        self, load: str, built: Callable[[], AbstractStructure]
    ) -> tuple[Row, Arrays]:
        # At the structure's own stable step, as in the row of its cost.
        study, span = self.study, self.study.config.time
        scene = study.subject.scene(built(), study.surface_map, load)
        solution = finish(prepare(read_at_surface(scene), span.end, span.save_times))
        reference, given = self._reference(load), self.given
        error = truth_error(solution, reference.solution, given.points, given.seed)
        own = reference.own_error.as_dict()
        return {"error": error.as_dict(), "own_error": own}, {}


def scene_config(
    body: ComparedBody, config: ComparisonConfig, axes: tuple[str, str, str], load: str
) -> SceneConfig:
    """The scene of a load as a scene file has it, with the full volume.

    `axes` are those of the body's mesh, which names the loads.
    """
    plain = resolved(config)
    given = body.model_dump(mode="json", exclude_none=True)
    given |= {key: plain[key] for key in ("voxels_high", "material", "temperature")}
    sun = {"kind": "sun", "direction": list(rays(axes, load)), **plain["sun"]}
    terms = [sun, *plain.get("terms", ())]
    scene = {"bodies": [given], "terms": terms, "time": plain["time"]}
    return SceneConfig.model_validate(scene)


def with_truth(rows: list[Row], found: list[Row]) -> list[Row]:
    """Rows of structures, each with its truth error and the reference's own."""
    key = lambda row: (row["body"], row["load"], row["label"])
    known = {
        key(row): {"error": row["error"], "own_error": row["own_error"]}
        for row in found
        if "refused" not in row
    }
    return [{**row, "truth": known.get(key(row))} for row in rows]
