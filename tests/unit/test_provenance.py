"""The origin of results: versions, the processor's name, the commit of the code."""

import json
import os
import subprocess
from datetime import datetime

import pytest

from jaxthermo import provenance
from jaxthermo.provenance import commit, processor


def git(folder, *arguments):
    who = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    done = ["git", "-C", str(folder), *who, *arguments]
    return subprocess.run(done, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def checkout(tmp_path):
    git(tmp_path, "init", "-q")
    (tmp_path / "code.py").write_text("one = 1\n")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "one")
    commit.cache_clear()
    return tmp_path


def test_a_result_has_all_of_its_origin():
    origin = provenance.provenance("0123", 7)
    assert origin["config_hash"] == "0123" and origin["seed"] == 7
    assert {"python", "jaxthermo", "jax", "jaxlib", "numpy"} <= set(origin["versions"])
    assert origin["device"].startswith("cpu: ")
    assert datetime.fromisoformat(origin["date"]).utcoffset() is not None
    assert json.loads(json.dumps(origin)) == origin


def test_the_processor_is_named_with_the_cores_that_may_be_used(monkeypatch, tmp_path):
    cores = len(os.sched_getaffinity(0))
    assert processor().endswith(f", {cores} core{'s' * (cores != 1)}")
    info = tmp_path / "cpuinfo"
    info.write_text("processor : 0\nmodel name\t: A: fast one\nmodel name : B\n")
    assert provenance._model_name(info) == "A: fast one"
    assert provenance._model_name(tmp_path / "missing") == ""
    # A system without the file, or a processor that it does not name.
    monkeypatch.setattr(provenance, "_model_name", lambda: "")
    assert processor().partition(",")[0]


def test_a_commit_says_if_the_code_was_changed(checkout):
    head = git(checkout, "rev-parse", "HEAD").strip()
    assert commit(checkout) == head[:12]
    # Results in the checkout are no code.
    (checkout / "rows.jsonl").write_text("{}")
    commit.cache_clear()
    assert commit(checkout) == head[:12]
    (checkout / "code.py").write_text("one = 2\n")
    commit.cache_clear()
    assert commit(checkout) == f"{head[:12]}+changes"


def test_code_inside_another_repository_has_no_commit(checkout, monkeypatch):
    inside = checkout / "site-packages"
    inside.mkdir()
    assert commit(inside) is None
    monkeypatch.setattr(provenance, "_ROOT", inside)
    assert "commit" not in provenance.provenance()


def test_without_git_there_is_no_commit(checkout, monkeypatch):
    monkeypatch.setenv("PATH", str(checkout))
    assert commit(checkout) is None
