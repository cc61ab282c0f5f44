"""The verdict on a fit: every time's error, and the speed, before and after."""

import pytest

from calibrate.analysis.verdict import judge, time_errors
from calibrate.report.text_summary import time_table
from jaxthermo.report.table import Cell


FAST = {"times_faster": 5.0, "min": 4.0, "max": 6.0}


def errors(default, fitted, group="train"):
    def case(percent):
        return {"times_s": [30.0, 60.0], "rms_percent": percent}

    return {group: {"default": {"+x": case(default)}, "fitted": {"+x": case(fitted)}}}


BETTER = errors([4.0, 3.0], [2.0, 1.0])
LATE = errors([4.0, 1.0], [2.0, 1.5])


def test_a_faster_fit_with_less_error_everywhere_pays():
    verdict = judge(BETTER, FAST, is_of_weights=True)
    assert verdict["pays"] and (verdict["times"], verdict["worse"]) == (2, 0)
    assert "the fit pays" in verdict["words"] and "5 (4 to 6) times" in verdict["words"]


def test_an_error_that_is_larger_at_one_time_is_told_with_its_time():
    """Although the largest error became less, and in whichever group it is."""
    held_out = errors([4.0, 1.0], [2.0, 1.5], "held_out")
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
    slow: dict[str, float] = {}
    slow |= zip(("times_faster", "min", "max"), speed, strict=True)
    verdict = judge(BETTER, slow, is_of_weights=True)
    assert not verdict["pays"] and words in verdict["words"]
    # A material is fitted to know it, not to be fast.
    assert judge(BETTER, slow, is_of_weights=False)["pays"]


def test_rounding_is_no_larger_error():
    same = errors([1.0, 2.0], [1.0005, 2.0])
    assert judge(same, FAST, is_of_weights=True)["pays"]


def test_the_table_has_every_time_and_marks_the_worse():
    result = {"errors": LATE | errors([3.0, 1.0], [1.0, 1.0], "held_out")}
    rows = time_table(result | {"reference": "full_volume"}).rows
    assert len(rows) == len(list(time_errors(result["errors"]))) == 4
    assert list(rows[0][:4]) == ["+x", "fitted to", "30", "4.00"]
    assert [row[0] for row in rows] == ["+x", "", "+x", ""]
    marks = [cell.met for row in rows if isinstance(cell := row[4], Cell)]
    assert marks == [True, False, True, True]
