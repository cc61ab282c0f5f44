"""The verification's cases and report: what is wrong must show."""

import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from experiments import catalogue
from experiments.harness.case import (
    FAIL,
    PASS,
    REPORTED,
    Case,
    Check,
    Group,
    Order,
    Row,
    _severity,
    check,
)
from experiments.harness.report import (
    _plain,
    select,
    terminal_tables,
    write_report,
)
from experiments.verification import verify, walls
from experiments.verification.bodies import hollow_hemisphere, of_blocks
from jaxthermo.errors import InputError
from jaxthermo.reference import slab as sine_mode


RIGHT = Check("right", computed=300.05, unit="K", expected=300.0, tolerance=0.1)
WRONG = Check("wrong", computed=301.0, unit="K", expected=300.0, tolerance=0.1)
FREE = Check("free", computed=301.0, unit="K", expected=300.0)


def case(*checks, order=None, id_="T1"):
    measured = Row(checks=checks, order=order)
    return Case(id_, "a case", "nobody", "0.1 K", "by hand", lambda: measured)


def verdict(*checks, order=None):
    return check(case(*checks, order=order)).verdict


def test_a_wrong_number_fails():
    assert verdict(RIGHT) == PASS
    assert verdict(RIGHT, WRONG) == FAIL
    assert verdict(replace(RIGHT, computed=math.nan)) == FAIL
    assert verdict(FREE) == REPORTED
    assert verdict(FREE, RIGHT) == PASS
    assert verdict(Check("low", 0.9, lowest=1.0)) == FAIL
    assert verdict(Check("nan", math.nan)) == FAIL


def test_a_low_order_fails_only_where_one_is_asked():
    slow = Order((1.0, 0.5, 0.25), (1.0, 0.5, 0.25), expected=2.0)
    assert slow.observed == (1.0, 1.0)
    assert verdict(RIGHT, order=slow) == FAIL
    assert verdict(RIGHT, order=replace(slow, expected=None)) == PASS
    assert verdict(RIGHT, order=replace(slow, errors=(1.0, 0.25, 0.06))) == PASS
    # No error at all has no order.
    assert verdict(RIGHT, order=replace(slow, errors=(1.0, 0.25, 0.0))) == FAIL


def broken():
    raise InputError("the wall\nhas no end")


def test_a_case_that_breaks_fails_and_says_why():
    outcome = check(replace(case(RIGHT), measure=broken))
    assert outcome.verdict == FAIL
    assert outcome.failure == "InputError: the wall has no end"
    assert outcome.worst is None


def test_the_worst_is_the_farthest_off_by_its_tolerance():
    nan = replace(RIGHT, computed=math.nan)
    assert _severity(WRONG) == pytest.approx(10.0)
    assert _severity(nan) == math.inf and _severity(FREE) == 0.0
    assert check(case(RIGHT, WRONG, FREE)).worst is WRONG
    assert check(case(RIGHT, nan, WRONG)).worst is nan


def test_failures_show_on_the_page_on_the_terminal_and_in_the_record(tmp_path):
    cases = (
        case(RIGHT),
        case(RIGHT, WRONG, id_="T2"),
        replace(case(RIGHT, id_="T3"), measure=broken),
        case(Check("open", math.inf), id_="T4"),
    )
    group = Group("Walls & ends", cases)
    outcomes = [check(each) for each in cases]
    write_report([(group, outcomes)], tmp_path / "report.html", verify.PAGE)
    text = (tmp_path / "report.html").read_text()
    failed, rest = text.split("<h2>All cases</h2>")
    assert "1 of 4 cases pass" in failed
    assert "T2" in failed and "wrong: 301 K, not 300 K" in failed
    assert "T3" in failed and "the wall has no end" in failed
    assert "reported: T4" in failed
    assert "Walls &amp; ends" in rest
    assert rest.count('class="left missed">FAIL') == 3
    assert all(name in rest for name, _ in verify.NOT_COVERED)
    console = Console(width=200, record=True, file=io.StringIO())
    for table in terminal_tables(group.title, outcomes):
        console.print(table.rich())
    lines = [row for row in console.export_text().splitlines() if "FAIL" in row]
    assert len(lines) == 2 and "T2" in lines[0] and "T3" in lines[1]
    rows = [_plain(outcome, group.title) for outcome in outcomes]
    json.dumps(rows, allow_nan=False)
    assert [row["verdict"] for row in rows] == [PASS, FAIL, FAIL, REPORTED]
    assert rows[1]["rows"][0]["checks"][1].get("error") == 1.0


def test_every_published_case_is_computed_or_said_not_to_be():
    ids = [c.id for group in verify.GROUPS for c in group.cases]
    assert len(set(ids)) == len(ids)
    known = " ".join([*ids, *(name for name, _ in verify.NOT_COVERED)]).replace(
        ",", " "
    )
    wanted = {f"V{n:02}" for n in (1, 2, 4, 5, 7, 9, 11, 12, 13, 14, 15, 16, 18)}
    wanted |= {"V20a", "V20b", "V21a", "V21b", "V21d", "V22a", "V23", "V24", "V25"}
    wanted |= {"A1", "A8", "A9", "A11", *(f"A{n}" for n in range(14, 20))}
    assert wanted <= set(known.split())


def test_cases_are_chosen_by_the_beginnings_of_their_ids():
    def case_ids(names):
        groups = select(verify.GROUPS, names)
        return [case.id for group in groups for case in group.cases]

    assert case_ids("V21") == ["V21a", "V21b", "V21d"]
    assert case_ids("a8, v04") == ["V04", "V20b, A8"]
    for wrong in ("V99", " , "):
        with pytest.raises(InputError, match="--cases"):
            select(verify.GROUPS, wrong)


@pytest.mark.parametrize(
    "names",
    [
        ["A14"],
        # A structure and a frame, whose programs take seconds to compile.
        pytest.param(
            ["V25, sol-air", "V25", "A17"], marks=[pytest.mark.slow, pytest.mark.slice]
        ),
    ],
)
def test_it_runs_from_the_catalogue(tmp_path, names):
    (experiment,) = catalogue.find("verification")
    record = catalogue.run(experiment, tmp_path, cases=",".join(names))
    found = record["result"]
    assert found["failed"] == [] and found["passed"] == names
    assert [row["id"] for row in found["cases"]] == names
    assert json.loads((tmp_path / "result.json").read_text()) == record
    page = (tmp_path / "report.html").read_text()
    assert all(name in page for name in names)


def test_the_composite_wall_is_the_listed_one():
    listed = [499.687851, 99.987539, 99.93757, 49.968785]
    assert list(walls._composite().values()) == pytest.approx(listed, abs=5.1e-7)


def test_closed_forms_of_the_sine_mode_are_those_listed():
    listed = {
        sine_mode.decay_explicit_euler: 0.61037425,
        sine_mode.decay_implicit_euler: 0.61185636,
        sine_mode.decay_crank_nicolson: 0.61111668,
    }
    rate = sine_mode.sine_rate_of_cells(1e-5, 0.1, 20)
    for form, value in listed.items():
        assert form(rate, 0.5, 100) == pytest.approx(value, abs=5e-9)


def assert_two_faces_share_every_edge(mesh):
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).all()


def test_blocks_make_a_closed_mesh():
    solid = np.ones((2, 2, 2), bool)
    solid[1, :, 1] = solid[:, 1, 1] = False
    planes = np.array([0.0, 1.0, 3.0])
    mesh = of_blocks(solid, planes, planes, planes)
    assert mesh.volume == pytest.approx(9.0 + 2.0)
    assert_two_faces_share_every_edge(mesh)


def test_a_hollow_hemisphere_holds_its_volume():
    mesh = hollow_hemisphere(0.5, 1.0)
    assert mesh.volume == pytest.approx(2 / 3 * np.pi * (1 - 0.125), rel=1e-12)
    assert_two_faces_share_every_edge(mesh)
