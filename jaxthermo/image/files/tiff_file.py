"""Frames in TIFF files: one number for each pixel, on one or several pages."""

import logging
from pathlib import Path
from typing import Any

import lazy_loader
import numpy as np
from jaxtyping import Shaped
from PIL import Image as Pictures

from ...errors import InputError


# With scikit-image.
_tifffile: Any = lazy_loader.load("tifffile")

# Without a handler Python prints what its reader logs of damaged files, which the
# errors here say.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def tiff_page_count(path: Path) -> int:
    """Number of pages of a TIFF file, without reduced copies of others.

    Raises:
        ValueError: for bytes of something else.
    """
    with _tifffile.TiffFile(path) as file:
        return len(_full_pages(file))


def read_tiff_numbers(path: Path, page: int | None = None) -> Shaped[np.ndarray, "..."]:
    """Read the numbers of a page of a TIFF file, counted from 0, in their type.

    Args:
        path: of the file.
        page: number of the page; None if there is only one.

    Raises:
        InputError: for a page that is not there, or None of several.
        ValueError: for bytes of something else.
    """
    with _tifffile.TiffFile(path) as file:
        pages = _full_pages(file)
        if page is None and len(pages) > 1:
            raise InputError(
                f"{path} has {len(pages)} pages, and a frame is one of them: give its "
                f"number, page=0 to page={len(pages) - 1}"
            )
        number = page or 0
        if not 0 <= number < len(pages):
            raise InputError(
                f"{path}: there is no page {number}: it has {len(pages)}, from page 0"
            )
        try:
            return np.asarray(pages[number].asarray())
        except ValueError as error:
            # Pillow reads more compressions, but fewer types of numbers.
            return _read_by_pillow(path, number, error)


def _full_pages(file: Any) -> list[Any]:
    pages = [page for page in file.pages if not page.is_reduced]
    if not pages:
        raise ValueError("it has no picture")
    return pages


def _read_by_pillow(path: Path, page: int, reason: Exception) -> np.ndarray:
    with Pictures.open(path) as picture:
        if page or getattr(picture, "n_frames", 1) > 1:
            raise reason
        return np.asarray(picture)
