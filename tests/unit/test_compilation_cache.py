"""Compiled programs are loaded by the next process; a bad file costs a compilation."""

import os
import re
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import pytest

from jaxthermo import compilation_cache
from jaxthermo.compilation_cache import ProgramFiles


ROOT = Path(__file__).resolve().parents[2]

SCENE = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 4 cm]}
    voxels_high: 4
    material: {conductivity: 16, density: 8000, specific_heat: 500, emissivity: 1}
    temperature: 300
terms: [{kind: convection, heat_transfer_coefficient: 10, temperature: 280}]
time: {end: 1, save_at: [1]}
camera: {width: 32, height: 24}
"""

# Prints the folder, the number of programs that were loaded, and a result.
SCRIPT = """
import sys
import jax, jax.numpy as jnp
from jax import monitoring
import jaxthermo as jt
loaded = []
note = lambda event, **_: event.endswith("/cache_hits") and loaded.append(event)
monitoring.register_event_listener(note)
folder = jt.cache_compilations()
assert folder == jt.cache_compilations()
step = jax.jit(lambda x: jnp.sin(x[::2]) @ jnp.cos(x[1::2]))
heat = jax.jit(lambda x: jnp.cumsum(jnp.linalg.solve(x, x.sum(0))))
x = jnp.arange(16.0).reshape(4, 4) + 20 * jnp.eye(4)
found = float(step(x.ravel())), float(heat(x)[-1])
print(folder, len(loaded), *found)
"""


# The same of a program that says the folder and compiles one operation.
SHORT = """
import jax
import jaxthermo as jt
print(jt.cache_compilations())
jax.jit(lambda x: x + 1)(1.0)
"""


def environment(folder: Path | str, **others: str) -> dict[str, str]:
    """Variables as a user has them: without the tests' own cache."""
    tests_own = ("JAX_COMPILATION", "JAX_PERSISTENT", "JAXTHERMO")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(tests_own)}
    return kept | {"JAXTHERMO_CACHE": str(folder)} | others


def run(folder: Path | str, code: str = SCRIPT, **others: str) -> list[str]:
    """Words that a new process prints; all that is not of this cache goes nowhere."""
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(folder, TF_CPP_MIN_LOG_LEVEL="3", **others),
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def programs(folder: Path) -> list[Path]:
    return sorted(folder.rglob("program-*.bin"))


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> tuple[Path, list[str]]:
    """A cache that one process has filled, and what it printed."""
    folder = tmp_path_factory.mktemp("filled")
    return folder, run(folder)


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
    folder, first = filled
    before = {path: path.read_bytes() for path in programs(folder)}
    assert first[1] == "0" and len(before) >= 2
    again = run(folder)
    assert int(again[1]) == len(before)
    assert again[2:] == first[2:]
    assert {path: path.read_bytes() for path in programs(folder)} == before


DAMAGES = ("truncated", "empty", "flipped", "foreign")


def do_damage(folder: Path, damage: str) -> None:
    for path in programs(folder):
        whole = path.read_bytes()
        half = len(whole) // 2
        flipped = bytes([whole[half] ^ 1])
        content = {
            "truncated": whole[:half],
            "empty": b"",
            "flipped": whole[:half] + flipped + whole[half + 1 :],
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
        pytest.param(each, marks=[pytest.mark.slow] * (each != "flipped"))
        for each in DAMAGES
    ],
)
def test_a_damaged_file_is_compiled_and_written_anew(copied, damage):
    folder, first = copied
    do_damage(folder, damage)
    again = run(folder)
    assert again[1:] == ["0", *first[2:]]
    assert run(folder)[1] != "0"


def for_another_machine(path: Path) -> None:
    """Change the processor's features in a program, as if compiled for another one."""
    text = path.read_bytes()[compilation_cache._DIGEST_BYTES :]
    try:
        program = zlib.decompress(text)
    except zlib.error:
        pytest.skip("JAX compresses its programs in another way here")
    # Of the same length, or lengths in the file would not fit any more.
    changed, count = re.subn(rb"\+(sse4\.2|avx512vl|neon)", _unknown, program)
    if not count:
        pytest.skip("no features of the processor in the program")
    key = "unknown"
    content = zlib.compress(changed)
    path.write_bytes(compilation_cache._check_sum(key, content) + content)


def _unknown(found: re.Match[bytes]) -> bytes:
    return b"+" + b"z" * len(found[1])


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
    assert again[2:] == first[2:]
    assert run(folder, code)[2:] == first[2:]


def test_rejected_files_are_emptied_and_then_the_folder_is_given_up(tmp_path):
    files = ProgramFiles(tmp_path)
    for n in range(4):
        files.put(f"key{n}", b"program")
    fresh = ProgramFiles(tmp_path)
    assert fresh.get("key0") == b"program"
    # JAX stores a program again only if it could not use the one that it got.
    fresh.put("key0", b"again")
    assert fresh.get("key0") is None
    assert ProgramFiles(tmp_path).get("key0") is None
    for n in (1, 2):
        assert fresh.get(f"key{n}") == b"program"
        fresh.put(f"key{n}", b"again")
    assert fresh.get("key3") is None
    assert not compilation_cache._is_usable(tmp_path)


def test_processes_at_once_leave_whole_files(tmp_path):
    others = [
        subprocess.Popen(
            [sys.executable, "-c", SCRIPT],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=ROOT,
            env=environment(tmp_path),
        )
        for _ in range(2)
    ]
    said = [other.communicate(timeout=120) for other in others]
    assert [other.returncode for other in others] == [0, 0]
    assert [err for _, err in said] == [b"", b""]
    assert said[0][0].split()[2:] == said[1][0].split()[2:]
    names = [path.name for path in tmp_path.rglob("*") if path.is_file()]
    assert all(name.startswith("program-") for name in names)
    assert int(run(tmp_path)[1]) == len(names)


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


@pytest.mark.parametrize(
    "variables",
    [{"JAXTHERMO_CACHE": "off"}, {"JAXTHERMO_COMPILATION_CACHE": "off"}],
    ids=str,
)
def test_one_variable_turns_it_off(tmp_path, variables):
    assert run(tmp_path, SHORT, **variables) == ["None"]
    assert not list(tmp_path.iterdir())


def test_a_cache_of_the_user_stays_in_use(tmp_path):
    own = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "own")}
    assert run(tmp_path / "ours", SHORT, **own) == ["None"]
    assert not (tmp_path / "ours").exists()


def test_folders_that_cannot_be_used_are_no_failure(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert run(tmp_path / "file", SHORT) == ["None"]
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    assert not compilation_cache._is_usable(shared)
    shared.chmod(0o755)
    assert compilation_cache._is_usable(shared)


def test_a_full_disk_is_no_failure(tmp_path, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device")

    files = ProgramFiles(tmp_path)
    monkeypatch.setattr(Path, "write_bytes", full)
    files.put("key", b"program")
    assert files.get("key") is None
    assert not list(tmp_path.iterdir())


def test_the_least_recently_used_go_first(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation_cache, "_MAX_BYTES", 10_000)
    old, new = tmp_path / "old-jaxlib", tmp_path / "new-jaxlib"
    for folder in (old, new):
        folder.mkdir()
    ProgramFiles(old).put("key", bytes(4000))
    (old / "mine.bin").write_bytes(bytes(9000))
    for path in old.iterdir():
        os.utime(path, (0, 0))
    files = ProgramFiles(new)
    for n in range(3):
        files.put(f"key{n}", bytes(3000))
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
    scene = tmp_path / "block.yaml"
    scene.write_text(SCENE)
    code = "from jaxthermo.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "simulate", scene, "--out", tmp_path / "out"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=environment(tmp_path / "cache"),
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert programs(tmp_path / "cache")
