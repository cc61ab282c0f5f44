"""Runs of the command line that several tests read."""

import pytest


# Asserts of the helpers explain themselves too.
pytest.register_assert_rewrite("cli_runs", "tests.cli.cli_runs")

from cli_runs import scene_file, succeed  # noqa: E402


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The folder of a finished run of the small scene; to be read only."""
    folder = tmp_path_factory.mktemp("finished")
    out = folder / "out"
    succeed("simulate", scene_file(folder), "--out", out)
    return out


@pytest.fixture
def scene(tmp_path):
    """The file of the small scene."""
    return scene_file(tmp_path)


@pytest.fixture
def out(tmp_path):
    """A folder for results, which is not there yet."""
    return tmp_path / "out"
