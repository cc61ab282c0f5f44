"""Nested values as a file, which holds data alone: it cannot run code.

A mark, a line of JSON with the nesting and the types of the arrays, the bytes of the
arrays one after the other, and a check sum of everything before it.
"""

import dataclasses
import json
import math
import os
import zlib
from collections.abc import Mapping
from io import BufferedReader
from typing import IO, Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array


# Changed when the meaning of a file changes.
_MARK = b"jaxthermo result 1\n"

_CHECK_SUM_BYTES = 4

_PACKED_BYTES = 2**16
"""Size from which arrays of truth values are stored as bits."""


class NoContentError(TypeError):
    """A value that cannot be hashed or stored, such as a traced one."""


class EncodedValue(NamedTuple):
    """A value as it is written."""

    header: bytes
    blocks: list[np.ndarray]

    @property
    def size(self) -> int:
        """Size of the file [bytes]."""
        arrays = sum(block.nbytes for block in self.blocks)
        return len(self.header) + arrays + _CHECK_SUM_BYTES

    def write(self, file: IO[bytes]) -> None:
        """Write the file."""
        check_sum = 0
        for content in (self.header, *map(_bytes_of, self.blocks)):
            check_sum = zlib.crc32(content, check_sum)
            file.write(content)
        file.write(check_sum.to_bytes(_CHECK_SUM_BYTES, "little"))


def encode(value: Any, classes: Mapping[str, type]) -> EncodedValue:
    """Encode numbers, texts, arrays, tuples, lists, dicts, and classes of given names.

    Raises:
        NoContentError: for a value of another type.
    """
    encoder = _Encoder(classes)
    plain = encoder.plain(value)
    header = json.dumps([plain, encoder.types]).encode()
    return EncodedValue(_MARK + header + b"\n", encoder.blocks)


def read_value(file: BufferedReader, classes: Mapping[str, type]) -> Any:
    """Read a value that was encoded with the same classes.

    Raises:
        Exception: of any type, for a file that is damaged or of another format.
    """
    mark = file.readline()
    header = file.readline()
    check_sum = zlib.crc32(mark + header)
    if mark != _MARK:
        raise ValueError("another format")
    plain, types = json.loads(header)
    arrays = [_ArrayType(*described) for described in types]
    size = sum(array.size for array in arrays) + _CHECK_SUM_BYTES
    # Before memory is allocated.
    if file.tell() + size != os.fstat(file.fileno()).st_size:
        raise ValueError("another size")
    values = []
    for array in arrays:
        block = array.read(file)
        check_sum = zlib.crc32(_bytes_of(block), check_sum)
        values.append(array.unpacked(block))
    if int.from_bytes(file.read(), "little") != check_sum:
        raise ValueError("another check sum")
    return _decoded(plain, classes, values)


def _bytes_of(block: np.ndarray) -> memoryview:
    return block.reshape(-1).view(np.uint8).data


class _ArrayType(NamedTuple):
    """Type of an array, and whether its truth values are bits in the file."""

    dtype: str
    shape: list[int]
    is_packed: bool

    @property
    def count(self) -> int:
        return math.prod(self.shape)

    @property
    def size(self) -> int:
        """Size in the file [bytes]."""
        if self.is_packed:
            return -(-self.count // 8)
        return self.count * np.dtype(self.dtype).itemsize

    def read(self, file: BufferedReader) -> np.ndarray:
        """Array as it is in the file."""
        if np.dtype(self.dtype).kind not in "biuf":
            raise ValueError("an array of something else")
        # Every array owns its memory, and goes without the others.
        if self.is_packed:
            block = np.empty(self.size, np.uint8)
        else:
            block = np.empty(self.shape, self.dtype)
        file.readinto(_bytes_of(block))
        return block

    def unpacked(self, block: np.ndarray) -> np.ndarray:
        """Array from what is in the file."""
        if not self.is_packed:
            return block
        return np.unpackbits(block, count=self.count).view(bool).reshape(self.shape)


class _Encoder:
    """Plain values for JSON, in which arrays are numbers of blocks."""

    def __init__(self, classes: Mapping[str, type]):
        self.classes = classes
        self.types: list[_ArrayType] = []
        self.blocks: list[np.ndarray] = []

    def plain(self, value: Any) -> Any:
        """Return a value of JSON, and collect the arrays within it."""
        value_type: Any = type(value)
        name = value_type.__name__
        if value is None or value_type in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray | np.generic):
            return {
                "array": self._add(np.asarray(value)),
                "is_scalar": isinstance(value, np.generic),
            }
        if isinstance(value, csr_array):
            columns = (value.data, value.indices, value.indptr)
            sizes: Any = value.shape
            return {"csr": self._all(columns), "shape": list(sizes)}
        if self.classes.get(name) is value_type:
            return {"type": name, "fields": self._all(_fields(value))}
        if value_type in (tuple, list):
            return {name: self._all(value)}
        if value_type is dict:
            return {"dict": [self._all(item) for item in value.items()]}
        raise NoContentError(f"cannot be stored: {value_type}")

    def _all(self, values: Any) -> list[Any]:
        return [self.plain(value) for value in values]

    def _add(self, array: np.ndarray) -> int:
        if array.dtype.kind not in "biuf":
            raise NoContentError(f"cannot be stored: an array of {array.dtype}")
        is_packed = array.dtype == bool and array.nbytes >= _PACKED_BYTES
        block = np.packbits(array) if is_packed else np.ascontiguousarray(array)
        self.types.append(_ArrayType(array.dtype.str, list(array.shape), is_packed))
        self.blocks.append(block)
        return len(self.blocks) - 1


def _fields(value: Any) -> list[Any]:
    if isinstance(value, tuple):
        return list(value)
    return [getattr(value, field.name) for field in dataclasses.fields(value)]


def _decoded(plain: Any, classes: Mapping[str, type], arrays: list[np.ndarray]) -> Any:
    if not isinstance(plain, dict):
        return plain

    def decoded(items: list[Any]) -> list[Any]:
        return [_decoded(item, classes, arrays) for item in items]

    if "array" in plain:
        array = arrays[plain["array"]]
        return array[()] if plain["is_scalar"] else array
    if "csr" in plain:
        return csr_array(tuple(decoded(plain["csr"])), tuple(plain["shape"]))
    if "type" in plain:
        return classes[plain["type"]](*decoded(plain["fields"]))
    if "dict" in plain:
        return dict(map(decoded, plain["dict"]))
    if "tuple" in plain:
        return tuple(decoded(plain["tuple"]))
    return decoded(plain["list"])
