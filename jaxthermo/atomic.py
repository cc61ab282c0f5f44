"""Atomic files: a reader sees the old or the new file, never an incomplete one."""

import errno
import json
import os
import re
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import InputError


_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""A full disk, a quota, a limit of the file size, a disk that fails or is read-only."""

# Name, process and random digits of a temporary file.
_TEMPORARY = re.compile(r"\..+\.(\d+)-[0-9a-f]{8}(\.\w+)?")


def disk_error(error: BaseException | None) -> OSError | None:
    """The error of a disk that an exception is, or was raised after; None without."""
    # A file that cannot be written cannot be closed either: zipfile then raises a
    # ValueError of its own.
    while error is not None:
        if isinstance(error, OSError) and error.errno in _DISK_ERRORS:
            return error
        error = error.__cause__ or error.__context__
    return None


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files in a folder of processes that were killed."""
    # A folder that cannot be listed may still be written to.
    with suppress(OSError):
        for path in folder.iterdir():
            match = _TEMPORARY.fullmatch(path.name)
            if match and not _is_running(int(match[1])):
                path.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # of another user
        return True
    return True


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` on success and is removed on failure.

    Raises:
        InputError: when the folder is missing, cannot be written or is full.
    """
    target = Path(path)
    # The suffix stays last: image libraries choose the format by it. Not mkstemp,
    # whose files only the owner can read.
    mark = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
    temporary = target.parent / f".{target.stem}.{mark}{target.suffix}"
    try:
        # Detects an unwritable folder before any work, with the system's message.
        temporary.open("xb").close()
        yield temporary
        os.replace(temporary, target)
    except Exception as error:
        cause = error if isinstance(error, OSError) else disk_error(error)
        if cause is None:
            raise
        reason = cause.strerror or str(cause)
        raise InputError(
            f"cannot write {target}: {reason}; give a folder that exists, can be "
            "written and has space"
        ) from error
    finally:
        # The parent may not exist, or be a file.
        if temporary.parent.is_dir():
            temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8, in one step.

    Raises:
        InputError: when the folder is missing, cannot be written or is full.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write plain types as indented JSON, in one step."""
    # NaN would be written as a word that other readers of JSON refuse.
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")
