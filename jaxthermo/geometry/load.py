"""Mesh files to metres and z up, with one line for every error a user can make."""

import io
import logging
import os
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, positive_length
from ..memo.stored import stored
from .mesh import Mesh
from .repair import MAX_HOLE_EDGES, repair_mesh


# Slow to import, and only files that are read for the first time need it.
_trimesh: Any = lazy_loader.load("trimesh")

_FORMATS = (".obj", ".ply", ".stl", ".glb", ".off")
"""Suffixes that `load_mesh` reads."""

_FileMesh = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]


def load_mesh(
    path: str | os.PathLike[str],
    *,
    unit: str | float | int | None = None,
    height: float | int | None = None,
    up: str = "z",
    repair: bool = True,
    max_hole_edges: int = MAX_HOLE_EDGES,
) -> Mesh:
    """Read an OBJ, PLY, STL, GLB or OFF file as one mesh in metres, z up.

    Scenes are merged with their transforms. A GLB is by its standard in metres with y
    up: give `unit="m", up="y"`. An OBJ cut off at the end of a line looks complete:
    check `Mesh.open_edges`.

    Args:
        path: The file; its suffix decides the format.
        unit: Length of one file unit, as a name ("mm") or in metres.
        height: Instead of `unit`: the extent along the up axis [m].
        up: The file's axis that points up: x, y, z, -x, -y or -z.
        repair: Repair what can be repaired (see `repair_mesh`).
        max_hole_edges: Holes with more edges than this stay open [-].

    Raises:
        InputError: naming the file, the mistake and a remedy.
    """
    path = Path(path).expanduser()
    if (unit is None) == (height is None):
        raise InputError(
            f"{path}: give either unit= (such as 'mm') or height= in metres, "
            f"{'neither was given' if unit is None else 'not both'}"
        )
    scale = 1.0 if unit is None else _metres_per_unit(unit)
    target = None if height is None else positive_length("height", height)
    axes = _axes_for_up(up)
    data = _read(path)

    def build() -> Mesh:
        mesh = _meshed(path, data=data, scale=scale, target=target, axes=axes)
        return repair_mesh(mesh, max_hole_edges=max_hole_edges) if repair else mesh

    size = (target or scale, target is None)
    return stored(
        "mesh",
        inputs=(data, path.name, *size, axes, repair, max_hole_edges),
        compute=build,
        types=(Mesh,),
    )


def _meshed(
    path: Path,
    data: bytes,
    scale: float,
    target: float | None,
    axes: tuple[str, str, str],
) -> Mesh:
    """Mesh from a file's bytes, with a unit of `scale` [m] or a height `target` [m]."""
    vertices, faces = _parse(path, data)
    _check_geometry(path, vertices, faces)
    vertices = vertices @ _axes_rotation(axes).T
    if target is not None:
        extent = float(np.ptp(vertices[faces][..., 2]))
        if extent == 0.0:
            raise InputError(
                f"{path}: is flat along up={axes[2]!r}, so height= cannot scale it: "
                "give unit="
            )
        scale = target / extent
    return Mesh(vertices=vertices * scale, faces=faces, name=path.stem, axes=axes)


def _read(path: Path) -> bytes:
    if path.is_dir():
        raise InputError(f"{path}: this is a folder: name a mesh file in it")
    if not path.exists():
        raise InputError(f"{path}: there is no such file: check the path")
    if not path.is_file():
        raise InputError(
            f"{path}: this is a pipe or a device, which would be waited for: name a "
            "file"
        )
    if path.suffix.lower() not in _FORMATS:
        raise InputError(
            f"{path}: files ending in {path.suffix or 'nothing'!r} are not read: "
            f"convert to one of {', '.join(_FORMATS)}"
        )
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}): check its permissions"
        ) from error


def _parse(path: Path, data: bytes) -> _FileMesh:
    suffix = path.suffix.lower()
    if not data.strip(b"\0 \t\r\n"):
        raise _damaged(path, "the file is empty")
    data = _plain_obj(data) if suffix == ".obj" else data
    fault = _file_fault(suffix, data)
    if fault:
        raise _damaged(path, fault)
    data = _plain_text(suffix, data)
    try:
        with _silence():
            scene = _trimesh.load_scene(
                io.BytesIO(data), file_type=suffix[1:], process=False,
                skip_materials=True, fix_texture=False, maintain_order=True,
            )  # fmt: skip
            merged = scene.to_mesh()
            vertices = np.array(merged.vertices, np.float64).reshape(-1, 3)
            faces = np.array(merged.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # the parser's errors have no common type
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        raise _damaged(path, f"damaged or cut short ({reason[:120]})") from error
    points, triangles = _declared_counts(suffix, data) or (0, 0)
    fault = "it announces {} {}, {} can be read"
    if 0 < len(faces) < triangles:
        raise _damaged(path, fault.format(triangles, "faces", len(faces)))
    # Other formats may declare vertices that the parser merges or drops.
    if suffix in (".ply", ".off") and triangles and len(vertices) < points:
        raise _damaged(path, fault.format(points, "vertices", len(vertices)))
    return vertices, faces


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress the parser's warnings and log lines: our error message replaces them."""
    log = logging.getLogger("trimesh")
    discard = logging.NullHandler()
    propagates = log.propagate
    # Its modules log to children of this logger, which propagate to it.
    log.propagate = False
    log.addHandler(discard)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            # numpy only warns where text stops being numbers: that must be an error.
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", ".*could not be read to its end.*")
            yield
    finally:
        log.propagate = propagates
        log.removeHandler(discard)


def _damaged(path: Path, fault: str) -> InputError:
    return InputError(f"{path}: {fault}: export or copy the file again")


def _check_geometry(
    path: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> None:
    if not len(faces):
        raise InputError(
            f"{path}: holds no faces (a point cloud, lines, or no mesh at all): "
            "export a triangle mesh"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise _damaged(path, "a face index is out of range of the vertices")
    bad = int((~np.isfinite(vertices)).any(1).sum())
    if bad:
        raise _damaged(path, f"{bad} of {len(vertices)} vertices are NaN or infinite")
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    # Scaled first: products of very small edges would underflow to zero area.
    span = max(float(np.abs(b - a).max()), float(np.abs(c - a).max()))
    if span == 0.0 or not np.cross((b - a) / span, (c - a) / span).any():
        raise InputError(
            f"{path}: all {len(faces)} faces have zero area: export a mesh with extent"
        )


_METRES = {
    "nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2,
    "dm": 1e-1, "m": 1.0, "km": 1e3, "mil": 2.54e-5, "in": 0.0254, "inch": 0.0254,
    "ft": 0.3048, "foot": 0.3048, "yd": 0.9144,
    "micrometre": 1e-6, "millimetre": 1e-3, "centimetre": 1e-2, "metre": 1.0,
    "micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0,
}  # fmt: skip

# Each is a proper rotation, so that winding and volume keep their sign.
_AXES = {
    "x": ("y", "z", "x"),
    "y": ("x", "-z", "y"),
    "z": ("x", "y", "z"),
    "-x": ("z", "y", "-x"),
    "-y": ("x", "z", "-y"),
    "-z": ("x", "-y", "-z"),
}


def _metres_per_unit(unit: str | float | int) -> float:
    if isinstance(unit, str):
        metres = _METRES.get(unit.strip().lower())
        if metres is None:
            raise InputError(
                f"unit {unit!r} is not known: name one of m, mm, cm, um, in, ft, "
                "or give the metres per file unit as a number"
            )
        return metres
    return positive_length("unit", unit)


def _axes_for_up(up: str) -> tuple[str, str, str]:
    axes = _AXES.get(up.strip().lower().removeprefix("+"))
    if axes is None:
        raise InputError(f"up={up!r} is no axis: name one of {', '.join(_AXES)}")
    return axes


def _axes_rotation(axes: tuple[str, str, str]) -> Float[np.ndarray, "3 3"]:
    """Rotation from file axes to ours: `ours = matrix @ file`."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=True):
        row["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
    return rows


_PLY_HEADER = re.compile(rb"\Aply\s.*?^end_header[^\n]*\n", re.DOTALL | re.MULTILINE)
_OBJ_ZERO = re.compile(rb"^f[^\n]*? 0+(?=[ \n])", re.MULTILINE)
_OBJ_RELATIVE = re.compile(rb"^f[^\n]*? -\d", re.MULTILINE)
_ASCII = bytes(range(128)) + b"?" * 128
_OBJ_SHORT_VERTEX = re.compile(rb"^v +\S+(?: +\S+)? *$", re.MULTILINE)


def _file_fault(suffix: str, data: bytes) -> str | None:
    """Reason why these bytes are no complete file of their format, or None."""
    # An OBJ states no length: one cut between two faces looks complete. PLY and OFF
    # are checked by `_declared_counts` after parsing.
    check = {".stl": _stl_fault, ".glb": _glb_fault, ".obj": _obj_fault}.get(suffix)
    return check(data) if check else None


def _declared_counts(suffix: str, data: bytes) -> tuple[int, int] | None:
    if suffix == ".obj":
        return _lines(data, rb"^v "), _lines(data, rb"^f ")
    if suffix == ".stl" and not _is_binary_stl(data):
        faces = _lines(data.lower(), rb"^\s*facet\b")
        return 3 * faces, faces
    if suffix == ".off":
        counts = re.search(rb"OFF\s+(\d+)\s+(\d+)", re.sub(rb"#[^\n]*", b"", data))
        return (int(counts[1]), int(counts[2])) if counts else None
    header = _PLY_HEADER.match(data) if suffix == ".ply" else None
    if header is None:
        return None
    element = rb"^element\s+(vertex|face)\s+(\d+)"
    by_element = dict(re.findall(element, header[0], re.MULTILINE))
    return int(by_element.get(b"vertex", 0)), int(by_element.get(b"face", 0))


def _plain_obj(data: bytes) -> bytes:
    """Reduce an OBJ to vertices and faces without texture and normal indices."""
    # The parser splits vertices by texture and material, misreads relative indices
    # with normals, and accepts neither tabs nor comments within a line.
    text = data.replace(b"\t", b" ").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.replace(b"\\\n", b" ")
    lines = re.findall(rb"^ *([vf] [^#\n]*)", text, re.MULTILINE)
    return re.sub(rb"/[^ \n]*", b"", b"\n".join(lines)) + b"\n"


def _plain_text(suffix: str, data: bytes) -> bytes:
    """Replace letters beyond ASCII, in names and comments, in a text format."""
    # In Latin-1, as older programs write "solid Gehäuse", they are no UTF-8, and the
    # parser would ask for a library that guesses the encoding.
    begin = 0
    if suffix == ".ply" and (header := _PLY_HEADER.match(data)):
        # Numbers follow, in bytes unless the header says that they are text.
        begin = len(header[0]) if b"format ascii" not in header[0] else len(data)
    elif suffix == ".off" or (suffix == ".stl" and not _is_binary_stl(data)):
        begin = len(data)
    text = data[:begin].translate(_ASCII)
    return text + data[begin:]


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
        begun = _lines(text, rb"^\s*facet\b")
        ended = text.count(b"endfacet")
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
