"""Files that a config names, and the arrays in those that `numpy.save` wrote.

They are searched for in the config's folder, then in those of JAXTHERMO_MESHES.
"""

import os
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import AfterValidator, Field, PlainSerializer

from ...errors import InputError
from ..shipped_cards import card_name, card_path, is_shipped
from .quantities import Info, refuse


# Key of the validation context with the folders to search.
FOLDERS = "folders"


def _find(path: Path, info: Info) -> Path:
    # Without folders a path stays as written: the files of a finished run may be gone.
    folders: tuple[Path, ...] = (info.context or {}).get(FOLDERS, ())
    for folder in folders:
        if (folder / path).is_file():
            return (folder / path).resolve()
    if folders:
        searched = ", ".join(str(folder) for folder in folders)
        where = searched if not path.is_absolute() else str(path.parent)
        raise refuse(
            f"there is no file '{path}'; looked in {where} (add folders with the "
            f"environment variable JAXTHERMO_MESHES, separated by '{os.pathsep}')"
        )
    return path


# Path of an existing file; left as written where no folders are searched.
FoundPath = Annotated[Path, Field(strict=False), AfterValidator(_find)]


def _find_card(path: Path, info: Info) -> Path:
    if not is_shipped(path):
        return _find(path, info)
    try:
        return card_path(path)
    except InputError as error:
        # A finished run may name a card that was shipped with another version.
        if not (info.context or {}).get(FOLDERS):
            return path
        raise refuse(str(error)) from error


# Path of a fit card; one that is shipped is written out as `card://NAME`.
CardPath = Annotated[
    Path,
    Field(strict=False),
    AfterValidator(_find_card),
    PlainSerializer(card_name, return_type=str, when_used="json"),
]


def read_labels(path: Path) -> Int[np.ndarray, "x y z"]:
    """A whole number for each voxel of the lattice.

    Raises:
        InputError: if the file contains anything but whole numbers on three axes.
    """
    labels = _read(path)
    if labels.ndim != 3 or labels.dtype.kind not in "iu":
        raise _unlike(path, labels, "whole numbers [x y z]")
    return labels


def read_solid(path: Path) -> Bool[np.ndarray, "x y z"]:
    """A truth value for each voxel.

    Raises:
        InputError: if the file contains anything but truth values on three axes.
    """
    solid = _read(path)
    if solid.ndim != 3 or solid.dtype != bool:
        raise _unlike(path, solid, "true or false [x y z]")
    return solid


def read_mask(path: Path) -> Bool[np.ndarray, " s"]:
    """A truth value for each surface fragment.

    Raises:
        InputError: if the file contains anything but a list of truth values.
    """
    mask = _read(path)
    if mask.ndim != 1 or mask.dtype != bool:
        raise _unlike(path, mask, "one true or false for each fragment")
    return mask


def read_fractions(path: Path) -> Float[np.ndarray, " s"]:
    """A number from 0 to 1 for each surface fragment.

    Raises:
        InputError: if the file contains anything but a list of such numbers.
    """
    values = _read(path)
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        raise _unlike(path, values, "one number for each fragment")
    is_fraction = (values >= 0) & (values <= 1)
    if not is_fraction.all():
        raise InputError(f"{path}: expected numbers from 0 to 1, there are others")
    return values.astype(float)


def _read(path: Path) -> np.ndarray:
    try:
        with path.open("rb") as file:
            return np.lib.format.read_array(file, allow_pickle=False)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path}: cannot be read: {reason}") from error
    except Exception as error:  # damaged bytes make the reader raise anything
        raise InputError(
            f"{path}: not an array of numbers, or damaged ({type(error).__name__}); "
            "write it with numpy.save"
        ) from error


def _unlike(path: Path, array: np.ndarray, expected: str) -> InputError:
    shape = list(array.shape)
    return InputError(
        f"{path}: expected {expected}, got {array.dtype} of shape {shape}"
    )
