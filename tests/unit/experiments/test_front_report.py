"""The page of a front: one file with charts, tooltips and pictures; the table."""

import csv
import json
import re
from pathlib import Path

import pytest

from calibrate.study.front import points_of, rivals_of
from calibrate.study.front_charts import error_against
from calibrate.study.rows import append_rows
from experiments.front.report import Findings, write_report
from experiments.front.rivals import read_folder
from jaxthermo.errors import InputError
from tests.front_rows import row, time


PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c49444154789c63606060000000040001f61738550000000049454e44ae426082"
)


@pytest.fixture
def sweep(tmp_path) -> Path:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "a.png").write_bytes(PIXEL)
    rows = [
        row("shell", "+x", 5.0, picture="pictures/a.png",
            set={"bodies.0.structure": "single_shell"}),
        row("blocks </script>", "+x", 1.0),
        row("slow", "+x", 6.0),
        {"id": "f", "choice": {"structure": "bad"}, "load": "+x", "failed": "none"},
    ]  # fmt: skip
    times = [time("shell", "+x", 1.0), time("blocks </script>", "+x", 2.0)]
    times.append(time("slow", "+x", 3.0))
    rival = {"name": "numba RKL2", "choice": {"voxels": "50 high"}, "load": "+x"}
    rival |= {"error": row("r", "+x", 0.8)["error"], "loop_s": [4.0], "nodes": 5}
    rivals = [rival | {"memory_bytes": 8, "processor": "a processor"}]
    for name, file_rows in (("rows", rows), ("times", times), ("rivals", rivals)):
        append_rows(tmp_path / f"{name}.jsonl", file_rows)
    return tmp_path


def test_the_page_is_one_file_with_everything(sweep, tmp_path):
    folder = read_folder(sweep)
    points = points_of(folder.rows, folder.times, {"+x"})
    rivals = rivals_of(folder.rivals, {"+x"})
    out = tmp_path / "out"
    out.mkdir()
    findings = Findings(
        title="A front",
        about=["A ball."],
        folder=folder,
        points=points,
        rivals=rivals,
        comparisons=[],
        config={"a": 1},
    )
    files = write_report(findings, out)
    assert all((out / name).is_file() for name in files)
    page = (out / "report.html").read_text()
    assert not re.search(r"(src|href)=.(?!data:)|url\(|@import", page)
    # A label cannot end the script.
    assert page.count("</script>") == 1
    # Shell, blocks, the beaten one and the rival, in five charts that have them.
    assert page.count('data-tip="') >= 4 * 3
    assert '<td class="left">none</td>' in page and "a processor" in page
    (table,) = map(json.loads, re.findall(r"const tips = (.*);\n", page))
    pictures = {text: picture for text, picture in table}
    assert [bool(p) for t, p in pictures.items() if t.endswith("s: shell")] == [True]
    rows = list(csv.DictReader((out / "front.csv").read_text().splitlines()))
    assert [r["name"] for r in rows if r["on_front"] == "True"] == [
        "shell", "blocks </script>"
    ]  # fmt: skip
    assert [r["name"] for r in rows if r["is_rival"] == "True"] == [
        "numba RKL2, 50 high"
    ]


def test_without_a_known_cost_there_is_no_chart(sweep):
    folder = read_folder(sweep)
    points = points_of(folder.rows, [], {"+x"})
    assert error_against("time_s", points) is None
    assert error_against("nodes", points) is not None


def test_numbers_of_a_crowd_do_not_cover_each_other():
    errors = {"a": 5.0, "b": 1.01, "c": 1.0}
    rows = [row(name, "+x", error) for name, error in errors.items()]
    seconds = {"a": 1.0, "b": 2.0, "c": 2.01}
    times = [time(name, "+x", value) for name, value in seconds.items()]
    chart = error_against("time_s", points_of(rows, times, {"+x"}))
    assert chart is not None
    layers = chart.to_dict()["layer"]
    (numbers,) = (layer for layer in layers if layer["mark"]["type"] == "text")
    assert [label["number"] for label in numbers["data"]["values"]] == ["1", "2"]


def test_a_line_that_was_cut_off_is_left_out(sweep):
    complete = read_folder(sweep)
    with (sweep / "rows.jsonl").open("a") as file:
        file.write('{"id": "half')
    assert read_folder(sweep).rows == complete.rows


def test_a_folder_without_rows_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no rows of a sweep"):
        read_folder(tmp_path)
