"""Findings about two bodies, which they keep while they move together."""

from collections.abc import Callable, Hashable
from typing import TypeVar

from ..geometry.mesh import Pose
from ..memo.found import found
from ..voxels.abstract_grid import AbstractGrid


_Finding = TypeVar("_Finding")


def found_between(
    grids: tuple[AbstractGrid, AbstractGrid],
    poses: tuple[Pose, Pose],
    by: tuple[Hashable, ...],
    find: Callable[[], _Finding],
    search: str = "",
) -> _Finding:
    """Search about two bodies, once as long as they keep their places in one another.

    Args:
        grids: of both bodies.
        poses: of both bodies.
        by: values on which the result depends, besides the grids and the places.
        find: the search.
        search: its name for the receipt.
    """
    first, second = poses
    place = first.relative_key(second, min(grid.pitch for grid in grids))
    return found(grids, by=(*by, place), find=find, search=search)
