"""Rows on disk: kept, reused, tried again, not lost with a line that was cut off."""

import json

import numpy as np
import pytest

from experiments.harness.record import Record
from jaxthermo.errors import InputError


class Maker:
    """Counts how often a row is made."""

    def __init__(self):
        self.calls = 0

    def __call__(self):
        self.calls += 1
        return {"value": self.calls}, {"line": np.arange(3.0)}


HEAD = {"what": "structure"}


def test_a_row_is_made_once_and_read_back_by_the_next_run(tmp_path):
    make = Maker()
    first = Record(tmp_path).once({"a": 1}, HEAD, make)
    again = Record(tmp_path)
    second = again.once({"a": 1}, HEAD, make)
    assert first == second and make.calls == 1
    assert second["what"] == "structure" and second["value"] == 1
    np.testing.assert_array_equal(again.arrays_of(second)["line"], [0, 1, 2])


def test_another_identity_is_another_row_in_the_same_file(tmp_path):
    make, record = Maker(), Record(tmp_path)
    record.once({"a": 1}, HEAD, make)
    record.once({"a": 2}, HEAD, make)
    assert make.calls == 2
    lines = (tmp_path / "rows.jsonl").read_text().splitlines()
    assert [json.loads(line)["value"] for line in lines] == [1, 2]


def test_a_line_that_was_cut_off_is_made_again_and_harms_no_other(tmp_path):
    make, record = Maker(), Record(tmp_path)
    record.once({"a": 1}, HEAD, make)
    record.once({"a": 2}, HEAD, make)
    path = tmp_path / "rows.jsonl"
    path.write_text(path.read_text()[:-20])
    again = Record(tmp_path)
    assert again.known({"a": 1}) and not again.known({"a": 2})
    again.once({"a": 2}, HEAD, make)
    last = Record(tmp_path)
    assert last.known({"a": 1}) and last.known({"a": 2}) and make.calls == 3


def test_a_row_without_its_arrays_is_made_again(tmp_path):
    make, record = Maker(), Record(tmp_path)
    record.once({"a": 1}, HEAD, make)
    for path in (tmp_path / "arrays").iterdir():
        path.unlink()
    assert not Record(tmp_path).known({"a": 1})


def test_damaged_arrays_are_told(tmp_path):
    record = Record(tmp_path)
    row = record.once({"a": 1}, HEAD, Maker())
    for path in (tmp_path / "arrays").iterdir():
        path.write_bytes(b"PK")
    with pytest.raises(InputError, match="delete it"):
        record.arrays_of(row)


def test_a_refused_row_says_why_and_is_tried_again(tmp_path):
    def refuse():
        raise InputError("needs 9 GiB")

    row = Record(tmp_path).once({"a": 1}, HEAD, refuse)
    assert row["refused"] == "needs 9 GiB" and row["what"] == "structure"
    again = Record(tmp_path).once({"a": 1}, HEAD, Maker())
    assert "refused" not in again and again["value"] == 1


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "arrays").write_text("")
    with pytest.raises(InputError, match="--out"):
        Record(tmp_path)
