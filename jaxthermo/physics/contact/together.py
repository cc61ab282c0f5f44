"""Findings about two bodies, which they keep while they move together."""

from collections.abc import Callable, Hashable
from typing import TypeVar

from ...memo.found import found
from .rays import PlacedGrid


_Finding = TypeVar("_Finding")


def found_between(
    first: PlacedGrid,
    second: PlacedGrid,
    by: tuple[Hashable, ...],
    find: Callable[[], _Finding],
    search: str = "",
) -> _Finding:
    """Search about two bodies, once as long as they keep their places in one another.

    Args:
        first: a body.
        second: another one.
        by: values on which the result depends, besides the grids and the places.
        find: the search.
        search: its name for the receipt.
    """
    length = min(first.pitch, second.pitch)
    place = first.pose.relative_key(second.pose, length)
    grids = (first.grid, second.grid)
    return found(grids, by=(*by, place), find=find, search=search)
