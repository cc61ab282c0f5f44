"""The reader of each format, and one line for each file that cannot be read."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from ...errors import InputError
from .dae import read_dae
from .file_mesh import FileContents, FileFault, FileMesh, Reader
from .gltf import read_gltf
from .gltf_data import external_addresses
from .obj import read_obj
from .off import read_off
from .ply import read_ply
from .stl import read_stl
from .threemf import read_3mf


_READERS: dict[str, Reader] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".off": read_off,
    ".3mf": read_3mf,
    ".dae": read_dae,
}

_LARGEST = 1e50
"""Coordinate in units of the file whose areas and volumes are still finite numbers."""

FORMATS = tuple(_READERS)
"""Suffixes of the mesh files that can be read."""


def read_contents(path: Path) -> FileContents:
    """Read the bytes of a mesh file and of the files that it refers to.

    Raises:
        InputError: naming the file and a remedy.
    """
    if path.is_dir():
        raise InputError(f"{path}: this is a folder: name a mesh file in it")
    if path.suffix.lower() not in FORMATS and path.is_file():
        raise InputError(
            f"{path}: files ending in {path.suffix or 'nothing'!r} are not read: "
            f"convert to one of {', '.join(FORMATS)}"
        )
    data = _bytes(path)
    if not data.strip(b"\0 \t\r\n"):
        raise _refusal(path, FileFault("the file is empty"))
    files = {}
    if path.suffix.lower() in (".glb", ".gltf"):
        with _one_line(path):
            addresses = external_addresses(data)
        for address in addresses:
            if "://" in address:
                raise InputError(
                    f"{path}: its buffer {address} is not a file: download it and name "
                    "the copy in the glTF"
                )
            files[address] = _bytes(path.parent / unquote(address))
    return FileContents(data, files=files)


def _bytes(path: Path) -> bytes:
    if not path.exists():
        raise InputError(f"{path}: there is no such file: check the path")
    if not path.is_file():
        raise InputError(
            f"{path}: this is a pipe or a device, which would be waited for: name a "
            "file"
        )
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}): check its permissions"
        ) from error


def read_mesh(path: Path, contents: FileContents) -> FileMesh:
    """Read the triangles of a mesh file, which have an area.

    Raises:
        InputError: naming the file, the fault and a remedy.
    """
    with _one_line(path):
        mesh = _READERS[path.suffix.lower()](contents)
        _check_geometry(mesh)
    return mesh


def _refusal(path: Path, fault: FileFault) -> InputError:
    """The line about a file that cannot be read."""
    return InputError(f"{path}: {fault}: {fault.remedy}")


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn any error about the content of a file into one line, the only output."""
    try:
        with _silence():
            yield
    except FileFault as fault:
        raise _refusal(path, fault) from fault
    except Exception as error:  # those of parsers have no common type
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        fault = FileFault(f"damaged or cut short ({reason[:120]})")
        raise _refusal(path, fault) from error


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress the parsers' warnings and log lines: our error message replaces them."""
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


def _check_geometry(mesh: FileMesh) -> None:
    vertices, faces = mesh.vertices, mesh.faces
    if not len(faces):
        raise FileFault(
            "holds no faces (a point cloud, lines, or no mesh at all)",
            remedy="export a triangle mesh",
        )
    bad = int((~(np.abs(vertices) < _LARGEST)).any(1).sum())
    if bad:
        raise FileFault(
            f"{bad} of {len(vertices)} vertices are NaN or infinite, or beyond "
            f"{_LARGEST:g}"
        )
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    # Scaled first: products of very small edges would underflow to zero area.
    span = max(float(np.abs(b - a).max()), float(np.abs(c - a).max()))
    if span == 0.0 or not np.cross((b - a) / span, (c - a) / span).any():
        raise FileFault(
            f"all {len(faces)} faces have zero area", remedy="export a mesh with extent"
        )
