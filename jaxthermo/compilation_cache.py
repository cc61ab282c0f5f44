"""Compiled programs on disk: what one process compiled, the next one loads.

JAX calls these files in place of its own, through an internal function: it offers no
public one, and its own files have no check sum where the package zstandard or Python
3.14 compresses them. A flipped bit in such a file gives wrong results, crashes or an
endless loop, and no damaged file is ever written anew.

The commands switch the cache on; in Python `cache_compilations` does, because it is a
setting of JAX that the whole process shares. A file that is damaged, or that XLA
rejects, costs a compilation and nothing else. Code of another jaxlib or processor can
crash when it is loaded, which JAX's own key does not rule out: both name the folder.
"""

import functools
import hashlib
import os
import platform
import sys
import threading
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import jax
import jaxlib
from jax._src import compilation_cache as _jax_cache

from .memo import store


_VARIABLE = "JAXTHERMO_COMPILATION_CACHE"
"""Variable of the environment that names another folder, or is "off"."""

# Incremented when the meaning of the files changes.
_FORMAT = 1

_DIGEST_BYTES = 32
_CPUINFO = Path("/proc/cpuinfo")
# Variables that change what XLA compiles, or for how many threads.
_SETTINGS = ("XLA_FLAGS", "JAX_PLATFORMS", "NPROC")


def cache_compilations() -> Path | None:
    """Load programs that earlier processes compiled, and store those of this one.

    This changes settings of JAX for the whole process, so that no other function of
    the library calls it; the commands do. The files are in the user's cache folder;
    `JAXTHERMO_COMPILATION_CACHE` names another one, or is "off", and both are off
    where `JAXTHERMO_CACHE` is. A cache that JAX's own settings name stays in use.

    Returns:
        The folder; None if there is no cache, or not this one.
    """
    settings: Any = jax.config
    folder = _folder()
    configured = settings.jax_compilation_cache_dir
    if folder is None or configured is not None:
        return folder if configured == str(folder) else None
    if not settings.jax_enable_compilation_cache or not _is_usable(folder):
        return None
    files = ProgramFiles(folder)
    open_cache = getattr(_jax_cache, "get_file_cache", None)
    if open_cache is None:  # a JAX in which another function opens it
        return None

    def opened(path: str) -> tuple[Any, str] | None:
        return (files, path) if path == str(folder) else open_cache(path)

    _jax_cache.get_file_cache = opened
    _jax_cache.reset_cache()
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # There are many programs that each compile fast.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jax.config.update("jax_persistent_cache_enable_xla_caches", "none")
    # Programs that cannot be stored, and files that XLA rejects, are compiled again.
    warnings.filterwarnings(
        "ignore", "Error (reading|writing) persistent compilation cache entry"
    )
    return folder


def _folder() -> Path | None:
    """Folder of the programs of this jaxlib on this processor."""
    named = os.environ.get(_VARIABLE, "")
    root = store.cache_folder()
    if root is None or named == store.OFF:
        return None
    if named:
        try:
            root = Path(named).expanduser()
        except RuntimeError:  # no such user
            return None
    return store.program_folder(
        root.absolute(), machine=f"{version('jaxlib')}-{_machine()}"
    )


def _machine() -> str:
    """Hash of what machine code depends on: build of jaxlib, processor, settings."""
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count()
    text = [str(_FORMAT), version("jax"), _build(), _processor(), str(cores)]
    text += [os.environ.get(name, "") for name in _SETTINGS]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:12]


def _build() -> str:
    """Size and time of the libraries of jaxlib, which may change under one version."""
    folder = Path(jaxlib.__file__).parent
    status = [(path.name, path.stat()) for path in sorted(folder.glob("*.so"))]
    return " ".join(f"{name} {s.st_size} {s.st_mtime_ns}" for name, s in status)


@functools.cache
def _processor() -> str:
    described = [platform.machine(), platform.processor()]
    try:
        lines = _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:  # not Linux
        lines = []
    # Properties of the first processor; "Features" on ARM.
    for key in ("model name", "flags", "Features", "CPU part"):
        described += [line for line in lines if line.startswith(key)][:1]
    return "\n".join(described)


def _is_usable(folder: Path) -> bool:
    """True for a folder in which only this user can write; it is made if missing."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        # The files are machine code: nobody else may put any there.
        is_own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
        shared = status.st_mode & 0o022 and sys.platform != "win32"
        return is_own and not shared
    except OSError:
        return False


class ProgramFiles:
    """The files of one folder, as JAX's cache reads and writes them; never fails.

    A file is the check sum of its key and content, and the content: a program, or
    nothing where XLA rejected the program.
    """

    def __init__(self, folder: Path):
        # JAX reports the folder by this name.
        self._path = folder
        self._lock = threading.Lock()
        self._loaded_keys: set[str] = set()

    def get(self, key: str) -> bytes | None:
        """Content of a file; None if it is missing or cannot be used."""
        path = self._file(key)
        content = _read(path, key)
        if not content:
            return None
        store.mark_used(path)
        with self._lock:
            self._loaded_keys.add(key)
        return content

    def put(self, key: str, value: bytes) -> None:
        """Write a program; JAX does so only after `get` gave none that was accepted."""
        with self._lock:
            is_rejected = key in self._loaded_keys
        path = self._file(key)
        if is_rejected:
            self._write(path, _check_sum(key, b""))
        elif _read(path, key) is None:
            self._write(path, _check_sum(key, value) + value)

    def _file(self, key: str) -> Path:
        digest = hashlib.sha256(key.encode()).hexdigest()
        return self._path / f"program-{digest[:40]}.bin"

    def _write(self, path: Path, content: bytes) -> None:
        def write(file: IO[bytes]) -> None:
            file.write(content)

        # A cache has a folder of programs with a folder for each machine.
        cache_folder = path.parents[2]
        store.write_entry(cache_folder, path=path, size=len(content), write=write)


def _read(path: Path, key: str) -> bytes | None:
    """Content of a file, None if it is missing or damaged."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    content = stored[_DIGEST_BYTES:]
    return content if stored[:_DIGEST_BYTES] == _check_sum(key, content) else None


def _check_sum(key: str, content: bytes) -> bytes:
    named = hashlib.blake2b(key.encode(), digest_size=_DIGEST_BYTES).digest()
    return hashlib.blake2b(content, key=named, digest_size=_DIGEST_BYTES).digest()
