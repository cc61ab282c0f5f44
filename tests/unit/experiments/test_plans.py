"""Plans of parts are judged by their true errors; a part is planned as it should be."""

import pytest

from experiments import catalogue
from experiments.harness.case import FAIL, PASS, check
from experiments.plans.measure import PlanRow
from experiments.plans.run import PARTS, TOLERANCES, Plan, _parts, judged
from jaxthermo.errors import InputError


(EXPERIMENT,) = catalogue.find("plans")


def _plan(
    tolerance: float = 3.0, *, true: float | None = 2.0, voxels: int = 4000
) -> Plan:
    row: PlanRow = {
        "voxels": voxels,
        "chosen": "" if true is None else "blocks",
        "difference_percent": None if true is None else 1.0,
        "reference_percent": 1.0,
        "true_percent": true,
        "order": [],
    }
    return Plan("block", tolerance, row)


def _verdicts(*plans: Plan) -> list[str]:
    return [check(case).verdict for case in judged(list(plans))]


FIFTEEN = [_plan(tolerance) for tolerance in TOLERANCES for _ in PARTS]


@pytest.mark.parametrize(
    ("changed", "failed"),
    [
        ([_plan()], None),
        ([_plan(true=3.1)], 0),
        ([_plan(true=float("nan"))], 0),
        ([_plan(true=None)] * 3, None),
        ([_plan(true=None)] * 4, 1),
        ([_plan(10.0, true=None)], 1),
        ([_plan(voxels=5001)], 2),
    ],
)
def test_a_plan_that_misses_a_limit_fails_its_case(changed, failed):
    expected = [FAIL if number == failed else PASS for number in range(3)]
    assert _verdicts(*FIFTEEN[: -len(changed)], *changed) == expected


def test_parts_are_named():
    assert len(PARTS) == 5 and _parts(None) == PARTS
    assert _parts("stud,bowl") == ("stud", "bowl")
    with pytest.raises(InputError, match="--cases cube: there are bowl"):
        _parts("stud,cube")


@pytest.mark.slow
def test_a_part_is_planned_within_each_tolerance(request):
    # The rows of an interrupted run of the same programs are used again.
    folder = request.config.cache.mkdir("plans")
    result = catalogue.run(EXPERIMENT, folder, cases="stud")
    assert result["result"]["passed"] == ["P1", "P2", "P3"]
