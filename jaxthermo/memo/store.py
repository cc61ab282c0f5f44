"""Files of the user's cache: their folder, their limit, and which of them go first.

`JAXTHERMO_CACHE` names another folder, or is "off" or "on"; `JAXTHERMO_CACHE_GIB` is
the limit of all files together. A cache never makes a run fail: what cannot be read is
computed again, what cannot be written is not stored.
"""

import contextlib
import functools
import logging
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, NamedTuple

from ..atomic import replacing
from ..errors import InputError
from ..host_memory import readable_bytes


OFF = "off"
_ON = "on"
_FOLDER_VARIABLE = "JAXTHERMO_CACHE"
_LIMIT_VARIABLE = "JAXTHERMO_CACHE_GIB"
_DEFAULT_GIB = 1.0
_GIB = 1024**3

REFERENCE = "reference"
"""Category of the runs that fits are compared with: hours of work, removed last."""

OLD_RELEASE = "old-release"
"""Category of the files of earlier releases, which are neither read nor replaced."""

_UNFINISHED = "unfinished"
"""Category of the files of writers that are at work, or were killed."""

_MAX_FRACTION = 0.5
"""Size of the largest file that is stored, over the limit; references may fill it."""

_UNCHECKED_FRACTION = 1 / 16
"""Size that a process writes, over the limit, before it looks at all files again."""

_RESULTS = "memo"
_PROGRAMS = "programs"
_NAME = re.compile(
    r"(?P<category>[a-z_]+)-[0-9a-f]{40}\.bin"
    r"|\.[a-z_]+-[0-9a-f]{40}\.\d+-[0-9a-f]{8}\.bin"
)
_OLD_NAME = re.compile(
    r"\.?([a-z_]+-[0-9a-f]{40}|[0-9a-f]{32})(\.(\d+-)?[0-9a-f]{8})?\.(bin|npz|json)"
)
_NAMES = {
    f"{_RESULTS}/*": _NAME,
    f"{_PROGRAMS}/*/*": _NAME,
    "findings/*": _OLD_NAME,
    "references/*": _OLD_NAME,
    "structures/*": _OLD_NAME,
}

_log = logging.getLogger(__name__)
_unchecked_bytes: dict[Path, int] = {}


class Entry(NamedTuple):
    """A file of the cache."""

    category: str
    path: Path
    size: int
    """[bytes]"""
    used_at: float
    """Time of the last use, by the system's clock [s]."""


def cache_folder() -> Path | None:
    """Folder of the user's cache; None if it is off."""
    named = os.environ.get(_FOLDER_VARIABLE, "")
    if named == OFF:
        return None
    try:
        if named and named != _ON:
            return Path(named).expanduser()
        per_user = Path(os.environ.get("XDG_CACHE_HOME", ""))
        if not per_user.is_absolute():
            per_user = Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        return None
    return per_user / "jaxthermo"


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Context in which nothing is read or stored, to time what is computed."""
    previous = os.environ.get(_FOLDER_VARIABLE)
    # Processes that are started within the context inherit it.
    os.environ[_FOLDER_VARIABLE] = OFF
    try:
        yield
    finally:
        if previous is None:
            del os.environ[_FOLDER_VARIABLE]
        else:
            os.environ[_FOLDER_VARIABLE] = previous


def size_limit() -> int:
    """Limit of all files together [bytes].

    Raises:
        InputError: if the variable of the environment is no size.
    """
    text = os.environ.get(_LIMIT_VARIABLE) or str(_DEFAULT_GIB)
    try:
        limit = float(text) * _GIB
    except ValueError:
        limit = math.nan
    if not 0 <= limit < math.inf:
        raise InputError(
            f"{_LIMIT_VARIABLE}={text}: give the limit of the cache in GiB, such as 4"
        )
    return int(limit)


def result_path(folder: Path, category: str, key: str) -> Path:
    """Path of a result in a cache, whether or not it is there."""
    results = folder / _RESULTS
    if not results.is_dir():
        _announce_old_release(folder, results)
    return results / f"{category}-{key}.bin"


def program_folder(folder: Path, machine: str) -> Path:
    """Folder of the programs that a cache has for a machine."""
    return folder / _PROGRAMS / machine


def files_of(folder: Path) -> list[Entry]:
    """Files of a cache; those of other names are none of it."""
    entries = []
    for pattern, names in _NAMES.items():
        for path in folder.glob(pattern):
            match = names.fullmatch(path.name)
            # Another process may remove files at the same time.
            with contextlib.suppress(OSError):
                if match:
                    status = path.stat()
                    category = match.groupdict(_UNFINISHED).get("category", OLD_RELEASE)
                    entries.append(
                        Entry(category, path, status.st_size, status.st_mtime)
                    )
    return entries


def _announce_old_release(folder: Path, results: Path) -> None:
    """Say once that results of an earlier release are there."""
    old_bytes = sum(e.size for e in files_of(folder) if e.category == OLD_RELEASE)
    if old_bytes:
        # One of several processes makes the folder.
        with contextlib.suppress(OSError):
            results.mkdir()
            _log.warning(
                f"jaxthermo: {folder} has {readable_bytes(old_bytes)} of an earlier "
                f"release, not read: `jaxthermo cache clear {OLD_RELEASE}` removes them"
            )


def write_entry(
    folder: Path, path: Path, size: int, write: Callable[[IO[bytes]], None]
) -> None:
    """Write a file of a cache in one step, and make room; do nothing on failure.

    Args:
        folder: folder of the cache.
        path: path of the file, of `result_path` or in a `program_folder`.
        size: size of the file [bytes].
        write: writes its content.
    """
    limit = _limit_of_run()
    is_reference = path.name.startswith(f"{REFERENCE}-")
    if size > limit * (1 if is_reference else _MAX_FRACTION):
        return
    with contextlib.suppress(OSError, InputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary, temporary.open("wb") as file:
            write(file)
        # As if the first file that a process writes filled the cache.
        unchecked = _unchecked_bytes.get(folder, limit) + size
        if unchecked > limit * _UNCHECKED_FRACTION:
            _make_room(folder, int(limit * (1 - _UNCHECKED_FRACTION)))
            unchecked = 0
        _unchecked_bytes[folder] = unchecked


def mark_used(path: Path) -> None:
    """Set the time of the last use of a file that was read."""
    with contextlib.suppress(OSError):
        os.utime(path)


def _make_room(folder: Path, max_bytes: int) -> None:
    """Remove the least recently used files, references last, above a size."""
    entries = [entry for entry in files_of(folder) if entry.category != OLD_RELEASE]
    entries.sort(key=lambda entry: (entry.category != REFERENCE, -entry.used_at))
    total_size = 0
    for entry in entries:
        total_size += entry.size
        if total_size > max_bytes:
            entry.path.unlink(missing_ok=True)


def clear(entries: Iterable[Entry]) -> None:
    """Remove files of a cache, and folders of earlier releases that they leave empty.

    Raises:
        InputError: if one of them cannot be removed.
    """
    old_folders = set()
    for entry in entries:
        try:
            entry.path.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot remove {entry.path}: {error.strerror}; remove it by hand"
            ) from error
        if entry.category == OLD_RELEASE:
            old_folders.add(entry.path.parent)
    for folder in old_folders:
        with contextlib.suppress(OSError):  # not empty
            folder.rmdir()


def _limit_of_run() -> int:
    try:
        return size_limit()
    except InputError as error:
        _warn_once(f"jaxthermo: {error}; it is {_DEFAULT_GIB:g} GiB")
        return int(_DEFAULT_GIB * _GIB)


@functools.cache
def _warn_once(text: str) -> None:
    _log.warning(text)
