"""Commands in a process of their own, which is killed as `kill -9` does."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path


ROOT = Path(__file__).resolve().parents[2]


def start(
    code: str, *arguments: object, stderr: int | None = None
) -> subprocess.Popen[bytes]:
    """Start Python code with arguments, in the precision of the tests.

    Its errors go where those of the tests do, or into `stderr`.
    """
    # In the environment: both processes have to compute the same bits.
    environment = os.environ | {"JAX_ENABLE_X64": "1"}
    words = [sys.executable, "-c", code, *map(str, arguments)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        words, env=environment, cwd=ROOT, stdout=quiet, stderr=stderr
    )


def kill(
    process: subprocess.Popen[bytes], delay: float, condition: Callable[[], bool]
) -> bool:
    """Kill a process `delay` seconds after a condition holds; False if it had ended."""
    limit = time.monotonic() + 300
    while not condition() and process.poll() is None:
        assert time.monotonic() < limit, "nothing happened for 300 s"
        time.sleep(0.01)
    try:
        process.wait(delay)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True
    return False
