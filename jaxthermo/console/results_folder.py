"""The folder of a command's results: created before any long work."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..atomic import remove_leftovers
from ..errors import InputError


def prepare_folder(out: str | Path) -> Path:
    """Create the folder, before any long work, and check that it can be written.

    Raises:
        InputError: if it is a file, or cannot be created or written.
    """
    folder = Path(out).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise InputError(f"--out {out}: is a file; name a folder") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"--out {out}: cannot be created: {reason}") from error
    # Now and not when the results are written, after an hour of simulation.
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: cannot be written; name another folder")
    remove_leftovers(folder)
    return folder


@contextmanager
def results_folder(out: str | Path) -> Iterator[Path]:
    """`prepare_folder`; new folders are removed if the work fails and they are empty.

    Raises:
        InputError: if it is a file, or cannot be created or written.
    """
    folder = Path(out).expanduser()
    # Unlike the method, the function knows no error: a name may be too long.
    missing = [p for p in (folder, *folder.parents) if not os.path.exists(p)]
    try:
        yield prepare_folder(out)
    except BaseException:
        # Stops at the first that is not empty; no path may have some characters.
        with suppress(OSError, ValueError):
            for path in missing:
                path.rmdir()
        raise
