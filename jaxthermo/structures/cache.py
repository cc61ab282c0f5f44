"""Arrays of structures, which are built once for equal voxels and options."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..memo.found import digest, found
from ..memo.stored import stored
from ..voxels.grid import VoxelGrid
from .structure import Built, Links, Nodes, check_grid


_MIN_VOXELS = 20_000
"""Number of voxels below which building is as fast as reading."""


def built_once(
    name: str, grid: VoxelGrid, options: dict[str, Any], build: Callable[..., Built]
) -> Built:
    """Build the arrays of a structure, or return those that were built or stored.

    Structures of one grid that differ only in their weights share the arrays and
    whatever has been derived from them.

    Args:
        name: name of the kind of structure, in lower case.
        grid: the voxels.
        options: all other inputs: numbers, texts, arrays, or tuples and dicts of these.
        build: takes the grid, and the options by name.
    """
    check_grid(grid, name)
    option_values = tuple(
        (option, digest(value) if isinstance(value, np.ndarray) else value)
        for option, value in sorted(options.items())
    )

    def build_or_read() -> Built:
        if grid.solid_count < _MIN_VOXELS:
            return build(grid, **options)
        return stored(
            "structure",
            inputs=(name, grid, options),
            compute=lambda: build(grid, **options),
            types=(Built, Nodes, Links),
        )

    by = ("structure", name, option_values)
    return found((grid,), by=by, find=build_or_read)
