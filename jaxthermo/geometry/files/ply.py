"""PLY files, binary and as text."""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .file_mesh import (
    FileContents,
    FileFault,
    FileMesh,
    FilePart,
    PartName,
    joined_parts,
)
from .polygons import Polygons, triangulated
from .text import decoded, floats, integers, without_mark


_HEADER = re.compile(rb"\s*ply\s.*?[\r\n]end_header[ \t]*(\r\n|\n|\r)", re.S)

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "<"}

_CORNERS = {"vertex_indices", "vertex_index"}


class _Property(NamedTuple):
    """A number, or a list of numbers, of each element."""

    name: str
    number_type: str
    length_type: str | None
    """Type of the length of a list; None for one number."""


class _Element(NamedTuple):
    """A kind of elements, such as vertices."""

    name: str
    count: int
    properties: list[_Property]


class _Header(NamedTuple):
    """Content that a file announces, and the place where it begins."""

    elements: list[_Element]
    format: str
    length: int
    """Number of bytes of the header."""


def read_ply(contents: FileContents) -> FileMesh:
    """Read a PLY: one part."""
    data = without_mark(contents.data)
    header = _header(data)
    if header.format == "ascii":
        vertices, polygons = _read_text(decoded(data[header.length :]), header.elements)
    else:
        vertices, polygons = _read_binary(data, header)
    triangles = triangulated(vertices, polygons)
    return joined_parts(
        [FilePart(PartName(), vertices=vertices, faces=triangles.faces)]
    )


def _header(data: bytes) -> _Header:
    match = _HEADER.match(data)
    if match is None:
        raise FileFault("it does not begin with a header of a PLY")
    file_format = ""
    elements: list[_Element] = []
    for line in decoded(match[0]).split("\n"):
        words = line.split()
        if words[:1] == ["format"]:
            file_format = words[1]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            length_type = _TYPES[words[2]] if words[1] == "list" else None
            number_type = _TYPES[words[-2]]
            elements[-1].properties.append(
                _Property(words[-1], number_type=number_type, length_type=length_type)
            )
    if file_format not in _BYTE_ORDERS:
        raise FileFault(
            f"its format {file_format!r} is none of {', '.join(_BYTE_ORDERS)}"
        )
    if any(element.count < 0 for element in elements):
        raise FileFault("it announces a number of elements less than 0")
    return _Header(elements, format=file_format, length=len(match[0]))


def _vertex_axes(element: _Element) -> list[int]:
    """Places of x, y and z among the properties of the vertices."""
    names = [vertex_property.name for vertex_property in element.properties]
    if not {"x", "y", "z"} <= set(names):
        raise FileFault("its vertices have no properties x, y and z")
    if any(p.length_type for p in element.properties):
        raise FileFault("its vertices have lists of numbers, which are not read")
    return [names.index(axis) for axis in "xyz"]


def _missing(element: _Element, present: int) -> FileFault:
    nouns = {"vertex": "vertices", "face": "faces"}
    noun = nouns.get(element.name, f"elements {element.name}")
    return FileFault(f"it announces {element.count} {noun}, {present} can be read")


def _read_text(
    text: str, elements: list[_Element]
) -> tuple[Float[np.ndarray, "v 3"], Polygons]:
    lines = [line.split() for line in text.split("\n") if line.strip()]
    vertices = np.zeros((0, 3))
    polygons = Polygons(np.zeros(0, np.int64), np.zeros(0, np.int64))
    for element in elements:
        rows = lines[: element.count]
        lines = lines[element.count :]
        if len(rows) < element.count:
            raise _missing(element, present=len(rows))
        if element.name == "vertex":
            axes = _vertex_axes(element)
            for number, row in enumerate(rows, start=1):
                if len(row) != len(element.properties):
                    raise FileFault(
                        f"vertex {number} has {len(row)} numbers, and the header "
                        f"announces {len(element.properties)}"
                    )
            words = [row[axis] for row in rows for axis in axes]
            vertices = floats(words).reshape(-1, 3)
        elif element.name == "face":
            polygons = _text_polygons(element, rows)
    if lines:
        raise FileFault(f"{len(lines)} lines follow the last element of its header")
    return vertices, polygons


def _text_polygons(element: _Element, rows: list[list[str]]) -> Polygons:
    corners: list[str] = []
    counts: list[int] = []
    for number, row in enumerate(rows, start=1):
        column = 0
        for face_property in element.properties:
            if face_property.length_type is None:
                column += 1
                continue
            length = int(row[column]) if column < len(row) else 0
            if face_property.name in _CORNERS:
                corners += row[column + 1 : column + 1 + length]
                counts.append(length)
            column += 1 + length
        if column != len(row):
            raise FileFault(
                f"face {number} has {len(row)} numbers, and {column} are announced"
            )
    return Polygons(integers(corners), np.array(counts, np.int64))


def _read_binary(
    data: bytes, header: _Header
) -> tuple[Float[np.ndarray, "v 3"], Polygons]:
    vertices = np.zeros((0, 3))
    polygons = Polygons(np.zeros(0, np.int64), np.zeros(0, np.int64))
    order = _BYTE_ORDERS[header.format]
    offset = header.length
    for element in header.elements:
        if element.name == "vertex":
            _vertex_axes(element)
            row_type = _row_type(
                data, offset=offset, element=element, order=order
            ).dtype
            present = (len(data) - offset) // row_type.itemsize
            if present < element.count:
                raise _missing(element, present=present)
            rows = np.frombuffer(data, row_type, count=element.count, offset=offset)
            columns = [rows[axis] for axis in "xyz"]
            vertices = np.stack(columns, axis=1).astype(np.float64)
            offset += rows.nbytes
        else:
            faces, offset = _lists(data, offset=offset, element=element, order=order)
            polygons = faces if element.name == "face" else polygons
    trailing = data[offset:].strip(b"\0 \t\r\n")
    if trailing:
        raise FileFault(f"{len(trailing)} bytes follow the last element of its header")
    return vertices, polygons


class _RowType(NamedTuple):
    """Numbers of a row whose lists are of certain lengths."""

    dtype: np.dtype
    lengths: dict[str, int]
    """Length of each list, by the field of the row that states it."""


def _row_type(data: bytes, offset: int, element: _Element, order: str) -> _RowType:
    """Type of the row of an element that begins at `offset`."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    lengths: dict[str, int] = {}
    for row_property in element.properties:
        number_type = order + row_property.number_type
        if row_property.length_type is None:
            fields.append((row_property.name, number_type))
            continue
        length_type = np.dtype(order + row_property.length_type)
        length_offset = offset + np.dtype(fields).itemsize
        if length_offset + length_type.itemsize > len(data):
            raise FileFault(f"it is cut short inside an element {element.name!r}")
        length = int(np.frombuffer(data, length_type, count=1, offset=length_offset)[0])
        if length < 0:
            raise FileFault(f"a list of an element {element.name!r} is shorter than 0")
        length_name = f"length of {row_property.name}"
        lengths[length_name] = length
        fields.append((length_name, length_type.str))
        fields.append((row_property.name, number_type, (length,)))
    return _RowType(np.dtype(fields), lengths=lengths)


def _lists(
    data: bytes, offset: int, element: _Element, order: str
) -> tuple[Polygons, int]:
    """Corners in the rows of an element from `offset` on, and where the rows end."""
    corners = [np.zeros(0, np.int64)]
    counts = [np.zeros(0, np.int64)]
    done = 0
    at_once = 1
    while done < element.count:
        # Rows with lists of the same lengths are read together.
        row_type = _row_type(data, offset=offset, element=element, order=order)
        present = (len(data) - offset) // max(row_type.dtype.itemsize, 1)
        if present < 1:
            raise _missing(element, present=done)
        size = min(present, at_once, element.count - done)
        rows = np.frombuffer(data, row_type.dtype, count=size, offset=offset)
        is_equal = np.ones(size, bool)
        for name, length in row_type.lengths.items():
            is_equal &= rows[name] == length
        run = size if is_equal.all() else int(is_equal.argmin())
        at_once = 2 * size if run == size else 1
        for name in _CORNERS & set(row_type.dtype.names or ()):
            table = rows[name][:run].astype(np.int64).reshape(run, -1)
            corners.append(table.reshape(-1))
            counts.append(np.full(run, table.shape[1]))
        offset += run * row_type.dtype.itemsize
        done += run
    return Polygons(np.concatenate(corners), counts=np.concatenate(counts)), offset
