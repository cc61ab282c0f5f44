"""The verdict on a fit: every time's error, and the speed, before and after."""

from typing import Any

import pytest

from calibrate.analysis.verdict import judge, time_errors
from calibrate.report.text_summary import time_table
from jaxthermo.report.table import Cell
from tests.calibrating import FAST, RESULT, errors_of


BETTER = errors_of([4.0, 3.0], [2.0, 1.0])
LATE = errors_of([4.0, 1.0], [2.0, 1.5])


def test_a_faster_fit_with_less_error_everywhere_pays():
    verdict = judge(BETTER, FAST, is_of_weights=True)
    assert verdict["pays"] and (verdict["times"], verdict["worse"]) == (2, 0)
    assert "the fit pays" in verdict["words"] and "5 (4-6) times" in verdict["words"]


def test_an_error_that_is_larger_at_one_time_is_told_with_its_time():
    """Although the largest error became less, and in whichever group it is."""
    held_out = errors_of([4.0, 1.0], [2.0, 1.5], "held_out")
    for case_errors in (LATE, BETTER | held_out):
        verdict = judge(case_errors, FAST, is_of_weights=True)
        assert not verdict["pays"] and verdict["worse"] == 1
        assert "+x at 60 s 1.00 to 1.50 %" in verdict["words"]
        assert "NOT pay" in verdict["words"] and "30 s" not in verdict["words"]


@pytest.mark.parametrize(
    ("speed", "words"),
    [((0.8, 0.7, 0.95), "SLOWER"), ((1.1, 0.9, 1.3), "NOT clearly faster")],
)
def test_weights_that_run_no_faster_than_the_full_volume_do_not_pay(speed, words):
    slow: Any = dict(zip(FAST, speed, strict=True))
    verdict = judge(BETTER, slow, is_of_weights=True)
    assert not verdict["pays"] and words in verdict["words"]
    # A material is fitted to know it, not to be fast.
    assert judge(BETTER, slow, is_of_weights=False)["pays"]


def test_rounding_is_no_larger_error():
    same = errors_of([1.0, 2.0], [1.0005, 2.0])
    assert judge(same, FAST, is_of_weights=True)["pays"]


def test_the_table_has_every_time_and_marks_the_worse():
    held_out = errors_of([3.0, 1.0], [1.0, 1.0], "held_out")
    result = RESULT | {"errors": LATE | held_out}
    rows = time_table(result).rows
    assert len(rows) == len(list(time_errors(result["errors"]))) == 4
    assert list(rows[0][:4]) == ["+x", "fitted to", "30", "4.00"]
    assert [row[0] for row in rows] == ["+x", "", "+x", ""]
    marks = [cell.met for row in rows if isinstance(cell := row[4], Cell)]
    assert marks == [True, False, True, True]
