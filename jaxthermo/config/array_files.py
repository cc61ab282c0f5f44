"""Arrays that a config names, from files of `numpy.save`."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from ..errors import InputError


def read_labels(path: Path) -> Int[np.ndarray, "x y z"]:
    """A whole number for each voxel of the lattice.

    Raises:
        InputError: if the file holds anything but whole numbers on three axes.
    """
    labels = _read(path)
    if labels.ndim != 3 or labels.dtype.kind not in "iu":
        raise _unlike(path, labels, "whole numbers [x y z]")
    return labels


def read_mask(path: Path) -> Bool[np.ndarray, " s"]:
    """A truth value for each surface fragment.

    Raises:
        InputError: if the file holds anything but a list of them.
    """
    mask = _read(path)
    if mask.ndim != 1 or mask.dtype != bool:
        raise _unlike(path, mask, "one true or false for each fragment")
    return mask


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


def _unlike(path: Path, found: np.ndarray, expected: str) -> InputError:
    shape = list(found.shape)
    return InputError(
        f"{path}: expected {expected}, got {found.dtype} of shape {shape}"
    )
