"""The JSON of a glTF and its arrays: quantized, sparse, compressed, in any buffer."""

import base64
import difflib
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from .file_mesh import FileFault


_GLB_HEADER = struct.Struct("<4sII")
_CHUNK_HEADER = struct.Struct("<I4s")

_COMPONENT_TYPES = {
    5120: "i1",
    5121: "u1",
    5122: "i2",
    5123: "u2",
    5125: "u4",
    5126: "f4",
}

_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_MAX_ZEROS = 10**8
"""Largest number of values of an array that has no bytes in the file [-]."""

_UNDERSTOOD = {
    "KHR_mesh_quantization",
    "EXT_mesh_gpu_instancing",
    "KHR_draco_mesh_compression",
}

_WITHOUT_SHAPE = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_audio",
    "KHR_animation_pointer",
)
"""Beginnings of the names of extensions that leave the positions as they are."""


_ENTRIES = {
    "nodes": "camera children skin matrix mesh rotation scale translation weights",
    "meshes": "primitives weights",
    "primitives": "attributes indices material mode targets",
    "accessors": (
        "bufferView byteOffset componentType normalized count type max min sparse"
    ),
    "bufferViews": "buffer byteOffset byteLength byteStride target",
}
"""Entries of the objects that say where the surface is; all may have further ones."""

_ENTRIES_OF_ALL = ["name", "extensions", "extras"]

_MIN_SIMILARITY = 0.85
"""Similarity of an unknown entry, by difflib, to the one that it stands for [-]."""


@dataclass(frozen=True)
class GltfData:
    """The JSON of a glTF and the bytes of its buffers."""

    document: Any
    buffers: Sequence[bytes | None]
    """None for a buffer that the file does not have."""

    def item(self, collection: str, number: object) -> Any:
        """An entry of a list of the document, such as `meshes`.

        Raises:
            FileFault: if it does not exist.
        """
        items = self.document.get(collection, [])
        # A negative number would count from the end.
        if type(number) is not int or not 0 <= number < len(items):
            raise FileFault(
                f"it refers to {collection}[{number}], which does not exist"
            )
        return items[number]

    def view(self, number: int) -> bytes:
        """Bytes of a buffer view."""
        view = self.item("bufferViews", number)
        compressed = [name for name in _MESHOPT if name in view.get("extensions", {})]
        buffer = self.buffers[view["buffer"]]
        if buffer is None:
            if compressed:
                raise _meshopt_fault(compressed[0])
            raise FileFault(f"the buffer {view['buffer']} has no bytes in the file")
        begin = view.get("byteOffset", 0)
        end = begin + view["byteLength"]
        if not 0 <= begin <= end <= len(buffer):
            raise FileFault(f"the buffer view {number} ends outside of its buffer")
        return buffer[begin:end]

    def stored(self, number: int) -> np.ndarray:
        """Numbers of an accessor as the file stores them, a row for each element."""
        accessor = self.item("accessors", number)
        width = _WIDTHS[accessor["type"]]
        number_type = np.dtype("<" + _COMPONENT_TYPES[accessor["componentType"]])
        count = accessor["count"]
        if "bufferView" in accessor:
            view = self.item("bufferViews", accessor["bufferView"])
            layout = _Layout(
                count=count,
                width=width,
                number_type=number_type,
                offset=accessor.get("byteOffset", 0),
                stride=view.get("byteStride"),
            )
            values = _read(self.view(accessor["bufferView"]), layout)
        else:
            if not 0 <= count * width <= _MAX_ZEROS:
                raise FileFault(
                    f"an array of {count} elements has no bytes in the file"
                )
            values = np.zeros((count, width), number_type)
        if "sparse" in accessor:
            values = self._with_sparse(values, accessor["sparse"])
        return values

    def _with_sparse(self, values: np.ndarray, sparse: Any) -> np.ndarray:
        count = sparse["count"]
        indices = sparse["indices"]
        changed_rows = _read(
            self.view(indices["bufferView"]),
            _Layout(
                count=count,
                width=1,
                number_type=np.dtype("<" + _COMPONENT_TYPES[indices["componentType"]]),
                offset=indices.get("byteOffset", 0),
            ),
        )
        substitutes = _read(
            self.view(sparse["values"]["bufferView"]),
            _Layout(
                count=count,
                width=values.shape[1],
                number_type=values.dtype,
                offset=sparse["values"].get("byteOffset", 0),
            ),
        )
        changed = values.copy()
        changed[changed_rows[:, 0].astype(np.int64)] = substitutes
        return changed

    def numbers(self, number: int) -> np.ndarray:
        """Numbers of an accessor, a row for each element; see `fractions`."""
        return self.fractions(number, self.stored(number))

    def fractions(self, number: int, stored: object) -> np.ndarray:
        """Numbers as an accessor stores them; from -1 to 1 where it is normalized."""
        accessor = self.item("accessors", number)
        number_type = np.dtype(_COMPONENT_TYPES[accessor["componentType"]])
        values = np.asarray(stored, np.float64)
        if not accessor.get("normalized") or number_type.kind == "f":
            return values
        return np.maximum(values / np.iinfo(number_type).max, -1.0)


class _Layout(NamedTuple):
    """Type and place of the numbers of an array in its bytes."""

    count: int
    width: int
    number_type: np.dtype
    offset: int
    stride: int | None = None
    """Distance of its rows [bytes]; None for rows without gaps."""


def _read(data: bytes, layout: _Layout) -> np.ndarray:
    row_bytes = layout.width * layout.number_type.itemsize
    stride = row_bytes if layout.stride is None else layout.stride
    end = layout.offset + (layout.count - 1) * stride + row_bytes
    if layout.count < 1 or layout.offset < 0 or stride < row_bytes or end > len(data):
        raise FileFault(
            f"an array of {layout.count} elements does not fit into {len(data)} bytes"
        )
    return np.ndarray(
        shape=(layout.count, layout.width),
        dtype=layout.number_type,
        buffer=data,
        offset=layout.offset,
        strides=(stride, layout.number_type.itemsize),
    )


def external_addresses(data: bytes) -> list[str]:
    """Addresses of the files that the buffers of a glTF are in.

    Raises:
        FileFault: for a file that is no glTF.
    """
    document, _ = _document(data)
    addresses = [buffer.get("uri") for buffer in document.get("buffers", [])]
    return [a for a in addresses if isinstance(a, str) and not a.startswith("data:")]


def gltf_data(data: bytes, files: Mapping[str, bytes]) -> GltfData:
    """Read the JSON and the buffers of a glTF or GLB.

    Raises:
        FileFault: for one that is incomplete, or that needs what is not understood.
    """
    document, binary = _document(data)
    required = document.get("extensionsRequired", [])
    for name in _MESHOPT:
        if name in required:
            raise _meshopt_fault(name)
    unknown = [
        name
        for name in required
        if name not in _UNDERSTOOD and not name.startswith(_WITHOUT_SHAPE)
    ]
    if unknown:
        raise FileFault(
            f"it requires {', '.join(unknown)}, which is not understood",
            remedy="export it without this extension of glTF",
        )
    _require_entries(document)
    buffers = []
    for number, buffer in enumerate(document.get("buffers", [])):
        content = _buffer(buffer, binary=binary if number == 0 else None, files=files)
        if content is not None and len(content) < buffer["byteLength"]:
            raise FileFault(
                f"the file is cut short: the buffer {number} has {len(content)} of "
                f"{buffer['byteLength']} bytes"
            )
        buffers.append(content)
    return GltfData(document, buffers=buffers)


def _require_entries(document: Any) -> None:
    """Refuse misspelt entries and extensions, which would be ignored.

    A file may have entries of its own beside those of the standard.
    """
    primitives = [p for mesh in document.get("meshes", []) for p in mesh["primitives"]]
    announced = document.get("extensionsUsed", [])
    for collection, names in _ENTRIES.items():
        allowed = names.split() + _ENTRIES_OF_ALL
        is_primitive = collection == "primitives"
        for item in primitives if is_primitive else document.get(collection, []):
            for name in item:
                intended = _intended(name, allowed)
                if intended is not None:
                    raise FileFault(
                        f"one of its {collection} has {name!r}, perhaps for "
                        f"{intended!r}"
                    )
            for name in item.get("extensions", {}):
                if name not in announced:
                    raise FileFault(
                        f"one of its {collection} has the extension {name}, which the "
                        "file does not announce"
                    )


def _intended(name: str, allowed: list[str]) -> str | None:
    """The entry that a misspelt one stands for; None if it is not misspelt."""
    if name in allowed:
        return None
    similar = [entry for entry in allowed if sorted(entry) == sorted(name)]
    similar += difflib.get_close_matches(name, allowed, 1, _MIN_SIMILARITY)
    return similar[0] if similar else None


def _meshopt_fault(name: str) -> FileFault:
    return FileFault(
        f"it is compressed with {name}, which is not read",
        remedy="decompress it: gltfpack -noq -i FILE -o NEW_FILE",
    )


def _document(data: bytes) -> tuple[Any, bytes | None]:
    """The JSON of a glTF, and the bytes of its first buffer if they are in the file."""
    if data[:4] != b"glTF":
        if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
            raise FileFault("it does not begin like a glTF or GLB")
        return _json(data), None
    if len(data) < _GLB_HEADER.size + _CHUNK_HEADER.size:
        raise FileFault("the file is cut short inside its header")
    _, version, length = _GLB_HEADER.unpack_from(data)
    if version != 2:
        raise FileFault(f"its GLB version is {version}, and 2 is read")
    if length > len(data):
        raise FileFault(
            f"the file is cut short: {len(data)} of {length} bytes are there"
        )
    chunks: dict[bytes, bytes] = {}
    offset = _GLB_HEADER.size
    while offset + _CHUNK_HEADER.size <= length:
        size, chunk_type = _CHUNK_HEADER.unpack_from(data, offset)
        offset += _CHUNK_HEADER.size
        if offset + size > length:
            raise FileFault("a chunk is longer than the file")
        chunks.setdefault(chunk_type, data[offset : offset + size])
        offset += size
    if b"JSON" not in chunks:
        raise FileFault("it has no JSON")
    return _json(chunks[b"JSON"]), chunks.get(b"BIN\0")


def _json(data: bytes) -> Any:
    document = json.loads(data.decode("utf-8-sig"))
    version = document["asset"]["version"]
    if not version.startswith("2."):
        raise FileFault(f"its glTF version is {version}, and 2.0 is read")
    return document


def _buffer(
    buffer: Any, binary: bytes | None, files: Mapping[str, bytes]
) -> bytes | None:
    address = buffer.get("uri")
    if address is None:
        return binary
    if address.startswith("data:"):
        header, _, content = address.partition(",")
        if not header.endswith(";base64"):
            raise FileFault("a buffer is in the file, but not in base64")
        return base64.b64decode(unquote(content), validate=True)
    return files[address]
