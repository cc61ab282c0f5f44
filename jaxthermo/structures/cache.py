"""Structures on disk: what was once built for the same voxels is read back.

The file's name is a hash of everything a structure follows from: the mesh, the voxels,
the fragments, the options and the code that builds. `JAXTHERMO_CACHE` names another
folder, or is "off". The cache never makes a build fail: what cannot be read is built,
and what cannot be written is not kept.
"""

import contextlib
import functools
import hashlib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..atomic import replacing
from ..errors import InputError
from ..voxels.grid import VoxelGrid
from .structure import Built, Links, Nodes


FORMAT = 3
"""Raised when the arrays in a file come to mean something else."""

LEAST_VOXELS = 20_000
"""Smaller bodies are built as fast as they are read."""

MOST_BYTES = 2 * 1024**3
"""Of all files together; what was not used for longest goes first."""

_OURS = re.compile(r"\.?[a-z_]+-[0-9a-f]{40}(\.[0-9a-f]{8})?\.npz")
"""A file of ours, finished or left behind by a process that was killed."""


def cached(
    kind: str, grid: VoxelGrid, options: dict[str, Any], build: Callable[[], Built]
) -> Built:
    """What `build` gives, read from disk where it was built before.

    Args:
        kind: of structure, in lower case and underscores.
        grid: the body.
        options: all else that the result depends on: numbers, texts, arrays, or
            tuples and dicts of these.
        build: makes the arrays.
    """
    folder = cache_folder()
    if folder is None or grid.solid_count < LEAST_VOXELS:
        return build()
    path = folder / f"{kind}-{_key(kind, grid, options)}.npz"
    built = _read(path)
    if built is None:
        built = build()
        _write(path, built)
    return built


def cache_folder() -> Path | None:
    """Where structures are kept; None if they are not."""
    named = os.environ.get("JAXTHERMO_CACHE", "")
    if named == "off":
        return None
    try:
        if named:
            return Path(named).expanduser() / "structures"
        per_user = Path(os.environ.get("XDG_CACHE_HOME", ""))
        if not per_user.is_absolute():
            per_user = Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        return None
    return per_user / "jaxthermo" / "structures"


def _key(kind: str, grid: VoxelGrid, options: dict[str, Any]) -> str:
    """Hash of everything that a structure follows from."""
    digest = hashlib.sha256()
    lattice = grid.lattice
    _feed(digest, [FORMAT, _code(), kind, options])
    _feed(digest, [grid.mesh.vertices, grid.mesh.faces])
    _feed(digest, [lattice.shape, lattice.origin, lattice.pitch])
    _feed(digest, [np.packbits(grid.solid), grid.volume_ratio])
    _feed(digest, [grid.fragment_voxel, grid.fragment_position])
    _feed(digest, [grid.fragment_normal, grid.fragment_area])
    return digest.hexdigest()[:40]


@functools.cache
def _code() -> str:
    """Hash of the files that build voxels and structures: edited ones build anew."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    for path in sorted([*here.rglob("*.py"), *here.parent.glob("voxels/*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    """Add a value to a hash, with its type and its length."""
    if isinstance(value, dict):
        value = sorted(value.items())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8))
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)} of ".encode())
        for item in value:
            _feed(digest, item)
    elif value is None or isinstance(value, bool | int | float | str | np.generic):
        digest.update(f"{value!r};".encode())
    else:
        raise TypeError(f"cannot be told apart in a hash: {type(value)}")


def _read(path: Path) -> Built | None:
    """The structure in a file; None if there is none or it is damaged or not ours."""
    try:
        with path.open("rb") as stream, np.load(stream) as file:
            # Arrays are not read to the very end, where check sums are compared.
            if file.zip.testzip() is not None:
                return None
            built = _from_arrays(dict(file))
    except Exception:  # damaged bytes make the readers of zip and npy raise anything
        return None
    # Marks the file as used, for whoever makes room.
    with contextlib.suppress(OSError):
        os.utime(path)
    return built


def _write(path: Path, built: Built) -> None:
    """Keep the arrays, if that can be done and leaves room for others."""
    arrays = _to_arrays(built)
    if sum(array.nbytes for array in arrays.values()) > MOST_BYTES / 2:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
        _make_room(path.parent)
    except (OSError, InputError):
        return


def _make_room(folder: Path) -> None:
    """Remove what was not used for longest, until the rest is under `MOST_BYTES`."""
    found = []
    for path in folder.iterdir():
        # Another process may be making room at the same time.
        with contextlib.suppress(FileNotFoundError):
            if _OURS.fullmatch(path.name):
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
    kept = 0
    for _, size, path in sorted(found, reverse=True):
        kept += size
        if kept > MOST_BYTES:
            path.unlink(missing_ok=True)


def _to_arrays(built: Built) -> dict[str, np.ndarray]:
    """A structure's arrays by name."""
    arrays = {f"nodes.{k}": v for k, v in built.nodes._asdict().items()}
    arrays |= {f"links.{k}": v for k, v in built.links._asdict().items()}
    fragments, voxels = built.fragment_node, built.voxel_node
    return {**arrays, "fragment_node": fragments, "voxel_node": voxels}


def _from_arrays(array: dict[str, np.ndarray]) -> Built:
    """The structure of arrays by name."""
    return Built(
        nodes=Nodes(*(array[f"nodes.{k}"] for k in Nodes._fields)),
        links=Links(*(array[f"links.{k}"] for k in Links._fields)),
        fragment_node=array["fragment_node"],
        voxel_node=array["voxel_node"],
    )
