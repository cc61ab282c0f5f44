"""The user's cache folder: structures, findings and compiled programs on disk.

`JAXTHERMO_CACHE` names another folder, or is "off" or "on". A cache never makes a run
fail: what cannot be read is computed again, what cannot be written is not stored.
"""

import contextlib
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO

from .atomic import replacing
from .errors import InputError


_VARIABLE = "JAXTHERMO_CACHE"
_ON = "on"
OFF = "off"


def cache_folder(name: str) -> Path | None:
    """Folder of one kind of files in the user's cache; None if it is off."""
    named = os.environ.get(_VARIABLE, "")
    if named == OFF:
        return None
    try:
        if named and named != _ON:
            return Path(named).expanduser() / name
        per_user = Path(os.environ.get("XDG_CACHE_HOME", ""))
        if not per_user.is_absolute():
            per_user = Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        return None
    return per_user / "jaxthermo" / name


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Context in which nothing is read or stored, to time what is computed."""
    previous = os.environ.get(_VARIABLE)
    # Processes that are started within the context inherit it.
    os.environ[_VARIABLE] = OFF
    try:
        yield
    finally:
        if previous is None:
            del os.environ[_VARIABLE]
        else:
            os.environ[_VARIABLE] = previous


def keep(
    path: Path,
    write: Callable[[IO[bytes]], None],
    own_files: re.Pattern[str],
    max_bytes: int,
) -> None:
    """Write a file in one step and make room in its folder; do nothing on failure."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary, temporary.open("wb") as file:
            write(file)
        make_room(path.parent.iterdir(), own_files, max_bytes)
    except (OSError, InputError):
        return


def mark_used(path: Path) -> None:
    """Set the time of a file that was read, for `make_room`."""
    with contextlib.suppress(OSError):
        os.utime(path)


def make_room(
    paths: Iterable[Path], own_files: re.Pattern[str], max_bytes: int
) -> None:
    """Remove the least recently used files until the others are below a size.

    Files of other names are neither counted nor removed.
    """
    files = []
    for path in paths:
        # Another process may remove files at the same time.
        with contextlib.suppress(FileNotFoundError):
            if own_files.fullmatch(path.name):
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
    total_size = 0
    for _, size, path in sorted(files, reverse=True):
        total_size += size
        if total_size > max_bytes:
            path.unlink(missing_ok=True)
