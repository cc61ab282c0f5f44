"""Atomic files: a reader sees the old or the new one, never a part."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` on success and is removed on failure.

    Raises:
        InputError: when the folder is missing, cannot be written or is full.
    """
    target = Path(path)
    # The suffix stays last: image libraries choose the format by it. Not mkstemp,
    # whose files only the owner can read.
    temporary = target.parent / f".{target.stem}.{uuid.uuid4().hex[:8]}{target.suffix}"
    try:
        # Detects an unwritable folder before any work, with the system's message.
        temporary.open("xb").close()
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot write {target}: {reason}; give a folder that exists, can be "
            "written and has space"
        ) from error
    finally:
        # The parent may not exist, or be a file.
        if temporary.parent.is_dir():
            temporary.unlink(missing_ok=True)
