"""The reference of a case: one run of fine voxels under each load, read at points."""

from functools import lru_cache
from typing import Any, NamedTuple

from jaxthermo.accuracy.truth_error import TruthPoints, truth_points

from ..problem.reference import Log, absolute_reference
from .case import Case


class Truth(NamedTuple):
    """A reference at points, with its own error and its costs."""

    points: TruthPoints
    own_error: dict[str, Any]
    costs: tuple[dict[str, Any], ...]


def find_truth(case: Case, log: Log) -> Truth:
    """Run the reference of a case with two coarser ones, or load them."""
    return _found(_Request(case, case.truth_key, log))


class _Request:
    # One for all choices under a load: only the key counts.
    def __init__(self, case: Case, key: str, log: Log):
        self.case = case
        self.key = key
        self.log = log

    def __eq__(self, request: object) -> bool:
        return isinstance(request, _Request) and self.key == request.key

    def __hash__(self) -> int:
        return hash(self.key)


@lru_cache(maxsize=16)
def _found(request: _Request) -> Truth:
    case = request.case
    reference = absolute_reference(case.config, settings=case.truth, log=request.log)
    settings = case.truth
    points = truth_points(reference.solution, count=settings.points, seed=settings.seed)
    return Truth(
        points=points, own_error=reference.own_error.as_dict(), costs=reference.costs
    )
