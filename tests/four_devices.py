"""Programs of tests in a process of their own, which has four devices."""

import os
import subprocess
import sys
from pathlib import Path


_ROOT = Path(__file__).resolve().parents[1]
_FOUR = "--xla_force_host_platform_device_count=4"


def run_on_four(program: Path, name: str, folder: Path) -> str:
    """What a part of a program prints, run in a folder; it must not fail."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} {_FOUR}"
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": str(_ROOT)}
    done = subprocess.run(
        [sys.executable, program, name],
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()
