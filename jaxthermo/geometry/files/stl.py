"""STL files, binary and as text."""

import re

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
from .text import decoded, floats


_HEADER_BYTES = 84

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")])

_FACET = ["facet", "normal", "", "", "", "outer", "loop"]
_FACET += ["vertex", "", "", ""] * 3 + ["endloop", "endfacet"]
"""Words of a facet; the empty ones are numbers."""

_SOLID = re.compile(
    r"^[ \t]*solid\b([^\n]*)\n(.*?)^[ \t]*endsolid\b", re.S | re.M | re.I
)

_MIN_AREA = 1e-6
"""Area of a triangle, over the squared extent of its mesh, below which bytes after the
last triangle are not taken for another one [-]."""


def read_stl(contents: FileContents) -> FileMesh:
    """Read an STL: one part, or one for each solid of a text."""
    data = contents.data
    if len(data) >= _HEADER_BYTES and len(data) == _announced_bytes(data):
        return _read_binary(data)
    # Some exporters begin binary files with "solid" too: only facets are conclusive.
    beginning = decoded(data[:2000]).lower()
    if beginning.lstrip().startswith("solid") and re.search(
        "facet|endsolid", beginning
    ):
        return _read_text(decoded(data))
    if len(data) < _HEADER_BYTES:
        raise FileFault(f"{len(data)} bytes are too few for an STL header")
    return _read_binary(data)


def _announced_count(data: bytes) -> int:
    return int(np.frombuffer(data, "<u4", count=1, offset=_HEADER_BYTES - 4)[0])


def _announced_bytes(data: bytes) -> int:
    return _HEADER_BYTES + _RECORD.itemsize * _announced_count(data)


def _read_binary(data: bytes) -> FileMesh:
    count = _announced_count(data)
    present, remainder = divmod(len(data) - _HEADER_BYTES, _RECORD.itemsize)
    # Programs that write while they compute leave the count at 0.
    if count == 0 and remainder == 0:
        count = present
    if count > present:
        raise FileFault(
            f"the header announces a file of {_announced_bytes(data)} bytes but it has "
            f"{len(data)}: it is cut short or no STL"
        )
    records = np.frombuffer(data, _RECORD, count=present, offset=_HEADER_BYTES)
    corners = records["corners"].astype(np.float64)
    if present > count and _is_triangle_of(corners[count], corners[:count]):
        raise FileFault(f"it announces {count} faces, and more follow")
    faces = np.arange(3 * count).reshape(-1, 3)
    vertices = corners[:count].reshape(-1, 3)
    return joined_parts([FilePart(PartName(), vertices=vertices, faces=faces)])


def _is_triangle_of(
    corners: Float[np.ndarray, "3 3"], mesh: Float[np.ndarray, "f 3 3"]
) -> bool:
    """True if bytes after a mesh, as numbers, are a triangle near it."""
    if not np.isfinite(corners).all() or not len(mesh):
        return bool(np.isfinite(corners).all())
    lower = mesh.min(axis=(0, 1))
    upper = mesh.max(axis=(0, 1))
    extent = float((upper - lower).max())
    is_near = (corners >= lower - extent).all() and (corners <= upper + extent).all()
    one_side = corners[1] - corners[0]
    other_side = corners[2] - corners[0]
    with np.errstate(over="ignore", invalid="ignore"):
        area = float(np.linalg.norm(np.cross(one_side, other_side))) / 2.0
    return bool(is_near and area > _MIN_AREA * extent**2)


def _read_text(text: str) -> FileMesh:
    parts = []
    for solid in _SOLID.finditer(text):
        name = PartName(node=solid[1].strip() or PartName().node)
        vertices = _corners(solid[2])
        faces = np.arange(len(vertices)).reshape(-1, 3)
        parts.append(FilePart(name, vertices=vertices, faces=faces))
    begun = len(re.findall(r"^[ \t]*facet\b", text, re.M | re.I))
    ended = sum(len(part.faces) for part in parts)
    if begun != ended:
        raise FileFault(
            f"it is cut short: {begun} facets begin, {ended} end in a solid"
        )
    if not parts:
        raise FileFault("it is cut short: no endsolid")
    return joined_parts(parts)


def _corners(solid: str) -> Float[np.ndarray, "v 3"]:
    words = solid.lower().split()
    size = len(_FACET)
    for column, keyword in enumerate(_FACET):
        if keyword and any(word != keyword for word in words[column::size]):
            raise FileFault(f"a facet lacks its {keyword!r}, or has other words")
    if len(words) % size:
        raise FileFault("it is cut short inside a facet")
    coordinates = [
        floats(words[column::size])
        for column, keyword in enumerate(_FACET)
        if not keyword and column > _FACET.index("vertex")
    ]
    return np.stack(coordinates, axis=1).reshape(-1, 3)
