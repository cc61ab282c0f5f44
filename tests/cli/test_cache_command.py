"""`jaxthermo cache`: what is shown and cleared, and a cache of the last release."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

from jaxthermo.__main__ import main
from jaxthermo.memo.store import program_folder, result_path


ROOT = Path(__file__).resolve().parents[2]
KEY = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A cache with a file of each of three categories, and one of the user."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("JAXTHERMO_CACHE", str(folder))
    monkeypatch.delenv("JAXTHERMO_CACHE_GIB", raising=False)
    paths = [result_path(folder, name, KEY) for name in ("view", "reference")]
    paths.append(program_folder(folder, "machine") / f"program-{KEY}.bin")
    paths.append(folder / "memo" / "mine.bin")
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(1536))
    return folder


@pytest.fixture
def command(capsys):
    """A function from arguments to exit status, standard output, standard error."""

    def run(*arguments: str) -> tuple[object, str, str]:
        with pytest.raises(SystemExit) as stopped:
            main(["cache", *arguments])
        return (stopped.value.code, *capsys.readouterr())

    return run


def old_release(folder: Path) -> list[Path]:
    """Files as the last release wrote them."""
    names = (
        f"structures/octree-{KEY}.npz",
        f"findings/view-{KEY}.bin",
        f"references/{KEY[:32]}.npz",
        f"references/{KEY[:32]}.json",
    )
    paths = [folder / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(1024))
    return paths


def rows(text: str) -> dict[str, list[str]]:
    """Cells of the table by category."""
    words = [line.split() for line in text.splitlines()[1:]]
    return {line[0]: line[1:] for line in words if len(line) == 4}


def test_files_are_shown_by_category(command, folder):
    status, out, err = command()
    assert (status, err) == (0, "")
    assert out.splitlines()[0] == f"{folder}, limit 1.0 GiB"
    assert rows(out) == {
        "program": ["1", "1.5", "KiB"],
        "reference": ["1", "1.5", "KiB"],
        "view": ["1", "1.5", "KiB"],
        "total": ["3", "4.5", "KiB"],
    }
    assert command("show") == (status, out, err)


def test_categories_are_cleared_by_their_names(command, folder):
    assert command("clear", "view", "program") == (
        0,
        "files removed: 2 (3.0 KiB)\n",
        "",
    )
    assert set(rows(command()[1])) == {"reference", "total"}
    assert command("clear") == (0, "files removed: 1 (1.5 KiB)\n", "")
    assert rows(command()[1]) == {"total": ["0", "0", "B"]}
    assert [path.name for path in folder.rglob("*.*")] == ["mine.bin"]
    assert command("clear") == (0, "files removed: 0 (0 B)\n", "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("clear", "vew"), "there are no such files; choose program, reference, view"),
        (("show", "view"), "takes no categories"),
        (("empty",), "show"),
    ],
)
def test_a_mistake_is_one_line(command, folder, arguments, message):
    status, out, err = command(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_a_limit_that_is_no_size_is_refused(command, folder, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", "4GB")
    line = "jaxthermo: JAXTHERMO_CACHE_GIB=4GB: give the limit of the cache in GiB"
    status, out, err = command()
    assert (status, out, err) == (2, "", f"{line}, such as 4\n")
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", "4")
    assert "limit 4.0 GiB" in command()[1]


def test_a_cache_that_is_off(command, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    assert command() == (0, "The cache is off: JAXTHERMO_CACHE=off.\n", "")
    assert command("clear") == (0, "files removed: 0 (0 B)\n", "")


def test_a_cache_of_the_last_release_is_shown_and_cleared(command, folder):
    paths = old_release(folder)
    out = command()[1]
    assert rows(out)["old-release"] == ["4", "4.0", "KiB"]
    assert "of an earlier release, not read" in out.splitlines()[-1]
    assert command("clear", "old-release")[1] == "files removed: 4 (4.0 KiB)\n"
    assert not any(path.parent.exists() for path in paths)
    assert len(rows(command()[1])) == 4


def test_a_command_says_once_that_the_cache_is_of_the_last_release(tmp_path):
    """In one line, and neither reads nor removes it."""
    cache = tmp_path / "cache"
    paths = old_release(cache)
    mesh = tmp_path / "box.ply"
    trimesh.creation.box().export(mesh)
    words = ["-m", "jaxthermo", "voxelize", mesh, "--unit", "m", "--pitch", "20 cm"]
    environment = os.environ | {"JAXTHERMO_CACHE": str(cache), "COLUMNS": "80"}
    errors = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, *map(str, words)],
            capture_output=True,
            text=True,
            cwd=ROOT,
            env=environment,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        errors.append(done.stderr.splitlines())
    assert [line for line in errors[0] if str(cache) in line] == [
        f"jaxthermo: {cache} has 4.0 KiB of an earlier release, not read: "
        "`jaxthermo cache clear old-release` removes them"
    ]
    assert not any(str(cache) in line for line in errors[1])
    assert all(path.exists() for path in paths)
