"""Runs of the command line that several tests look at."""

import pytest
from cli_runs import run, scene_file


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The folder of a finished run of the small scene; to be read only."""
    folder = tmp_path_factory.mktemp("finished")
    out = folder / "out"
    code, _, err = run("simulate", scene_file(folder), "--out", out)
    assert (code, err) == (0, "")
    return out
