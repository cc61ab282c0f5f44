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


def read_tiff_pages(
    path: Path, page: int | None = None
) -> list[Shaped[np.ndarray, "..."]]:
    """Read the numbers of the pages of a TIFF file, in their type.

    Reduced copies of pages are none.

    Args:
        path: of the file.
        page: number of the only page to read, counted from 0; None for all pages.

    Raises:
        InputError: for a page that is not there.
        ValueError: for bytes of something else.
    """
    with _tifffile.TiffFile(path) as file:
        pages = _full_pages(file)
        if page is not None and not 0 <= page < len(pages):
            raise InputError(
                f"{path}: there is no page {page}: it has {len(pages)}, from page 0"
            )
        numbers = range(len(pages)) if page is None else (page,)
        return [_page_numbers(path, pages[number], number) for number in numbers]


def _page_numbers(path: Path, page: Any, number: int) -> Shaped[np.ndarray, "..."]:
    try:
        return np.asarray(page.asarray())
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
