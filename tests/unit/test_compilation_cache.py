"""Compiled programs are loaded by the next process; a bad file costs a compilation."""

import os
import re
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import jaxthermo.__main__ as commands
from jaxthermo import compilation_cache
from jaxthermo.compilation_cache import ProgramFiles
from jaxthermo.console.entry import compiles


ROOT = Path(__file__).resolve().parents[2]

# Prints the folder, the number of programs that were loaded, that of those which were
# loaded when JAX had forgotten them, and a result.
SCRIPT = """
import jax, jax.numpy as jnp, numpy as np
from jax import monitoring
import jaxthermo as jt
loaded = []
note = lambda event, **_: event.endswith("/cache_hits") and loaded.append(event)
monitoring.register_event_listener(note)
folder = jt.cache_compilations()
assert folder == jt.cache_compilations()
step = jax.jit(lambda x: jnp.sin(x[::2]) @ jnp.cos(x[1::2]))
heat = jax.jit(lambda x: jnp.cumsum(jnp.linalg.solve(x, x.sum(0))))
x = np.arange(16.0).reshape(4, 4) + 20 * np.eye(4)
def found():
    return float(step(x.ravel())), float(np.asarray(heat(x))[-1])
first = found(), len(loaded)
jax.clear_caches()
assert found() == first[0]
print(folder, first[1], len(loaded) - first[1], *first[0])
"""


# Settings without a cache, one after the other: JAX reads its own at import only.
WITHOUT = """
import os, sys
import jax
import jaxthermo as jt
folder = os.environ["JAXTHERMO_CACHE"]
for name, value in (
    ("JAXTHERMO_CACHE", "off"),
    ("JAXTHERMO_COMPILATION_CACHE", "off"),
    ("JAXTHERMO_CACHE", folder + "/file"),
):
    before = dict(os.environ)
    os.environ[name] = value
    print(jt.cache_compilations())
    os.environ.clear()
    os.environ.update(before)
jax.config.update("jax_compilation_cache_dir", folder + "/own")
print(jt.cache_compilations())
jax.jit(lambda x: x + 1)(1.0)
"""


def environment(folder: Path | str, **variables: str) -> dict[str, str]:
    """Variables as a user has them: without the tests' own cache."""
    tests_own = ("JAX_COMPILATION", "JAX_PERSISTENT", "JAXTHERMO")
    users = {k: v for k, v in os.environ.items() if not k.startswith(tests_own)}
    return users | {"JAXTHERMO_CACHE": str(folder)} | variables


def run(folder: Path | str, code: str = SCRIPT, **variables: str) -> list[str]:
    """Words that a new process prints; all that is not of this cache goes nowhere."""
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(folder, TF_CPP_MIN_LOG_LEVEL="3", **variables),
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def programs(folder: Path) -> list[Path]:
    return sorted(folder.rglob("program-*.bin"))


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> tuple[Path, list[str]]:
    """A cache that two processes at once have filled, and what one of them printed."""
    folder = tmp_path_factory.mktemp("filled")
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(run, [folder] * 2)
    assert first[3:] == second[3:]
    return folder, first


@pytest.fixture
def copied(filled, tmp_path) -> tuple[Path, list[str]]:
    """A copy of it, to be damaged."""
    folder, said = filled
    target = tmp_path / Path(said[0]).relative_to(folder)
    target.mkdir(mode=0o700, parents=True)
    for path in programs(folder):
        (target / path.name).write_bytes(path.read_bytes())
    return tmp_path, said


def test_the_next_process_loads_what_was_compiled(filled):
    """Two processes at once leave whole files and no others."""
    folder, first = filled
    contents = {path: path.read_bytes() for path in programs(folder)}
    assert len(contents) >= 2
    assert set(contents) == {path for path in folder.rglob("*") if path.is_file()}
    again = run(folder)
    assert int(again[1]) == int(again[2]) == len(contents)
    assert again[3:] == first[3:]
    assert {path: path.read_bytes() for path in programs(folder)} == contents


DAMAGES = ("truncated", "empty", "flipped", "foreign")


def do_damage(folder: Path, damage: str) -> None:
    for path in programs(folder):
        intact = path.read_bytes()
        half = len(intact) // 2
        flipped = bytes([intact[half] ^ 1])
        content = {
            "truncated": intact[:half],
            "empty": b"",
            "flipped": intact[:half] + flipped + intact[half + 1 :],
            "foreign": b"not a program of ours, but of some length" * 9,
        }
        path.write_bytes(content[damage])


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_not_read_and_written_anew(tmp_path, damage):
    ProgramFiles(tmp_path).put("key", b"a program" * 9)
    do_damage(tmp_path, damage)
    files = ProgramFiles(tmp_path)
    assert files.get("key") is None
    files.put("key", b"another")
    assert files.get("key") == ProgramFiles(tmp_path).get("key") == b"another"


# The next process takes no more of the others than the test before does.
@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(damage, marks=[pytest.mark.slow] * (damage != "flipped"))
        for damage in DAMAGES
    ],
)
def test_a_damaged_file_is_compiled_and_written_anew(copied, damage):
    folder, first = copied
    do_damage(folder, damage)
    again = run(folder)
    # What it wrote is read again, by itself here: another process does so above.
    assert again[1:] == ["0", str(len(programs(folder))), *first[3:]]


def for_another_machine(path: Path) -> None:
    """Change the processor's features in a program, as if compiled for another one."""
    stored = path.read_bytes()[compilation_cache._DIGEST_BYTES :]
    # As JAX compressed it here: with zlib or zstandard.
    program = compilation_cache._jax_cache.decompress_executable(stored)
    # Of the same length, or lengths in the file would not fit any more.
    changed, count = re.subn(rb"\+(sse4\.2|avx512vl|neon)", _unknown, program)
    if not count:
        pytest.skip("no features of the processor in the program")
    key = "unknown"
    content = compilation_cache._jax_cache.compress_executable(changed)
    path.write_bytes(compilation_cache._check_sum(key, content) + content)


def _unknown(feature: re.Match[bytes]) -> bytes:
    return b"+" + b"z" * len(feature[1])


def test_what_xla_rejects_is_silent_and_not_tried_for_ever(copied, monkeypatch):
    folder, first = copied
    # The key is not in the file: check sums that do not know it.
    code = SCRIPT.replace(
        "folder = jt",
        "from jaxthermo import compilation_cache as ours; import hashlib\n"
        "real = ours._check_sum\n"
        "ours._check_sum = lambda key, content: real('unknown', content)\n"
        "folder = jt",
    )
    for path in programs(folder):
        for_another_machine(path)
    again = run(folder, code)
    # Loaded with a warning by some versions of XLA, rejected by others.
    assert again[3:] == first[3:]
    assert run(folder, code)[3:] == first[3:]


def test_a_program_that_xla_rejects_is_stored_as_nothing(tmp_path):
    files = ProgramFiles(tmp_path)
    for n in range(4):
        files.put(f"key{n}", b"program")
    fresh = ProgramFiles(tmp_path)
    assert fresh.get("key0") == b"program"
    # JAX stores a program again only if it could not use the one that it got.
    fresh.put("key0", b"again")
    assert fresh.get("key0") is None
    # Nor is it loaded or stored again by the next process.
    ProgramFiles(tmp_path).put("key0", b"again")
    assert ProgramFiles(tmp_path).get("key0") is None
    assert fresh.get("key3") == b"program"


def test_threads_at_once_read_whole_files(tmp_path):
    got = []

    def work(n: int) -> None:
        files = ProgramFiles(tmp_path)
        for k in range(50):
            files.put(f"key{k % 3}", bytes([k % 3]) * 1000)
            got.append((k % 3, files.get(f"key{(k + n) % 3}"), (k + n) % 3))

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(got) == 200
    assert all(content in (None, bytes([k]) * 1000) for _, content, k in got)


def test_a_cache_that_is_off_or_the_users_own_is_left_alone(tmp_path):
    """Nor is a folder that cannot be used a failure."""
    (tmp_path / "file").write_text("in the way")
    assert run(tmp_path, WITHOUT) == ["None"] * 4
    assert {path.name for path in tmp_path.iterdir()} <= {"file", "own"}


def test_folders_of_others_are_not_used(tmp_path):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    assert not compilation_cache._is_usable(shared)
    shared.chmod(0o755)
    assert compilation_cache._is_usable(shared)


def test_a_full_disk_is_no_failure(tmp_path, monkeypatch):
    def full(path, mode):
        raise OSError(28, "No space left on device")

    files = ProgramFiles(tmp_path)
    monkeypatch.setattr(Path, "open", full)
    files.put("key", b"program")
    assert files.get("key") is None
    assert not list(tmp_path.iterdir())


def test_programs_of_other_machines_go_first(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXTHERMO_CACHE_GIB", str(10_000 / 2**30))
    old, new = (tmp_path / "programs" / name for name in ("old-jaxlib", "new-jaxlib"))
    ProgramFiles(old).put("key", bytes(4000))
    (old / "mine.bin").write_bytes(bytes(9000))
    for path in old.iterdir():
        os.utime(path, (0, 0))
    files = ProgramFiles(new)
    for n in range(3):
        files.put(f"key{n}", bytes(2900))
    assert [path.name for path in old.iterdir()] == ["mine.bin"]
    assert len(programs(new)) == 3
    files.put("large", bytes(6000))
    assert files.get("large") is None


def test_another_build_processor_or_setting_has_its_own_folder(monkeypatch):
    monkeypatch.delenv("JAXTHERMO_COMPILATION_CACHE", raising=False)
    folders = {compilation_cache._folder()}
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_max_isa=AVX")
    folders.add(compilation_cache._folder())
    monkeypatch.setattr(compilation_cache, "_build", lambda: "rebuilt in place")
    folders.add(compilation_cache._folder())
    monkeypatch.setattr(compilation_cache, "_processor", lambda: "flags: sse2")
    folders.add(compilation_cache._folder())
    assert len(folders) == 4


def test_commands_keep_their_programs(tmp_path):
    """By their decorator: here of one that compiles an operation."""
    code = """
from jaxthermo.console.entry import compiles
@compiles
def command():
    import jax
    jax.jit(lambda x: x + 1)(1.0)
command()
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(tmp_path),
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert len(programs(tmp_path)) == 1
    names = ("simulate", "view", "play", "render", "export", "dataset", "reduce")
    keeping = [
        compiles(print).__code__,
        *(vars(commands)[f"_{n}"].__code__ for n in names),
    ]
    assert len(set(keeping)) == 1
