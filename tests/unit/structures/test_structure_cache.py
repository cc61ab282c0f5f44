"""The cache gives back what was built, for the same voxels only, and never fails."""

import errno
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxthermo import user_cache
from jaxthermo.structures import cache
from jaxthermo.structures.cache import cache_folder, cached
from jaxthermo.structures.structure import Built, Links, Nodes
from tests.bodies import blocks


ROOT = Path(__file__).parents[3]


class Builder:
    """Makes distinct arrays and counts how often it was asked."""

    def __init__(self):
        self.calls = 0

    def __call__(self, grid=None, **options) -> Built:
        del grid, options
        self.calls += 1
        index = np.arange(6, dtype=np.int32)
        return Built(
            nodes=Nodes(
                centre=np.arange(18.0).reshape(6, 3),
                volume=index + 0.5,
                level=index % 3,
                location=np.arange(18.0, 36.0).reshape(6, 3),
            ),
            links=Links(
                index[:-1], index[1:], *(np.full((3, 5), 2.0) * [[1], [2], [3]])
            ),
            fragment_node=index[::-1].copy(),
            voxel_node=index - 1,
        )


def arrays(built: Built) -> list[np.ndarray]:
    return [*built.nodes, *built.links, built.fragment_node, built.voxel_node]


def assert_same(first: Built, second: Built) -> None:
    for actual, expected in zip(arrays(first), arrays(second), strict=True):
        assert actual.dtype == expected.dtype
        np.testing.assert_array_equal(actual, expected)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty cache that keeps bodies of any size."""
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "_MIN_VOXELS", 1)
    return tmp_path / "structures"


@pytest.fixture
def grid():
    return blocks(np.ones((2, 3, 4), bool))


def test_a_hit_gives_the_same_arrays_without_building(folder, grid):
    build = Builder()
    first = cached("kind", grid, {"levels": None}, build)
    again = cached("kind", blocks(np.ones((2, 3, 4), bool)), {"levels": None}, build)
    assert build.calls == 1
    assert_same(first, again)


def test_whatever_a_structure_follows_from_is_a_miss(folder, grid):
    build = Builder()
    hole = grid.solid.copy()
    hole[0, 0, 0] = False
    moved = replace(grid.lattice, origin=np.array([0.0, 0.0, 1.0]))
    misses = [
        ("other", grid, {}),
        ("kind", grid, {"levels": 2}),
        ("kind", grid, {"levels": "2"}),
        ("kind", grid, {"levels": np.array([2, 3])}),
        ("kind", grid, {"levels": np.array([2, 4])}),
        ("kind", replace(grid, solid=hole), {}),
        ("kind", replace(grid, lattice=moved), {}),
        ("kind", replace(grid, volume_ratio=0.9), {}),
        ("kind", replace(grid, mesh=grid.mesh.moved((1.0, 0.0, 0.0))), {}),
        ("kind", replace(grid, fragment_normal=-grid.fragment_normal), {}),
        ("kind", replace(grid, fragment_position=2 * grid.fragment_position), {}),
        ("kind", replace(grid, fragment_voxel=grid.fragment_voxel[::-1]), {}),
    ]
    cached("kind", grid, {}, build)
    for number, (name, body, options) in enumerate(misses):
        cached(name, body, options, build)
        assert build.calls == number + 2
    assert len(list(folder.iterdir())) == len(misses) + 1


def test_options_of_no_known_meaning_are_a_defect(folder, grid):
    with pytest.raises(TypeError, match="object"):
        cached("kind", grid, {"levels": object()}, Builder())


def test_edited_code_builds_anew(folder, grid, monkeypatch):
    build = Builder()
    cached("kind", grid, {}, build)
    monkeypatch.setattr(cache, "code_hash", lambda *names: "edited")
    cached("kind", grid, {}, build)
    assert build.calls == 2


def test_any_damaged_byte_is_noticed(folder, grid):
    """Flipped anywhere, the file gives the arrays that were kept, or is rebuilt."""
    build = Builder()
    right = cached("kind", grid, {}, build)
    (path,) = folder.iterdir()
    content = path.read_bytes()
    for position in range(0, len(content), 7):
        path.write_bytes(
            content[:position]
            + bytes([content[position] ^ 255])
            + content[position + 1 :]
        )
        assert_same(cached("kind", grid, {}, build), right)
    assert build.calls > 100


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04", None])
def test_a_foreign_file_is_replaced(folder, grid, content):
    build = Builder()
    right = cached("kind", grid, {}, build)
    (path,) = folder.iterdir()
    if content is None:
        np.savez(path, something=np.arange(3))
    else:
        path.write_bytes(content)
    assert_same(cached("kind", grid, {}, build), right)
    assert_same(cached("kind", grid, {}, build), right)
    assert build.calls == 2


def test_an_archive_of_python_objects_is_not_opened(folder, grid):
    build = Builder()
    cached("kind", grid, {}, build)
    (path,) = folder.iterdir()
    with np.load(path) as file:
        content = dict(file)
    content["fragment_node"] = np.array([{"any": "object"}], dtype=object)
    np.savez(path, allow_pickle=True, **content)
    cached("kind", grid, {}, build)
    assert build.calls == 2


def test_threads_at_once_all_get_the_arrays(folder, grid):
    results = []
    work = [
        threading.Thread(
            target=lambda: results.append(cached("kind", grid, {}, Builder()))
        )
        for _ in range(8)
    ]
    for thread in work:
        thread.start()
    for thread in work:
        thread.join()
    assert len(results) == 8
    for built in results:
        assert_same(built, Builder()())
    assert len(list(folder.iterdir())) == 1


def build_read_and_remove() -> None:
    """What each of two processes does in the same folder."""
    cache._MIN_VOXELS = 1
    grid = blocks(np.ones((2, 3, 4), bool))
    for n in range(40):
        assert_same(cached("kind", grid, {"n": n % 3}, Builder()), Builder()())
        if n % 5 == 0:
            folder = Path(os.environ["JAXTHERMO_CACHE"], "structures")
            for path in sorted(folder.glob("*.npz"))[:1]:
                path.unlink(missing_ok=True)


def test_processes_at_once_take_files_away_from_under_each_other(folder):
    code = (
        "from tests.unit.structures import test_structure_cache as test\n"
        "print('ready', flush=True)\n"
        "test.build_read_and_remove()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT
    )
    assert process.stdout is not None
    with process.stdout as said:
        assert said.readline() == b"ready\n"
        build_read_and_remove()
    assert process.wait(60) == 0
    assert len(list(folder.iterdir())) == 3


def test_off_and_small_bodies_leave_nothing(tmp_path, monkeypatch, grid):
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))
    build = Builder()
    cached("kind", grid, {}, build)
    monkeypatch.setattr(cache, "_MIN_VOXELS", 1)
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    cached("kind", grid, {}, build)
    assert build.calls == 2
    assert not list(tmp_path.iterdir())


def test_where_structures_are_kept(monkeypatch):
    monkeypatch.delenv("JAXTHERMO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/mine")
    assert cache_folder() == Path("/var/mine/jaxthermo/structures")
    for unset in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", unset)
        monkeypatch.setenv("HOME", "/home/someone")
        assert cache_folder() == Path("/home/someone/.cache/jaxthermo/structures")
    monkeypatch.setenv("JAXTHERMO_CACHE", "~/there")
    assert cache_folder() == Path("/home/someone/there/structures")
    monkeypatch.setenv("JAXTHERMO_CACHE", "~no-such-user/there")
    assert cache_folder() is None


def test_a_folder_that_cannot_be_made_is_no_failure(tmp_path, monkeypatch, grid):
    monkeypatch.setattr(cache, "_MIN_VOXELS", 1)
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "file"))
    assert_same(cached("kind", grid, {}, Builder()), Builder()())


def test_a_full_disk_is_no_failure(folder, grid, monkeypatch):
    def full(file, **_):
        file.write(b"a part")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    assert_same(cached("kind", grid, {}, Builder()), Builder()())
    assert not list(folder.iterdir())


def test_what_was_not_used_for_longest_goes_first(folder, grid, monkeypatch):
    build = Builder()
    for n in range(3):
        cached("kind", grid, {"n": n}, build)
    # The size of each file; what is not ours is never touched.
    size = max(path.stat().st_size for path in folder.iterdir())
    (folder / "mine.npz").write_bytes(bytes(size))
    left_behind = folder / f".kind-{'0' * 40}.01234567.npz"
    left_behind.write_bytes(bytes(size))
    for path in folder.iterdir():
        os.utime(path, (0, 0))
    cached("kind", grid, {"n": 0}, build)
    assert build.calls == 3
    monkeypatch.setattr(cache, "_MAX_BYTES", int(2.5 * size))
    cached("kind", grid, {"n": 3}, build)
    assert {p.name for p in folder.iterdir()} > {"mine.npz"}
    assert len(list(folder.iterdir())) == 3 and not left_behind.exists()
    cached("kind", grid, {"n": 0}, build)
    cached("kind", grid, {"n": 3}, build)
    assert build.calls == 4
    cached("kind", grid, {"n": 1}, build)
    assert build.calls == 5


def test_what_would_leave_no_room_is_not_kept(folder, grid, monkeypatch):
    monkeypatch.setattr(cache, "_MAX_BYTES", 100)
    cached("kind", grid, {}, Builder())
    assert not folder.exists()


def test_a_file_that_another_process_removed_is_no_error(folder, grid, monkeypatch):
    cached("kind", grid, {"n": 0}, Builder())
    (path,) = folder.iterdir()
    gone = path.with_name(f"kind-{'0' * 40}.npz")
    listed = [*folder.iterdir(), gone]
    monkeypatch.setattr(Path, "iterdir", lambda _: iter(listed))
    user_cache.make_room(folder.iterdir(), cache._OWN_FILES, cache._MAX_BYTES)
    assert path.exists()
