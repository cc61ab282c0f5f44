"""Hashes of code and of values, which are the same in every process."""

import dataclasses
import functools
import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from ..findings import found
from .value_file import NoContentError


_SHARED_BYTES = 2**20
"""Size from which the hash of an array that cannot change is kept."""

_LIBRARY = Path(__file__).parents[1]


@functools.cache
def code_hash(*further: Path) -> str:
    """Hash of the code of this library, and of further files and folders."""
    digest = hashlib.sha256()
    for path in (_LIBRARY, *further):
        files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
        for file in files:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def content_hash(value: Any) -> str:
    """Hash of nested values: numbers, texts, arrays, dataclasses of this library.

    Raises:
        NoContentError: for a value of another type.
    """
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()[:40]


def _feed(digest: Any, value: Any) -> None:
    # With its type and length, or different nestings could give the same bytes.
    if isinstance(value, dict):
        value = sorted(value.items())
    if isinstance(value, np.ndarray | np.generic):
        _feed_array(digest, value)
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)} of ".encode())
        for item in value:
            _feed(digest, item)
    elif value is None or isinstance(value, bool | int | float | str):
        digest.update(f"{value!r};".encode())
    elif isinstance(value, bytes):
        digest.update(f"{len(value)} bytes ".encode())
        digest.update(value)
    elif _is_of_library(value):
        _feed_fields(digest, value)
    else:
        raise NoContentError(f"cannot be hashed: {type(value)}")


def _is_of_library(value: Any) -> bool:
    """True for a dataclass whose code is part of `code_hash`."""
    value_type = type(value)
    return dataclasses.is_dataclass(value_type) and value_type.__module__.startswith(
        "jaxthermo."
    )


def _feed_fields(digest: Any, value: Any) -> None:
    fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    _feed(digest, type(value).__qualname__)
    if type(value).__hash__ is not object.__hash__:
        _feed(digest, fields)
    else:
        # Compared by identity, such as a grid: its arrays do not change.
        code = found((value,), "content_hash", lambda: content_hash(fields))
        digest.update(code.encode())


def _feed_array(digest: Any, value: np.ndarray | np.generic) -> None:
    if value.dtype.kind not in "biuf":
        raise NoContentError(f"cannot be hashed: values of {value.dtype}")
    # How a number prints depends on numpy's options.
    digest.update(f"{value.dtype.str}{value.shape}".encode())
    array = np.asarray(value)
    is_fixed = not array.flags.writeable and array.base is None
    # Several searches start from the same large arrays.
    if is_fixed and array.nbytes >= _SHARED_BYTES:
        digest.update(found((array,), "content_hash", lambda: _array_hash(array)))
    else:
        digest.update(_array_hash(array))


def _array_hash(array: np.ndarray) -> bytes:
    content = np.packbits(array) if array.dtype == bool else np.ascontiguousarray(array)
    return hashlib.sha256(content.data).digest()
