"""Results on disk: the same in the next process for the same input, never an error."""

import subprocess
import sys
import threading
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.memo import store, stored as stored_module
from jaxthermo.memo.content_hash import content_hash
from jaxthermo.memo.store import without_cache
from jaxthermo.memo.stored import stored, stored_search
from jaxthermo.memo.values import read_value
from jaxthermo.voxels.voxelize import _voxelized


ROOT = Path(__file__).resolve().parents[3]


class Pair(NamedTuple):
    """A result as searches have it."""

    first: np.ndarray
    second: object = None


@dataclass(frozen=True)
class Record:
    """Another one."""

    values: tuple
    name: str = ""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """An empty cache that keeps searches of any duration."""
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))
    monkeypatch.setattr(stored_module, "_MIN_SECONDS", 0.0)
    return tmp_path / "memo"


class Search:
    """A search that counts how often it is made."""

    def __init__(self, value: object):
        self.value = value
        self.calls = 0

    def __call__(self) -> object:
        self.calls += 1
        return self.value


def assert_same(actual: object, expected: object) -> None:
    assert type(actual) is type(expected)
    if isinstance(actual, np.ndarray):
        assert isinstance(expected, np.ndarray) and actual.dtype == expected.dtype
        np.testing.assert_array_equal(actual, expected)
    elif isinstance(actual, csr_array):
        assert isinstance(expected, csr_array) and actual.shape == expected.shape
        assert_same(actual.toarray(), expected.toarray())
    elif isinstance(actual, Record):
        assert isinstance(expected, Record)
        assert_same((actual.values, actual.name), (expected.values, expected.name))
    elif isinstance(actual, dict):
        assert isinstance(expected, dict)
        assert_same(list(actual.items()), list(expected.items()))
    elif isinstance(actual, tuple | list):
        assert isinstance(expected, tuple | list) and len(actual) == len(expected)
        for mine, theirs in zip(actual, expected, strict=True):
            assert_same(mine, theirs)
    else:
        assert actual == expected or (actual != actual and expected != expected)


VALUES = [
    None,
    (1, 2.5, "text", True, [float("inf"), float("nan")]),
    np.arange(24.0).reshape(2, 3, 4)[:, ::2],
    np.zeros((0, 3), np.int32),
    np.arange(200_000).reshape(2, -1) % 3 == 0,
    np.float64(0.1),
    b"bytes",
    Pair(np.arange(3), Record((np.ones(2, np.float32), None), "a name")),
    {(0, 1): Pair(np.eye(2)), "b": ()},
    csr_array(np.array([[0.0, 2.0], [3.0, 0.0], [0.0, 0.0]])),
]


@pytest.mark.parametrize("value", VALUES, ids=lambda v: type(v).__name__)
def test_what_was_found_is_read_again(folder, value):
    search = Search(value)
    for _ in range(3):
        assert_same(
            stored(
                "a_search", inputs=("given", 1), compute=search, types=(Pair, Record)
            ),
            value,
        )
    assert search.calls == 1
    assert len(list(folder.iterdir())) == 1


def test_whatever_a_search_starts_from_is_a_miss(folder, monkeypatch):
    grid = jt.voxelize(jt.shapes.box((0.03, 0.02, 0.01)), 0.005)
    inputs = [
        *(None, 1, 1.0, True, "1", b"1", (1,), [(1,)], {"1": 1}, np.float32(1)),
        *(np.ones(2), np.ones(2, int), np.ones((2, 1)), -np.ones(2)),
        *(jt.Pose(), jt.Pose((1.0, 0.0, 0.0)), grid, grid.mesh),
        jt.voxelize(jt.shapes.box((0.03, 0.02, 0.02)), 0.005),
    ]
    search = Search(0)
    for value in inputs:
        stored("a_search", value, search)
    assert search.calls == len(inputs)
    stored("another", 1, search)
    monkeypatch.setattr(stored_module, "code_hash", lambda *names: "edited")
    stored("a_search", 1, search)
    assert search.calls == len(inputs) + 2


def test_the_hash_of_a_number_does_not_depend_on_how_numpy_prints_it():
    """In its older style a number of float32 is printed as one of Python."""
    numbers = np.float32(1), 1.0
    usual = [content_hash(number) for number in numbers]
    with np.printoptions(legacy="1.25"):
        assert [content_hash(number) for number in numbers] == usual
    assert len(set(usual)) == 2


def test_equal_bodies_have_equal_hashes():
    spheres = [jt.shapes.sphere(0.02) for _ in range(2)]
    first, second = (_voxelized(sphere, 0.005, "crossings") for sphere in spheres)
    assert first is not second
    assert content_hash(first) == content_hash(second)


@pytest.mark.parametrize("inputs", [object(), len, jnp.ones(2), {"a": lambda: 1}])
def test_what_has_no_known_content_is_not_stored(folder, inputs):
    search = Search(1)
    stored("a_search", inputs, search)
    stored("a_search", inputs, search)
    assert search.calls == 2 and not folder.exists()


@pytest.mark.parametrize("value", [object(), jnp.ones(2), np.array([None]), Pair])
def test_what_cannot_be_stored_is_found_again(folder, value):
    search = Search(value)
    assert stored("a_search", 1, search) is value
    assert stored("a_search", 1, search) is value
    assert search.calls == 2 and not folder.exists()


def test_any_damaged_byte_is_noticed(folder):
    search = Search(Pair(np.arange(9.0), "text"))
    stored("a_search", inputs=1, compute=search, types=(Pair,))
    (path,) = folder.iterdir()
    intact = path.read_bytes()
    for byte in range(len(intact)):
        flipped = bytes([intact[byte] ^ 255])
        path.write_bytes(intact[:byte] + flipped + intact[byte + 1 :])
        assert_same(
            stored("a_search", inputs=1, compute=search, types=(Pair,)), search.value
        )
    for cut in range(0, len(intact), 7):
        path.write_bytes(intact[:cut])
        assert_same(
            stored("a_search", inputs=1, compute=search, types=(Pair,)), search.value
        )
    path.write_bytes(intact + b"more")
    assert_same(
        stored("a_search", inputs=1, compute=search, types=(Pair,)), search.value
    )
    # A line end may be another character that ends a number as well.
    assert search.calls > len(intact)


def test_threads_and_processes_at_once(folder):
    code = (
        "import numpy as np\n"
        "from jaxthermo.memo import stored as s\n"
        "s._MIN_SECONDS = 0.0\n"
        "print('ready', flush=True)\n"
        "for n in range(60):\n"
        "    k = n % 3\n"
        "    found = s.stored('a_search', k, lambda: np.full(9999, k))\n"
        "    assert (found == k).all() and found.shape == (9999,)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=ROOT
    )
    assert process.stdout is not None
    got = []

    def work() -> None:
        for n in range(60):
            k = n % 3
            array = stored("a_search", k, lambda k=k: np.full(9999, k))
            got.append(bool((array == k).all()))
            if n % 7 == 0 and folder.exists():
                for path in list(folder.glob("a_search-*"))[:1]:
                    path.unlink(missing_ok=True)

    with process.stdout as said:
        assert said.readline() == b"ready\n"
        threads = [threading.Thread(target=work) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert process.wait(60) == 0
    assert len(got) == 180 and all(got)
    assert all(path.name.startswith("a_search-") for path in folder.iterdir())


def test_off_unwritable_and_fast_searches_store_nothing(tmp_path, monkeypatch):
    search = Search(1)
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path))
    assert stored("a_search", 1, search) == 1
    monkeypatch.setattr(stored_module, "_MIN_SECONDS", 0.0)
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    assert stored("a_search", 1, search) == 1
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("JAXTHERMO_CACHE", str(tmp_path / "file"))
    assert stored("a_search", 1, search) == 1
    assert search.calls == 3
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_nothing_is_read_where_searches_are_timed(folder):
    search = Search(1)
    stored("a_search", 1, search)
    with without_cache():
        stored("a_search", 1, search)
    stored("a_search", 1, search)
    assert search.calls == 2


# By default every kind of search is tested by itself.
@pytest.mark.slow
def test_a_scene_has_the_same_surface_with_and_without(folder, monkeypatch):
    """Every search of a scene, found, read again, and with the cache off."""

    def everything():
        grid = jt.voxelize(jt.shapes.sphere(0.02), 0.005)
        plate = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.01)), 0.005)
        steel = jt.materials["stainless_steel"]
        scene = jt.Scene(
            bodies=(
                jt.Body(jt.FullVolume(grid), steel, temperature=300.0),
                jt.Body(
                    jt.FullVolume(plate),
                    steel,
                    temperature=290.0,
                    pose=jt.Pose((0.0, 0.0, -0.024)),
                ),
            ),
            terms=(
                jt.Sun((-1.0, 0.0, -0.5), 800.0),
                jt.PointSource((0.2, 0.0, 0.2), 20.0),
                jt.Wind(
                    (3.0, 0.0, 0.0),
                    290.0,
                    wake=jt.WakeDeficit(),
                    body_shape="cylinder",
                ),
                jt.RadiativeExchange(280.0),
                jt.Contact(2000.0),
            ),
        )
        # Every heat flux is in the temperatures of the surface at the start.
        solution = jt.simulate(scene, 0.0)
        camera = jt.Camera((0.3, 0.1, 0.1), (0.0, 0.0, 0.0), width=24, height=18)
        return np.asarray(solution.surface_temperature), jt.render(solution, camera)

    first = everything()
    searches = {path.name.split("-")[0] for path in folder.iterdir()}
    assert searches >= {"voxels", "shadows", "point_shadows", "wakes", "cylinders"}
    assert searches >= {"contacts", "refined_view_factors", "view"}
    jt.forget_findings()
    count = len(list(folder.iterdir()))
    again = everything()
    assert len(list(folder.iterdir())) == count
    monkeypatch.setenv("JAXTHERMO_CACHE", "off")
    jt.forget_findings()
    without = everything()
    for repeated in (again, without):
        np.testing.assert_array_equal(repeated[0], first[0])
        np.testing.assert_array_equal(repeated[1].temperature, first[1].temperature)


def test_a_decorated_search_keeps_its_name(folder):
    calls = []

    @stored_search("squares")
    def squares(count: int, *, scale: float = 1.0) -> np.ndarray:
        """Numbers."""
        calls.append(count)
        return scale * np.arange(count) ** 2

    assert squares.__name__ == "squares" and squares.__doc__ == "Numbers."
    for _ in range(2):
        assert_same(squares(3, scale=2.0), np.array([0.0, 2.0, 8.0]))
        assert_same(squares(3), np.array([0.0, 1.0, 4.0]))
    assert calls == [3, 3]


def test_a_file_with_arrays_of_objects_is_not_opened(folder):
    """Such arrays are addresses of objects."""
    search = Search(np.arange(9.0))
    stored("a_search", 1, search)
    (path,) = folder.iterdir()
    content = path.read_bytes()[:-4].replace(b"<f8", b"|O8")
    path.write_bytes(content + zlib.crc32(content).to_bytes(4, "little"))
    assert_same(stored("a_search", 1, search), search.value)
    assert search.calls == 2


def test_what_is_read_owns_its_memory(folder):
    """A part of a result does not keep the others alive, and can be a finding."""
    arrays = [np.arange(9.0), np.arange(20)]
    stored("a_search", 1, lambda: arrays)
    again = stored("a_search", 1, lambda: arrays)
    assert again is not arrays
    for array in again:
        assert array.base is None and array.flags.writeable


KILLING = """
import os, random, signal, sys, time
from pathlib import Path
import numpy as np
from jaxthermo.memo import store
from jaxthermo.memo.values import PlainValue
folder = Path(sys.argv[1])
def write_for_ever(n):
    while True:
        value = PlainValue.of(np.full(200_000, n), list)
        path = store.result_path(folder, "numbers", f"{n:040x}")
        store.write_entry(folder, path, value.size, value.write)
        n = (n + 1) % 3
random.seed(1)
for turn in range(60):
    child = os.fork()
    if not child:
        write_for_ever(turn % 3)
    time.sleep(random.uniform(0.0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_writers_that_are_killed_leave_whole_files(folder, monkeypatch):
    subprocess.run([sys.executable, "-c", KILLING, folder.parent], check=True, cwd=ROOT)
    entries = store.files_of(folder.parent)
    finished = [entry for entry in entries if entry.category == "numbers"]
    # On a busy machine some are killed before they have written anything.
    assert 1 <= len(finished) <= 3
    for entry in finished:
        with entry.path.open("rb") as file:
            value = read_value(file, {})
        assert_same(value, np.full(200_000, int(entry.path.stem[-1])))
    # Others are what killed writers left behind, and go as all files do.
    assert {entry.category for entry in entries} <= {"numbers", "unfinished"}
    assert set(folder.iterdir()) == {entry.path for entry in entries}
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", "1e-5")
    stored("a_search", 1, Search(1))
    remaining = store.files_of(folder.parent)
    assert "numbers" not in {entry.category for entry in remaining}
    assert sum(entry.size for entry in remaining) <= store.size_limit()
