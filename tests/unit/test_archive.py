"""Formats of files that a later command reads."""

import json

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.archive import (
    arrays_checksum,
    read_archive,
    read_record,
    signed,
    write_archive,
)


def archive(path, arrays):
    np.savez(path, **arrays, checksum=np.array(arrays_checksum(arrays)))


def test_an_archive_says_what_it_is_and_a_record_too(tmp_path):
    write_archive(
        tmp_path / "a.npz",
        format_name="solution",
        version=4,
        arrays={"x": np.arange(3)},
    )
    assert read_archive(
        tmp_path / "a.npz", format_name="solution", version=4, remedy=""
    ).keys() == {"x"}
    (tmp_path / "a.json").write_text(json.dumps(signed("result", 1, {"x": 3})))
    assert read_record(
        tmp_path / "a.json", format_name="result", version=1, remedy=""
    ) == {"x": 3}


def test_neither_is_read_with_the_format_of_the_other(tmp_path):
    head = {"format": np.array("solution"), "format_version": np.array(4)}
    archive(tmp_path / "a.npz", head)
    with pytest.raises(jt.InputError, match="not a solution of jaxthermo"):
        read_archive(tmp_path / "a.npz", format_name="solution", version=4, remedy="")
    # With the word of an archive it is read: the rest of the file is right.
    archive(tmp_path / "a.npz", head | {"format": np.array("jaxthermo solution")})
    assert (
        read_archive(tmp_path / "a.npz", format_name="solution", version=4, remedy="")
        == {}
    )
    (tmp_path / "a.json").write_text(json.dumps(signed("jaxthermo result", 1, {})))
    with pytest.raises(jt.InputError, match="not a result of jaxthermo"):
        read_record(tmp_path / "a.json", format_name="result", version=1, remedy="")
