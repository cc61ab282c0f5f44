"""Names of the fitted numbers of frames, which no scene has.

| path | meaning |
|---|---|
| `cameras.0.rotation` | rotation vector of a camera, right, down, forward [rad] |
| `cameras.0.translation` | its translation along the same axes [m] |
| `cameras.0.rotation.2` | one of the three numbers |
| `reflected_temperature` | of a black body all around, in what surfaces reflect [K] |

Poses of a camera are relative to the given one, in its axes, see
`jaxthermo.image.pose.pose`.
"""

from collections.abc import Iterable

from jaxthermo.errors import InputError


REFLECTED = "reflected_temperature"
_CAMERAS = "cameras"
_FIRST_NUMBER = {"rotation": 0, "translation": 3}
"""Index of the first number of each part of a pose."""


def is_of_frames(name: str) -> bool:
    """True for the path of a number of frames, not of a scene."""
    return name.split(".")[0] in (_CAMERAS, REFLECTED)


def is_of_camera(name: str) -> bool:
    """True for the path of numbers of a camera's pose."""
    return name.split(".")[0] == _CAMERAS


def pose_numbers(name: str, cameras: int | None = None) -> tuple[int, tuple[int, ...]]:
    """Camera of a path, and which of the six numbers of its pose the path names.

    Raises:
        InputError: if there is no such number of that many cameras.
    """
    _, *words = name.split(".")
    examples = f"{_CAMERAS}.0.rotation, .translation, or one number, as .rotation.2"
    if not (
        len(words) in (2, 3)
        and words[0].isdecimal()
        and words[1] in _FIRST_NUMBER
        and (len(words) == 2 or words[2] in ("0", "1", "2"))
    ):
        raise InputError(f"parameter {name}: name the pose of a camera: {examples}")
    camera = int(words[0])
    if cameras is not None and camera >= cameras:
        counted = f"{cameras} views" if cameras > 1 else "one view"
        raise InputError(f"parameter {name}: there is {counted}, counted from 0")
    first = _FIRST_NUMBER[words[1]]
    if len(words) == 3:
        return camera, (first + int(words[2]),)
    return camera, (first, first + 1, first + 2)


def check_frame_names(names: Iterable[str], cameras: int) -> None:
    """Refuse numbers that frames do not have, or that are there twice.

    `cameras` is 0 where no frames are compared.
    """
    seen: dict[tuple[int, int], str] = {}
    for name in filter(is_of_frames, names):
        if not cameras:
            raise InputError(
                f"parameter {name}: there are no frames: give a `reference` of frames"
            )
        if not is_of_camera(name):
            continue
        camera, numbers = pose_numbers(name, cameras)
        for number in numbers:
            first_name = seen.setdefault((camera, number), name)
            if first_name != name:
                raise InputError(f"parameter {name}: it is part of {first_name} too")
