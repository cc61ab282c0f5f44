"""`experiments compare` and `experiments report`: terminal, JSON, page, refusals."""

import json
import shutil
from functools import partial
from html.parser import HTMLParser

import numpy as np
import pytest
from cli_runs import run, scene_file
from PIL import Image
from stored_results import experiment, fit, plan, row, run_summary, stored, sweep

from experiments.__main__ import main
from experiments.results.read import Damaged, find_results


command = partial(run, main=main)


@pytest.fixture
def folder(tmp_path):
    """One result of each kind, one that is damaged and one not finished."""
    results = tmp_path / "results"
    stored(results / "a <b>" / "run", "summary.json", run_summary())
    frames = results / "a <b>" / "run" / "frames"
    frames.mkdir()
    Image.fromarray(np.full((40, 60, 3), 200, np.uint8)).save(frames / "t1.png")
    fit(results / "fit", 1.0)
    (results / "fit" / "report.html").write_text("x")
    sweep(results / "sweep", [row("full", 0.1)], {"full+x": [1.0, 1.1]})
    experiment(results / "stencil", height=3.0)
    plan(results / "plan", 0.01)
    stored(results / "broken", "summary.json", {})
    stored(results / "cut off", "config.yaml", {}, [row("full", 0.1)])
    return results


class Links(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.addresses = []
        self.pictures = 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag == "a":
            self.addresses.append(attributes["href"])
        self.pictures += tag == "img" and str(attributes["src"]).startswith("data:")


def test_the_page_lists_all_results_and_the_damaged_ones(folder):
    code, out, err = command("report", folder)
    assert (code, err) == (0, "")
    assert "5 results in " in out and out.count("not readable") == 2
    text = (folder / "index.html").read_text()
    links = Links(text)
    assert set(links.addresses) == {
        "a%20%3Cb%3E/run/summary.json",
        "fit/report.html",
        "sweep/result.json",
        "stencil/result.json",
        "plan/plan.json",
    }
    assert links.pictures == 1
    told = "receipt is missing", "not finished", "100 nodes, 12 steps", "fastest: 10 ms"
    for words in (*told, "A,"):
        assert words in text
    # Nothing is loaded from elsewhere, and names are no markup.
    assert "http" not in text and "<b>" not in text


def test_results_are_found_in_order_and_without_their_parts(folder):
    (folder / "sweep" / "pictures").mkdir()
    stored(folder / "sweep" / "pictures", "summary.json", run_summary())
    found_results = list(find_results(folder))
    result_kinds = [
        result.kind for result in found_results if not isinstance(result, Damaged)
    ]
    assert result_kinds == ["run", "fit", "plan", "experiment", "sweep"]
    assert len(found_results) == 7


def test_the_commands_at_the_terminal(folder, tmp_path):
    old = folder / "stencil"
    new = experiment(tmp_path / "other", height=4.0)
    code, out, err = command("compare", old, new)
    assert (code, err) == (0, "")
    assert "height" in out and out.rstrip().endswith("nothing else changed")
    code, out, err = command("compare", old, new, "--json")
    comparison = json.loads(out)
    assert comparison["numbers"] == [{"key": "height", "old": 3.0, "new": 4.0}]
    code, out, err = command("compare", old, old / "result.json")
    assert (code, out) == (0, "nothing changed\n")
    code, out, err = command("compare", old, folder / "fit")
    assert code == 2 and not out and err.count("\n") == 1
    shutil.rmtree(folder)
    code, out, err = command("report", folder)
    assert code == 2 and not out and err.count("\n") == 1
    folder.mkdir()
    code, out, err = command("report", folder)
    assert code == 2 and "no result in it" in err and not list(folder.iterdir())


def simulated(folder, change):
    out = folder / "changed"
    assert run("simulate", scene_file(folder), "--set", change, "--out", out)[0] == 0
    return out


def test_runs_are_compared_point_by_point(finished, tmp_path):
    code, out, _ = command("compare", finished, finished)
    assert (code, out) == (0, "nothing changed\n")
    warm = simulated(tmp_path, "terms.0.irradiance=6 kW/m^2")
    code, out, _ = command("compare", finished, warm, "--json")
    comparison = json.loads(out)
    assert [change["key"] for change in comparison["config"]] == ["terms.0.irradiance"]
    (surface,) = (
        number for number in comparison["numbers"] if "surface" in number["key"]
    )
    assert surface["new"] > 0.01 and "at the same surface cells" in surface["note"]


@pytest.mark.slow
def test_runs_of_other_voxels_are_compared_on_the_mesh(finished, tmp_path):
    coarse = simulated(tmp_path, "bodies.0.voxels_high=8")
    code, out, _ = command("compare", finished, coarse, "--json")
    (surface,) = (e for e in json.loads(out)["numbers"] if "surface t" in e["key"])
    assert surface["new"] > 0.01 and "at points on the mesh" in surface["note"]
    # A solution that cannot be read: the summaries are what is left.
    (coarse / "solution.npz").write_bytes(b"cut")
    code, out, _ = command("compare", finished, coarse, "--json")
    assert "not compared point by point" in json.loads(out)["remarks"][0]
    assert any(
        "of the surface" in number["key"] for number in json.loads(out)["numbers"]
    )
