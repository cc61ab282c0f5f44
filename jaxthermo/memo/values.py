"""Nested values as JSON with arrays, and as a file of data alone: it cannot run code.

A file is a mark, a line of JSON with the value and the types of its arrays, the bytes
of the arrays one after the other, and a check sum.
"""

import dataclasses
import json
import math
import zlib
from collections.abc import Callable, Iterable, Mapping
from io import BufferedReader
from typing import IO, Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array


# Changed when the meaning of a file changes.
_MARK = b"jaxthermo result 1\n"

_INTACT = 0x2144DF1C
"""CRC-32 of anything that is followed by its CRC-32."""

_PACKED_BYTES = 2**16
"""Size from which arrays of truth values are bits."""


class NoContentError(TypeError):
    """A value that can neither be hashed nor stored, such as a traced one."""


class PlainValue(NamedTuple):
    """A nested value as JSON has it, with its arrays."""

    json: str
    arrays: list[np.ndarray]

    @classmethod
    def of(cls, value: Any, fields_of: Callable[[Any], Iterable[Any]]) -> "PlainValue":
        """Collect numbers, texts, arrays, and what holds them.

        Args:
            value: of these, tuples, lists, dicts, bytes and sparse arrays.
            fields_of: fields of any other object within it.

        Raises:
            NoContentError: for a value that has no known content.
        """
        arrays: list[np.ndarray] = []

        def plain(value: Any) -> Any:
            if value is None or type(value) in (bool, int, float, str):
                return value
            if isinstance(value, np.ndarray) and not _is_packed(value):
                if value.dtype.kind not in "biuf":
                    raise NoContentError(f"an array of {value.dtype}")
                arrays.append(value)
                return {"array": len(arrays) - 1}
            name = type(value).__name__
            return [name, *map(plain, _items(value, fields_of))]

        return cls(json.dumps(plain(value)), arrays)

    @property
    def size(self) -> int:
        """Size in a file, about [bytes]."""
        return len(self.json) + sum(array.nbytes for array in self.arrays)

    def write(self, file: IO[bytes]) -> None:
        """Write the file of a value."""
        types = json.dumps([[array.dtype.str, array.shape] for array in self.arrays])
        header = _MARK + f"[{self.json}, {types}]\n".encode()
        check_sum = 0
        for content in (header, *map(_bytes_of, self.arrays)):
            check_sum = zlib.crc32(content, check_sum)
            file.write(content)
        file.write(check_sum.to_bytes(4, "little"))


def _is_packed(array: np.ndarray) -> bool:
    return array.dtype == bool and array.nbytes >= _PACKED_BYTES


def _items(value: Any, fields_of: Callable[[Any], Iterable[Any]]) -> Iterable[Any]:
    """Values that a value holds, from which `_restored` makes it again."""
    if type(value) in (tuple, list):
        return value
    if type(value) is dict:
        return value.items()
    if isinstance(value, bytes):
        return [np.frombuffer(value, np.uint8)]
    if isinstance(value, np.generic):
        return [np.asarray(value)]
    if isinstance(value, np.ndarray):
        return [np.packbits(value), value.shape]
    if isinstance(value, csr_array):
        return [value.data, value.indices, value.indptr, value.shape]
    return fields_of(value)


def fields(value: Any) -> list[Any]:
    """Fields of a NamedTuple or dataclass.

    Raises:
        NoContentError: for any other value.
    """
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, type) or not dataclasses.is_dataclass(value):
        raise NoContentError(f"has no fields: {type(value)}")
    return [getattr(value, field.name) for field in dataclasses.fields(value)]


def _bytes_of(array: np.ndarray) -> memoryview:
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def read_value(file: BufferedReader, classes: Mapping[str, type]) -> Any:
    """Read a value, with the classes of its objects by name.

    Raises:
        Exception: of any type, for a file that is damaged or of another format.
    """
    header = file.readline() + file.readline()
    check_sum = zlib.crc32(header)
    plain, types = json.loads(header.removeprefix(_MARK))
    # Every array owns its memory, and goes without the others.
    arrays = [np.empty(shape, dtype) for dtype, shape in types]
    for content in map(_bytes_of, arrays):
        if file.readinto(content) < len(content):
            raise ValueError("cut off")
        check_sum = zlib.crc32(content, check_sum)
    if zlib.crc32(file.read(), check_sum) != _INTACT:
        raise ValueError("damaged")

    def restored(plain: Any) -> Any:
        if isinstance(plain, dict):
            return arrays[plain["array"]]
        if not isinstance(plain, list):
            return plain
        name, *items = plain
        return _restored(name, list(map(restored, items)), classes)

    return restored(plain)


def _restored(name: str, items: list[Any], classes: Mapping[str, type]) -> Any:
    match name:
        case "list":
            return items
        case "tuple":
            return tuple(items)
        case "dict":
            return dict(items)
        case "bytes":
            return items[0].tobytes()
        case "ndarray":
            packed, shape = items
            bits = np.unpackbits(packed, count=math.prod(shape))
            return bits.view(bool).reshape(shape)
        case "csr_array":
            *columns, shape = items
            return csr_array(tuple(columns), shape)
    if name in classes:
        return classes[name](*items)
    (scalar,) = items
    return scalar[()]
