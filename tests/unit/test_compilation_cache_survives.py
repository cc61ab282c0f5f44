"""Kills in mid-write, damaged files, writers at once: the next process computes right.

These are the requirements for a cache of compiled programs. JAX's own cache fails on
flipped bytes where it compresses with zstandard, which has no check sum there.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.damaged import damage


ROOT = Path(__file__).resolve().parents[2]
KILLS = 50

# Evaluates numbered programs, whose results are integers and therefore exact, on a slow
# disk: most of the time of a program is that of writing it. It prints the number of
# each, and at the end how many were loaded.
CODE = """
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxthermo
from jaxthermo import compilation_cache

first, last, max_bytes, pause = map(int, sys.argv[1:])


def write_slowly(path, content):
    with path.open("wb", buffering=0) as file:
        for start in range(0, len(content), 512):
            file.write(content[start : start + 512])
            time.sleep(pause / 1000)


Path.write_bytes = write_slowly
compilation_cache._MAX_BYTES = max_bytes
assert jaxthermo.cache_compilations() is not None
loaded = []
jax.monitoring.register_event_listener(
    lambda event, **_: event.endswith("/cache_hits") and loaded.append(event)
)
numbers = np.arange(24, dtype=np.float32)
for n in range(first, last):
    program = jax.jit(lambda x: jnp.cumsum(x * (n + 1))[::-1] + n)
    np.testing.assert_array_equal(
        program(numbers), np.cumsum(numbers * (n + 1))[::-1] + n
    )
    print(n, flush=True)
print("loaded", len(loaded))
"""


def start(
    folder: Path,
    first: int,
    last: int,
    max_bytes: int = 10**9,
    pause_ms: int = 0,
) -> subprocess.Popen[str]:
    """Start a process that evaluates the programs from `first` to before `last`."""
    users = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
    users |= {"JAXTHERMO_CACHE": str(folder), "TF_CPP_MIN_LOG_LEVEL": "3"}
    arguments = map(str, (first, last, max_bytes, pause_ms))
    return subprocess.Popen(
        [sys.executable, "-W", "default", "-c", CODE, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=users,
    )


def loaded(process: subprocess.Popen[str]) -> int:
    """Number of programs that a process loaded which had to end well."""
    said, warned = process.communicate(timeout=120)
    assert (process.returncode, warned) == (0, "")
    return int(said.split()[-1])


def kill_after(process: subprocess.Popen[str], programs: int, delay: float) -> int:
    """Kill a process some seconds after a number of its programs; the last number."""
    assert process.stdout is not None
    number = -1
    for _ in range(programs):
        line = process.stdout.readline()
        assert line, process.communicate()[1]
        number = int(line)
    time.sleep(delay)
    process.kill()
    _, warned = process.communicate()
    assert (process.returncode, warned) == (-signal.SIGKILL, "")
    return number


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.mark.slow
def test_kills_in_mid_write(tmp_path):
    """Of two writers at once; each process begins with what the last ones left."""
    random = np.random.default_rng(54)
    max_bytes = 100_000
    first = 0
    incomplete = 0
    for _ in range(KILLS // 2):
        writers = [
            start(tmp_path, first, first + 1000, max_bytes, pause_ms=4)
            for _ in range(2)
        ]
        reached = []
        for writer in writers:
            programs = int(random.integers(3, 6))
            reached.append(kill_after(writer, programs, random.uniform(0, 0.1)))
        incomplete += any(path.name.startswith(".") for path in files(tmp_path))
        first = min(reached)
    # Otherwise the kills were not in mid-write.
    assert incomplete > KILLS / 8
    assert loaded(start(tmp_path, first, first + 6)) < 6
    assert loaded(start(tmp_path, first, first + 6)) == 6


@pytest.mark.slow
def test_random_damage(tmp_path):
    """Each file in another way: flipped, removed, repeated, inserted bytes, zeros."""
    random = np.random.default_rng(54)
    programs = 12
    loaded(start(tmp_path, 0, programs))
    for _ in range(10):
        for path in files(tmp_path):
            path.write_bytes(damage(path.read_bytes(), random, is_text=False))
        # Damaged files are written anew.
        loaded(start(tmp_path, 0, programs))
        assert loaded(start(tmp_path, 0, programs)) == programs


@pytest.mark.slow
def test_two_writers_at_the_limit(tmp_path):
    """They remove each other's files; the folder stays below the limit."""
    max_bytes = 40_000
    for first in (0, 10, 5):
        writers = [start(tmp_path, first, first + 20, max_bytes) for _ in range(2)]
        for writer in writers:
            loaded(writer)
        total = sum(path.stat().st_size for path in files(tmp_path))
        assert total <= max_bytes * (1 + 1 / 16) + 8000
    assert loaded(start(tmp_path, 23, 25, max_bytes)) == 2
