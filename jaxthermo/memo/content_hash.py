"""Hashes of code and of values, which are the same in every process."""

import functools
import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .found import digest, found
from .values import NoContentError, PlainValue, fields


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
    """Hash of numbers, texts, arrays, dataclasses of this library, and nests of these.

    Raises:
        NoContentError: for a value of another type.
    """
    plain = PlainValue.of(value, _hashed_fields)
    hashed = hashlib.sha256(plain.json.encode())
    for array in plain.arrays:
        hashed.update(repr(digest(array)).encode())
    return hashed.hexdigest()[:40]


def _hashed_fields(value: Any) -> Iterable[Any]:
    """Fields of a tuple, or of a dataclass whose code is part of `code_hash`."""
    value_type = type(value)
    is_ours = value_type.__module__.startswith("jaxthermo.")
    if not is_ours and not isinstance(value, tuple):
        raise NoContentError(f"cannot be hashed: {value_type}")
    values = fields(value)
    if value_type.__hash__ is not object.__hash__:
        return values
    # Compared by identity, such as a grid: its arrays do not change.
    return [found((value,), "content_hash", lambda: content_hash(values))]
