"""V13, V18, V20a, 1fa and 1fc of A9, the sol-air wall of V25: steady, to tolerance."""

import pytest

from experiments.harness.case import PASS, check
from tests.cases import CASES


@pytest.mark.parametrize(
    "id_",
    [
        "V18",
        pytest.param("A9 1fc", marks=[pytest.mark.slow, pytest.mark.slice]),
        pytest.param("V13", marks=pytest.mark.slow),
        pytest.param("V20a", marks=pytest.mark.slow),
        pytest.param("A9 1fa", marks=pytest.mark.slow),
        # In the slice of test_verification_report.
        pytest.param("V25, sol-air", marks=pytest.mark.slow),
    ],
)
def test_within_the_tolerance_that_is_stated(id_):
    (row,) = check(CASES[id_]).rows
    for stated_check in row.checks:
        print(id_, stated_check)
        assert stated_check.passes
    assert row.verdict == PASS, row
