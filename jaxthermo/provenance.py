"""Origin of a result: versions, machine, commit, config and seed, as plain values."""

import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax


# Libraries on which the numbers of a result may depend.
_PACKAGES = (
    "jaxthermo",
    "jax",
    "jaxlib",
    "numpy",
    "scipy",
    "equinox",
    "optimistix",
    "trimesh",
)
_ROOT = Path(__file__).resolve().parents[1]
_CPUINFO = Path("/proc/cpuinfo")
_GIT_TIMEOUT = 10.0  # s


def provenance(config_hash: str | None = None, seed: int | None = None) -> dict:
    """Origin of a result that is finished now.

    Keys: `config_hash`, `seed`, `versions`, `device`, `processor`, `commit` (only where
    the code is a git checkout; "+changes" if it differs from the commit) and `date`
    (UTC).

    Args:
        config_hash: hash of the resolved config, if there is one.
        seed: seed of the random numbers, if there are any.
    """
    device = jax.devices()[0]
    code = commit(_ROOT)
    return {
        "config_hash": config_hash,
        "seed": seed,
        "versions": _versions(),
        "device": f"{device.platform}: {device.device_kind}",
        "processor": processor(),
        **({} if code is None else {"commit": code}),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _versions() -> dict[str, str]:
    """Versions of Python, of jaxthermo and of the libraries that compute."""
    return {"python": platform.python_version()} | {p: version(p) for p in _PACKAGES}


def processor() -> str:
    """Name of the processor and the cores that this process may use."""
    name = _model_name() or platform.processor() or platform.machine() or "unknown"
    # A container or a batch system may grant fewer cores than the machine has.
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    return f"{name}, {cores} core{'s' * (cores != 1)}"


@cache
def _model_name(cpuinfo: Path = _CPUINFO) -> str:
    try:
        text = cpuinfo.read_text(encoding="utf-8", errors="replace")
    except OSError:  # not Linux
        return ""
    fields = (line.partition(":") for line in text.splitlines())
    names = (value.strip() for key, _, value in fields if key.strip() == "model name")
    return next(names, "")


@cache
def commit(root: Path) -> str | None:
    """Git commit of the code in a folder; None if the folder is no checkout.

    Args:
        root: folder of the packages.
    """
    # Only its own repository: an installed package may lie inside somebody else's.
    if not (root / ".git").exists():
        return None
    head = _git(root, "rev-parse", "--short=12", "HEAD")
    # New files count only if they are code: results may be written into the checkout.
    changes = _git(root, "status", "--porcelain", "--", "*.py", "*.toml")
    if not head or changes is None:
        return None
    return f"{head}+changes" if changes else head


def _git(root: Path, *arguments: str) -> str | None:
    # Within a hook, git's own variables name another repository.
    variables = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    environment: Mapping[str, Any] = {**variables, "GIT_OPTIONAL_LOCKS": "0"}
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            env=environment,
            timeout=_GIT_TIMEOUT,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
