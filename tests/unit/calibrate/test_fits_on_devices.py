"""Fits and sweeps over several devices: the results of one device."""

from pathlib import Path

import pytest

from tests.four_devices import run_on_four


PROGRAM = Path(__file__).with_name("fits_on_four.py")


@pytest.mark.slow
@pytest.mark.slice
def test_steps_of_a_solver_on_four_devices_are_those_on_one(tmp_path):
    assert run_on_four(PROGRAM, "solver", tmp_path) == "equal"


@pytest.mark.slow
def test_cases_on_four_devices_have_the_errors_of_one(tmp_path):
    assert run_on_four(PROGRAM, "cases", tmp_path) == "equal"


@pytest.mark.slow
def test_a_fit_on_four_devices_is_that_of_one_and_goes_on_on_the_other(tmp_path):
    assert run_on_four(PROGRAM, "columns", tmp_path) == "equal"


@pytest.mark.slow
def test_starts_on_four_devices_lead_where_they_do_on_one(tmp_path):
    assert run_on_four(PROGRAM, "starts", tmp_path) == "equal"
