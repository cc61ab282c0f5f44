"""Free lines of sight: those that no occluder of a scene blocks.

Each occluder is searched for by itself, so that snapshots of a motion share what did
not move in the frame of the body that looks.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float, UInt8

from ...geometry.mesh import Pose
from ...memo.found import found
from ..occluder import Occluder
from ..surface import BodySurface


Sight = UInt8[np.ndarray, "*n s"]
"""Lines of sight of each surface point, one a bit, which is 1 for a free one."""

Search = Callable[
    [Float[np.ndarray, "f 3 3"], tuple[BodySurface, ...]], Sequence[Sight]
]
"""Lines of sight from some bodies that the triangles of an occluder leave free."""

_WORLD = Pose()


def free_lines(
    bodies: Sequence[BodySurface],
    search: Search,
    by: tuple[Hashable, ...] | None,
    task: str,
    is_distant: bool,
) -> list[Sight]:
    """Lines of sight from the fragments of each body that no occluder blocks.

    One search is made for all bodies that keep their places in one another.

    Args:
        bodies: the surfaces from which they lead.
        search: finds them past one occluder.
        by: values on which its result depends, besides the surfaces; None if they are
            unknown.
        task: its name, which ends before the body.
        is_distant: True if the lines lead to infinity, whatever the body's position.
    """
    free: dict[int, Sight] = {}
    for viewers in _together(bodies):
        from_place = None if by is None else (*by, *_place_key(viewers, is_distant))
        past_each = [
            _past(occluder, viewers, search=search, by=from_place, task=task)
            for occluder in viewers[0].occluders
        ]
        for body, *sights in zip(viewers, *past_each, strict=True):
            free[body.body] = _free_of_all(tuple(sights))
    return [free[body.body] for body in bodies]


def _together(bodies: Sequence[BodySurface]) -> Iterable[tuple[BodySurface, ...]]:
    """The bodies, those together that keep their places in one another."""
    occluder_of = {
        number: occluder
        for occluder in bodies[0].occluders
        for number in occluder.bodies
    }
    groups: dict[object, list[BodySurface]] = {}
    for body in bodies:
        groups.setdefault(occluder_of.get(body.body, body), []).append(body)
    return map(tuple, groups.values())


def _place_key(viewers: tuple[BodySurface, ...], is_distant: bool) -> tuple:
    """Places of bodies in the first one, and its own, as numbers to compare."""
    first = viewers[0].pose
    length = _length_of(viewers)
    # A method of a module is a new object in each call: one for all bodies.
    key_from_first = first.relative_key
    within = tuple(key_from_first(body.pose, length) for body in viewers)
    translation, rotation = _WORLD.relative_key(first, length)
    return within, rotation, None if is_distant else translation


def _length_of(viewers: tuple[BodySurface, ...]) -> float:
    return min(body.pitch for body in viewers)


def _past(
    occluder: Occluder,
    viewers: tuple[BodySurface, ...],
    search: Search,
    by: tuple[Hashable, ...] | None,
    task: str,
) -> Sequence[Sight]:
    """Lines of sight from bodies that keep their places, past one occluder."""
    place = occluder.place_from(viewers[0].pose, _length_of(viewers))
    return found(
        (*(body.grid for body in viewers), *occluder.shapes),
        by=None if by is None else (*by, place),
        find=partial(search, occluder.triangles, viewers),
        search=tuple(f"{task} body {body.body}" for body in viewers),
    )


def _free_of_all(sights: tuple[Sight, ...]) -> Sight:
    """Lines that are free past all occluders, the same array for the same sights."""
    if len(sights) == 1:
        return sights[0]
    return found(sights, by="free lines", find=partial(_in_all, sights))


def _in_all(sights: tuple[Sight, ...]) -> Sight:
    """Lines that are free in all sights; one of these where no other has less."""
    # What followed from the lines of a body whose view a moving one does not cross
    # follows from them again.
    free = np.bitwise_and.reduce(sights)
    return next((sight for sight in sights if np.array_equal(sight, free)), free)
