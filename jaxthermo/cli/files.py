"""The folder that a command leaves its results in."""

import os
from pathlib import Path

from ..errors import InputError


def prepare_folder(out: str | Path) -> Path:
    """Creates the folder, before any long work, and makes sure it can be written.

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
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--out {out}: cannot be written; name another folder")
    return folder
