"""OFF files, as text."""

import re

from .file_mesh import (
    FileContents,
    FileFault,
    FileMesh,
    FilePart,
    PartName,
    joined_parts,
)
from .polygons import Polygons, triangulated
from .text import decoded, integers, positions


_HEADER = re.compile(r"\s*(?:ST)?C?N?(4?n?)OFF\b[ \t]*(BINARY)?")


def read_off(contents: FileContents) -> FileMesh:
    """Read an OFF: one part."""
    text = re.sub(r"#[^\n]*", "", decoded(contents.data))
    header = _HEADER.match(text)
    if header is None:
        raise FileFault("it does not begin like an OFF")
    if header[1] or header[2]:
        variant = (
            "a binary OFF" if header[2] else "an OFF of other than three coordinates"
        )
        raise FileFault(
            f"it is {variant}, which is not read", remedy="export it as text"
        )
    rows = [line.split() for line in text[header.end() :].split("\n") if line.strip()]
    if not rows or len(rows[0]) < 2:
        raise FileFault("it has no line with the numbers of vertices and faces")
    vertex_count, face_count = integers(rows[0][:2]).tolist()
    if vertex_count < 0 or face_count < 0:
        raise FileFault("a number of vertices or faces is less than 0")
    vertex_rows = rows[1 : 1 + vertex_count]
    face_rows = rows[1 + vertex_count :]
    for noun, announced, present in (
        ("vertices", vertex_count, len(vertex_rows)),
        ("faces", face_count, len(face_rows)),
    ):
        if present != announced:
            raise FileFault(f"it announces {announced} {noun}, {present} can be read")
    vertices = positions(vertex_rows)
    counts = integers([row[0] for row in face_rows])
    for number, (row, count) in enumerate(zip(face_rows, counts, strict=True), start=1):
        if len(row) <= count:
            raise FileFault(f"face {number} has {len(row) - 1} of {count} corners")
    corners = [
        word
        for row, count in zip(face_rows, counts, strict=True)
        for word in row[1 : 1 + count]
    ]
    triangles = triangulated(vertices, Polygons(integers(corners), counts=counts))
    return joined_parts(
        [FilePart(PartName(), vertices=vertices, faces=triangles.faces)]
    )
