"""Files that a config names: looked for beside it, then in the folders for meshes."""

import os
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from .fields import Info, refuse


FOLDERS = "folders"
"""The key of the validation context that holds the folders to look in."""


def _find(path: Path, info: Info) -> Path:
    folders: tuple[Path, ...] = (info.context or {}).get(FOLDERS, ())
    for folder in folders:
        if (folder / path).is_file():
            return (folder / path).resolve()
    if folders:
        looked = ", ".join(str(folder) for folder in folders)
        places = looked if not path.is_absolute() else str(path.parent)
        raise refuse(
            f"there is no file '{path}'; looked in {places} (add folders with the "
            f"environment variable JAXTHERMO_MESHES, separated by '{os.pathsep}')"
        )
    return path


FoundPath = Annotated[Path, Field(strict=False), AfterValidator(_find)]
"""Of a file that is there; as it is written where no folders are given."""
