"""Checks that a mesh file is complete, by what each format states about its length."""

import re
import struct


_PLY_HEADER = re.compile(rb"\Aply\s.*?^end_header[^\n]*\n", re.DOTALL | re.MULTILINE)
_OBJ_ZERO = re.compile(rb"^f[^\n]*? 0+(?=[ \n])", re.MULTILINE)
_OBJ_RELATIVE = re.compile(rb"^f[^\n]*? -\d", re.MULTILINE)
_OBJ_SHORT_VERTEX = re.compile(rb"^v +\S+(?: +\S+)? *$", re.MULTILINE)

Counts = tuple[int, int]


def file_fault(suffix: str, data: bytes) -> str | None:
    """Reason why these bytes are no complete file of their format, or None.

    Args:
        suffix: of the file, in lower case.
        data: its bytes, of an OBJ the result of `plain_obj`.
    """
    # An OBJ states no length: one cut between two faces looks complete. PLY and OFF
    # are checked by `declared_counts` after parsing.
    check = {".stl": _stl_fault, ".glb": _glb_fault, ".obj": _obj_fault}.get(suffix)
    return check(data) if check else None


def declared_counts(suffix: str, data: bytes) -> Counts | None:
    """Numbers of vertices and faces that the file declares, if its format does."""
    if suffix == ".obj":
        return _lines(data, rb"^v "), _lines(data, rb"^f ")
    if suffix == ".stl" and not _is_binary_stl(data):
        faces = _lines(data.lower(), rb"^\s*facet\b")
        return 3 * faces, faces
    if suffix == ".off":
        return _off_counts(data)
    if suffix == ".ply":
        return _ply_counts(data)
    return None


def plain_obj(data: bytes) -> bytes:
    """Reduce an OBJ to vertices and faces without texture and normal indices."""
    # The parser splits vertices by texture and material, misreads relative indices
    # with normals, and accepts neither tabs nor comments within a line.
    text = data.replace(b"\t", b" ").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.replace(b"\\\n", b" ")
    lines = re.findall(rb"^ *([vf] [^#\n]*)", text, re.MULTILINE)
    return re.sub(rb"/[^ \n]*", b"", b"\n".join(lines)) + b"\n"


def _lines(data: bytes, pattern: bytes) -> int:
    return sum(1 for _ in re.finditer(pattern, data, re.MULTILINE))


def _is_binary_stl(data: bytes) -> bool:
    return len(data) >= 84 and len(data) == _stl_length(data)


def _stl_length(data: bytes) -> int:
    return 84 + 50 * struct.unpack_from("<I", data, 80)[0]


def _stl_fault(data: bytes) -> str | None:
    if _is_binary_stl(data):
        return None
    text = data.lower()
    # Some exporters begin binary files with "solid" too: only facets are conclusive.
    if text.lstrip().startswith(b"solid") and b"facet" in text[:2000]:
        begun, ended = _lines(text, rb"^\s*facet\b"), text.count(b"endfacet")
        if begun != ended:
            return f"the file is cut short: {begun} facets begin, {ended} end"
        return None if b"endsolid" in text else "the file is cut short: no endsolid"
    if len(data) < 84:
        return f"{len(data)} bytes are too few for an STL header"
    return (
        f"the header announces a file of {_stl_length(data)} bytes but it has "
        f"{len(data)}: it is cut short or no STL"
    )


def _glb_fault(data: bytes) -> str | None:
    if data[:4] != b"glTF":
        return "it does not begin like a GLB"
    if len(data) < 20:
        return "the file is cut short inside its header"
    length = struct.unpack_from("<I", data, 8)[0]
    if length > len(data):
        return f"the file is cut short: {len(data)} of {length} bytes are there"
    return None


def _obj_fault(data: bytes) -> str | None:
    short = _OBJ_SHORT_VERTEX.search(data)
    if short:
        number = _lines(data[: short.start()], rb"^v ") + 1
        return f"vertex {number} has fewer than three coordinates"
    # The parser would silently read vertex 0 as vertex 1.
    if _OBJ_ZERO.search(data):
        return "a face index is 0, and OBJ counts from 1: an index out of range"
    if _OBJ_RELATIVE.search(data) and data.rfind(b"\nv ") > data.find(b"\nf "):
        return "faces with negative indices stand between the vertices: use positive"
    return None


def _off_counts(data: bytes) -> Counts | None:
    text = re.sub(rb"#[^\n]*", b"", data)
    match = re.search(rb"OFF\s+(\d+)\s+(\d+)", text)
    return (int(match[1]), int(match[2])) if match else None


def _ply_counts(data: bytes) -> Counts | None:
    header = _PLY_HEADER.match(data)
    if header is None:
        return None
    counts = {
        name: int(number)
        for name, number in re.findall(
            rb"^element\s+(vertex|face)\s+(\d+)", header[0], re.MULTILINE
        )
    }
    return counts.get(b"vertex", 0), counts.get(b"face", 0)
