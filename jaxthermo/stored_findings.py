"""Findings on disk: what a search in geometry found, for the next process.

A file's name is the hash of everything that its search starts from, with the program
that searches. Reading it is much faster than searching again. Nothing but numbers,
texts and arrays is stored, and classes that the caller names: a file cannot run code.

`findings` keeps the same within one process, by the identity of objects.
"""

import dataclasses
import functools
import hashlib
import json
import math
import re
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar

import numpy as np
from scipy.sparse import csr_array

from . import user_cache
from .findings import found


# Incremented when the meaning of the files changes.
_FORMAT = 1

_MAX_BYTES = 2 * 1024**3
"""Size of all files together; the least recently used are removed first."""

_MAX_FILE_BYTES = _MAX_BYTES // 8

_MIN_SECONDS = 0.03
"""Duration of a search below which it is as fast to search again."""

_MEMO_BYTES = 2**20
"""Size from which the hash of an array that cannot change is kept."""

_ALIGNMENT = 64
_MARK = b"jaxthermo finding\n"
_PACKED_BYTES = 2**16
"""Size from which arrays of truth values are stored as bits."""

# Packages whose code the findings depend on; any change of it invalidates all files.
_SEARCHES = ("geometry", "raster", "voxels", "structures", "physics", "image")
_OWN_FILES = re.compile(r"\.?[a-z_]+-[0-9a-f]{40}(\.\d+-[0-9a-f]{8})?\.bin")

_OWN_CLASSES = ("jaxthermo.",)

_T = TypeVar("_T")
_P = ParamSpec("_P")


class _Unknown(TypeError):
    """A value that cannot be hashed or stored."""


def stored_search(
    search: str, types: tuple[type, ...] = ()
) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Decorator of a search whose result depends on its arguments alone; see `stored`.

    Args:
        search: Its name, in lower case.
        types: Dataclasses and NamedTuples that occur in what it finds.
    """

    def decorated(find: Callable[_P, _T]) -> Callable[_P, _T]:
        @functools.wraps(find)
        def run(*args: _P.args, **kwargs: _P.kwargs) -> _T:
            return stored(
                search,
                inputs=(args, kwargs),
                find=lambda: find(*args, **kwargs),
                types=types,
            )

        return run

    return decorated


def stored(
    search: str, inputs: Any, find: Callable[[], _T], types: tuple[type, ...] = ()
) -> _T:
    """Return what a search found before, in any process, or search and store it.

    Args:
        search: Its name, in lower case.
        inputs: Everything that the result depends on: numbers, texts, arrays, None, or
            tuples, dicts and own dataclasses of these. With anything else, such as a
            traced value or a class of the user, nothing is stored.
        find: The search, whose result has values of these kinds and of `types`.
        types: Dataclasses and NamedTuples that occur in what it finds.
    """
    folder = user_cache.cache_folder("findings")
    if folder is None:
        return find()
    try:
        key = content_hash((_FORMAT, code_hash(*_SEARCHES), search, inputs))
    except _Unknown:
        return find()
    path = folder / f"{search}-{key}.bin"
    classes = {named_class.__name__: named_class for named_class in types}
    stored_value = _read(path, classes)
    if stored_value is not None:
        return stored_value[0]
    clock = time.perf_counter()
    value = find()
    if time.perf_counter() - clock >= _MIN_SECONDS:
        _write(path, value, classes)
    return value


def content_hash(value: Any) -> str:
    """Hash of nested values; the same in every process.

    Raises:
        TypeError: for a value of a type that has no known content.
    """
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()[:40]


def _feed(digest: Any, value: Any) -> None:
    # With its type and length, or different nestings could give the same bytes.
    if isinstance(value, dict):
        value = sorted(value.items())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + _array_hash(value))
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)} of ".encode())
        for item in value:
            _feed(digest, item)
    elif isinstance(value, np.generic):
        # How one prints depends on numpy's options.
        digest.update(f"{value.dtype.str};".encode() + _array_hash(np.asarray(value)))
    elif value is None or isinstance(value, bool | int | float | str):
        digest.update(f"{value!r};".encode())
    elif isinstance(value, bytes):
        digest.update(f"{len(value)} bytes ".encode())
        digest.update(value)
    elif _is_own(value):
        _feed_fields(digest, value)
    else:
        raise _Unknown(f"cannot be hashed: {type(value)}")


def _is_own(value: Any) -> bool:
    """True for a dataclass whose code is part of this program's hash."""
    value_type = type(value)
    return dataclasses.is_dataclass(value_type) and value_type.__module__.startswith(
        _OWN_CLASSES
    )


def _feed_fields(digest: Any, value: Any) -> None:
    fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    name = type(value).__qualname__
    if type(value).__hash__ is not object.__hash__:
        return _feed(digest, (name, fields))
    # Compared by identity, such as a grid: its arrays do not change.
    digest.update(
        found((value,), "content_hash", lambda: content_hash(fields)).encode()
    )
    return _feed(digest, name)


def _array_hash(array: np.ndarray) -> bytes:
    if array.dtype.kind not in "biuf":
        raise _Unknown(f"cannot be hashed: an array of {array.dtype}")
    # Several searches start from the same large arrays.
    if array.flags.writeable or array.base is not None or array.nbytes < _MEMO_BYTES:
        return _bytes_hash(array)
    return found((array,), "content_hash", lambda: _bytes_hash(array))


def _bytes_hash(array: np.ndarray) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(array).data).digest()


@functools.cache
def code_hash(*packages: str) -> str:
    """Hash of the code in packages of this library, and in its single files."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    paths = [path for name in packages for path in (folder / name).rglob("*.py")]
    for path in sorted([*paths, *folder.glob("*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _Arrays:
    """Arrays of a file, one after the other, each at a multiple of the alignment."""

    def __init__(self) -> None:
        self.blocks: list[np.ndarray] = []
        self.size = 0

    def add(self, array: np.ndarray) -> dict[str, Any]:
        """Append an array; return its location and type for the header."""
        if array.dtype.kind not in "biuf":
            raise _Unknown(f"cannot be stored: an array of {array.dtype}")
        packed = array.dtype == bool and array.nbytes >= _PACKED_BYTES
        block = np.packbits(array) if packed else np.ascontiguousarray(array)
        location = {"at": self.size, "bytes": block.nbytes, "packed": packed}
        self.blocks.append(block)
        self.size += -(-block.nbytes // _ALIGNMENT) * _ALIGNMENT
        return location | {"dtype": array.dtype.str, "shape": list(array.shape)}

    def content(self) -> Iterator[memoryview | bytes]:
        """Bytes of all arrays, one after the other, without copies."""
        for block in self.blocks:
            yield block.reshape(-1).view(np.uint8).data
            yield bytes(-block.nbytes % _ALIGNMENT)


def _encoded(value: Any, classes: dict[str, type], arrays: _Arrays) -> Any:
    """Plain values for JSON, with the places of arrays."""

    def encode(item: Any) -> Any:
        return _encoded(item, classes, arrays)

    value_type: Any = type(value)
    name = value_type.__name__
    if value is None or value_type in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        shape = "array" if isinstance(value, np.ndarray) else "scalar"
        return {shape: arrays.add(np.asarray(value))}
    if isinstance(value, csr_array):
        columns = [encode(x) for x in (value.data, value.indices, value.indptr)]
        sizes: Any = value.shape
        return {"csr": columns, "shape": list(sizes)}
    if classes.get(name) is value_type:
        return {"type": name, "fields": [encode(item) for item in _fields(value)]}
    if value_type is tuple or value_type is list:
        return {name: list(map(encode, value))}
    if value_type is dict:
        return {"dict": [[encode(key), encode(item)] for key, item in value.items()]}
    raise _Unknown(f"cannot be stored: {value_type}")


def _fields(value: Any) -> list[Any]:
    if isinstance(value, tuple):
        return list(value)
    return [getattr(value, field.name) for field in dataclasses.fields(value)]


def _decoded(plain: Any, classes: dict[str, type], buffer: bytearray) -> Any:
    if not isinstance(plain, dict):
        return plain

    def decode(item: Any) -> Any:
        return _decoded(item, classes, buffer)

    if "array" in plain:
        return _array(plain["array"], buffer)
    if "scalar" in plain:
        return _array(plain["scalar"], buffer)[()]
    if "csr" in plain:
        return csr_array(tuple(map(decode, plain["csr"])), tuple(plain["shape"]))
    if "type" in plain:
        return classes[plain["type"]](*map(decode, plain["fields"]))
    if "dict" in plain:
        return {decode(key): decode(item) for key, item in plain["dict"]}
    if "tuple" in plain:
        return tuple(map(decode, plain["tuple"]))
    return list(map(decode, plain["list"]))


def _array(location: dict[str, Any], buffer: bytearray) -> np.ndarray:
    dtype = np.dtype(location["dtype"])
    shape = tuple(location["shape"])
    block = np.frombuffer(buffer, np.uint8, location["bytes"], location["at"])
    if location["packed"]:
        return np.unpackbits(block, count=math.prod(shape)).view(bool).reshape(shape)
    return block.view(dtype).reshape(shape)


def _read(path: Path, classes: dict[str, type]) -> tuple[Any] | None:
    """Value of a file, in a tuple; None if the file is missing or damaged."""
    try:
        with path.open("rb") as file:
            if file.readline() != _MARK:
                return None
            header = file.readline()
            check_sum = file.readline()
            buffer = bytearray(int(file.readline()))
            is_complete = file.readinto(buffer) == len(buffer) and not file.read(1)
        if not is_complete or zlib.crc32(buffer, zlib.crc32(header)) != int(check_sum):
            return None
        value = _decoded(json.loads(header), classes, buffer)
    except Exception:  # a damaged or foreign file raises any exception
        return None
    user_cache.mark_used(path)
    return (value,)


def _write(path: Path, value: Any, classes: dict[str, type]) -> None:
    arrays = _Arrays()
    try:
        header = json.dumps(_encoded(value, classes, arrays)).encode() + b"\n"
    except _Unknown:
        return
    if arrays.size > _MAX_FILE_BYTES:
        return
    check_sum = zlib.crc32(header)
    for block in arrays.content():
        check_sum = zlib.crc32(block, check_sum)

    def write(file: IO[bytes]) -> None:
        file.write(_MARK + header + b"%d\n%d\n" % (check_sum, arrays.size))
        file.writelines(arrays.content())

    user_cache.keep(path, write, _OWN_FILES, _MAX_BYTES)
