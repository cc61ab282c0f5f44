"""The cache's folder, its limit, and what goes first; no failure stops a run."""

import errno
import logging
import os
from pathlib import Path
from typing import IO

import pytest

from jaxthermo.errors import InputError
from jaxthermo.memo import store
from jaxthermo.memo.store import (
    OLD_RELEASE,
    REFERENCE,
    cache_folder,
    clear,
    files_of,
    result_path,
    size_limit,
    write_entry,
)


SIZE = 1000
HASH = "0123456789abcdef0123456789abcdef01234567"
OLD_FILES = (
    f"structures/octree-{HASH}.npz",
    f"structures/.octree-{HASH}.12-01234567.npz",
    f"findings/view-{HASH}.bin",
    f"references/{HASH[:32]}.npz",
    f"references/{HASH[:32]}.json",
)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A cache for three files of 1000 bytes."""
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", str(3.4 * SIZE / 1024**3))
    return tmp_path


def write(folder: Path, category: str, number: int, size: int = SIZE) -> Path:
    """Write a file that was last used at a time that is its number."""

    def write_content(file: IO[bytes]) -> None:
        file.write(bytes(size))

    path = result_path(folder, category, f"{number:040x}")
    write_entry(folder, path=path, size=size, write=write_content)
    if path.exists():
        os.utime(path, (number, number))
    return path


def names(folder: Path) -> set[tuple[str, int]]:
    return {(entry.category, int(entry.used_at)) for entry in files_of(folder)}


def test_the_least_recently_used_go_first(folder):
    paths = [write(folder, "view", number) for number in range(3)]
    store.mark_used(paths[0])
    write(folder, "shadows", 3)
    assert [path.exists() for path in paths] == [True, False, True]
    assert len(files_of(folder)) == 3


def test_references_go_last(folder):
    write(folder, REFERENCE, 0)
    write(folder, REFERENCE, 1)
    for number in (2, 3):
        write(folder, "view", number)
        assert names(folder) == {(REFERENCE, 0), (REFERENCE, 1), ("view", number)}
    write(folder, REFERENCE, 4)
    write(folder, REFERENCE, 5)
    assert names(folder) == {(REFERENCE, 1), (REFERENCE, 4), (REFERENCE, 5)}


def test_compiled_programs_count_too(folder):
    program = store.program_folder(folder, "machine") / f"program-{HASH}.bin"
    write_entry(folder, path=program, size=SIZE, write=lambda file: None)
    program.write_bytes(bytes(SIZE))
    os.utime(program, (0, 0))
    for number in (1, 2, 3):
        write(folder, "view", number)
    assert not program.exists() and len(files_of(folder)) == 3


def test_files_of_others_are_neither_counted_nor_removed(folder):
    write(folder, "view", 0)
    mine = folder / "memo" / "mine.bin"
    mine.write_bytes(bytes(9 * SIZE))
    left_behind = folder / "memo" / f".view-{HASH}.12-01234567.bin"
    left_behind.write_bytes(bytes(SIZE))
    os.utime(left_behind, (1, 1))
    for number in (2, 3, 4):
        write(folder, "view", number)
    assert mine.exists() and not left_behind.exists()
    clear(files_of(folder))
    assert [path.name for path in folder.rglob("*.bin")] == ["mine.bin"]


def test_what_would_leave_no_room_is_not_stored(folder):
    assert not write(folder, "view", 1, size=2 * SIZE).exists()
    assert write(folder, REFERENCE, 1, size=2 * SIZE).exists()
    assert not write(folder, REFERENCE, 2, size=4 * SIZE).exists()


def test_small_files_stay_below_the_limit_too(folder):
    for number in range(60):
        write(folder, "view", number, size=SIZE // 10)
        assert sum(entry.size for entry in files_of(folder)) <= size_limit()
    assert len(files_of(folder)) > 25


@pytest.mark.parametrize("text", ["4GB", "-1", "nan", "inf", "much"])
def test_a_limit_that_is_no_size_is_said_once(tmp_path, monkeypatch, caplog, text):
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", text)
    with pytest.raises(InputError, match=f"GIB={text}: give the limit .* in GiB"):
        size_limit()
    for number in range(3):
        assert write(tmp_path, "view", number).exists()
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert record.getMessage().endswith("such as 4; it is 1 GiB")


def test_the_limit_is_a_gibibyte_by_default(monkeypatch):
    monkeypatch.delenv("JAXTHERMO_CACHE_GIB", raising=False)
    assert size_limit() == 1024**3
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", "2.5")
    assert size_limit() == 2.5 * 1024**3


def test_where_the_cache_is(monkeypatch):
    monkeypatch.delenv("JAXTHERMO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/mine")
    assert cache_folder() == Path("/var/mine/jaxthermo")
    monkeypatch.setenv("JAXTHERMO_CACHE", "on")
    assert cache_folder() == Path("/var/mine/jaxthermo")
    for unset in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", unset)
        monkeypatch.setenv("HOME", "/home/someone")
        assert cache_folder() == Path("/home/someone/.cache/jaxthermo")
    monkeypatch.setenv("JAXTHERMO_CACHE", "~/there")
    assert cache_folder() == Path("/home/someone/there")
    for none in ("~no-such-user/there", "off"):
        monkeypatch.setenv("JAXTHERMO_CACHE", none)
        assert cache_folder() is None


def test_a_full_disk_is_no_failure(folder):
    def write_until_full(file: IO[bytes]) -> None:
        file.write(b"a part")
        raise OSError(errno.ENOSPC, "No space left on device")

    path = result_path(folder, "view", HASH)
    write_entry(folder, path=path, size=SIZE, write=write_until_full)
    assert not list(path.parent.iterdir())


def test_a_folder_that_cannot_be_made_is_no_failure(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert not write(tmp_path / "file", "view", 1).exists()


def test_a_file_that_another_process_removed_is_no_error(folder, monkeypatch):
    path = write(folder, "view", 1)
    gone = path.with_name(f"view-{'0' * 40}.bin")
    monkeypatch.setattr(Path, "glob", lambda *_: iter([path, gone]))
    assert {entry.path for entry in files_of(folder)} == {path}
    store.mark_used(gone)


def old_cache(folder: Path) -> list[Path]:
    """Files of the last release, and one of the user."""
    paths = [folder / name for name in (*OLD_FILES, "structures/mine.npz")]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(2 * SIZE))
    return paths


def test_a_cache_of_the_last_release_is_said_once_and_left_alone(folder, caplog):
    paths = old_cache(folder)
    for number in range(5):
        write(folder, "view", number)
    (record,) = caplog.records
    message = record.getMessage()
    assert "\n" not in message and "not read" in message
    assert f"{folder} has 9.8 KiB" in message
    assert "`jaxthermo cache clear old-release`" in message
    assert all(path.exists() for path in paths)
    old = [entry for entry in files_of(folder) if entry.category == OLD_RELEASE]
    assert len(old) == len(OLD_FILES)
    clear(old)
    assert [path for path in paths if path.exists()] == paths[-1:]
    assert {path.name for path in folder.iterdir()} == {"structures", "memo"}


def test_a_new_cache_says_nothing(folder, caplog):
    write(folder, "view", 1)
    assert not caplog.records
