"""Free lines of sight: those that no occluder of a scene blocks.

Each occluder is searched for by itself, so that snapshots of a motion share what did
not move in the frame of the body that looks.
"""

from collections.abc import Callable, Hashable
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import UInt8

from ...memo.found import found
from ..surface import BodySurface


Sight = UInt8[np.ndarray, "*n s"]
"""Lines of sight of each surface point, one a bit, which is 1 for a free one."""


def free_lines(
    body: BodySurface,
    search: Callable[..., Sight],
    by: tuple[Hashable, ...] | None,
    task: str,
    is_distant: bool,
    **options: Any,
) -> Sight:
    """Lines of sight from the fragments of a body that no occluder blocks.

    Args:
        body: the surface from which they lead.
        search: takes the triangles of an occluder, positions, normals, the edges of
            fragments as the pitch, and the options.
        by: values on which its result depends, besides the surfaces and the pitch;
            None if they are unknown.
        task: its name, which ends before the body.
        is_distant: True if the lines lead to infinity, whatever the body's position.
        options: further arguments of the search.
    """
    key = None
    if by is not None:
        _, rotation = body.place_key
        key = (*by, body.pitch, rotation if is_distant else body.place_key)
    sights = tuple(
        found(
            (body.grid, *occluder.shapes),
            by=None if key is None else (*key, occluder_place),
            find=partial(
                search,
                occluder.triangles,
                position=body.position,
                normal=body.normal,
                pitch=body.grid.fragment_edge,
                **options,
            ),
            search=f"{task} body {body.body}",
        )
        for occluder, occluder_place in zip(
            body.occluders, body.occluder_places, strict=True
        )
    )
    if len(sights) == 1:
        return sights[0]
    return found(sights, by="free lines", find=lambda: _free_of_all(sights))


def _free_of_all(sights: tuple[Sight, ...]) -> Sight:
    """Lines that are free in all sights; one of these where no other has less."""
    # What followed from the lines of a body whose view a moving one does not cross
    # follows from them again.
    free = np.bitwise_and.reduce(sights)
    return next((sight for sight in sights if np.array_equal(sight, free)), free)
