"""Cache of structures on disk.

The file's name is a hash of all inputs: mesh, voxels, fragments, options and source
code.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .. import user_cache
from ..findings import digest, found
from ..stored_findings import code_hash, content_hash
from ..voxels.grid import VoxelGrid
from .structure import Built, Links, Nodes, check_grid


# Incremented when the meaning of the arrays in a file changes.
_FORMAT = 4

_MIN_VOXELS = 20_000
"""Number of voxels below which building is as fast as reading."""

_MAX_BYTES = 2 * 1024**3
"""Size of all files together; the least recently used are removed first."""

# Files of this cache, complete or left behind by a killed process.
_OWN_FILES = re.compile(r"\.?[a-z_]+-[0-9a-f]{40}(\.(\d+-)?[0-9a-f]{8})?\.npz")


def built_once(
    name: str, grid: VoxelGrid, options: dict[str, Any], build: Callable[..., Built]
) -> Built:
    """Arrays from `cached`, kept in this process as long as the grid exists.

    Structures that differ only in their weights share the arrays and whatever has been
    derived from them.
    """
    check_grid(grid, name)
    option_values = tuple(
        (option, digest(value) if isinstance(value, np.ndarray) else value)
        for option, value in sorted(options.items())
    )
    return found(
        (grid,),
        by=("structure", name, option_values),
        find=lambda: cached(name, grid=grid, options=options, build=build),
    )


def cached(
    name: str, grid: VoxelGrid, options: dict[str, Any], build: Callable[..., Built]
) -> Built:
    """Read a structure of a kind (lower case) from the cache, or build and store it.

    Options are all other inputs: numbers, texts, arrays, or tuples and dicts of these;
    `build` takes the grid, and the options by name.
    """
    check_grid(grid, name)
    folder = cache_folder()
    if folder is None or grid.solid_count < _MIN_VOXELS:
        return build(grid, **options)
    path = folder / f"{name}-{_key(name, grid, options)}.npz"
    built = _read(path)
    if built is None:
        built = build(grid, **options)
        _write(path, built)
    return built


def cache_folder() -> Path | None:
    """Folder of the structures; None if the cache is off."""
    return user_cache.cache_folder("structures")


def _key(name: str, grid: VoxelGrid, options: dict[str, Any]) -> str:
    lattice = grid.lattice
    cut = grid.cut
    inputs: list[Any] = [_FORMAT, code_hash("structures", "voxels"), name, options]
    inputs += [grid.mesh.vertices, grid.mesh.faces]
    inputs += [lattice.shape, lattice.origin, lattice.pitch]
    inputs += [np.packbits(grid.solid), grid.volume_ratio]
    inputs += [grid.fragment_voxel, grid.fragment_position]
    inputs += [grid.fragment_normal, grid.fragment_area]
    inputs += [] if cut is None else [cut.voxel, cut.volume, *cut.links]
    return content_hash(inputs)


def _read(path: Path) -> Built | None:
    try:
        with path.open("rb") as stream, np.load(stream) as file:
            # np.load does not read arrays to the end, where check sums are compared.
            if file.zip.testzip() is not None:
                return None
            built = Built(
                nodes=Nodes(*(file[f"nodes.{k}"] for k in Nodes._fields)),
                links=Links(*(file[f"links.{k}"] for k in Links._fields)),
                fragment_node=file["fragment_node"],
                voxel_node=file["voxel_node"],
            )
    except Exception:  # readers of damaged zip and npy files raise any exception
        return None
    user_cache.mark_used(path)
    return built


def _write(path: Path, built: Built) -> None:
    """Write the arrays, unless they would take over half of the cache."""
    arrays = {f"nodes.{k}": v for k, v in built.nodes._asdict().items()}
    arrays |= {f"links.{k}": v for k, v in built.links._asdict().items()}
    arrays |= {"fragment_node": built.fragment_node, "voxel_node": built.voxel_node}
    if sum(array.nbytes for array in arrays.values()) > _MAX_BYTES / 2:
        return

    def write(file):
        np.savez(file, allow_pickle=False, **arrays)

    user_cache.keep(path, write, _OWN_FILES, _MAX_BYTES)
