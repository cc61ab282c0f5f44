"""Names of bodies in lines for readers, which count bodies from 0."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import wraps
from typing import ParamSpec, TypeVar

from ...errors import InputError
from ..air import bodies_around_air
from ..receipt_model import Receipt
from ..scene import Scene


# "bodies 0 and 1" after "body 0" and "bodies[0]", which a name may follow already.
_MENTIONS = (
    re.compile(r"\bbody (?P<number>\d+)\b(?! \()"),
    re.compile(r"\bbodies\[(?P<number>\d+)\](?! \()"),
    re.compile(r"\bbodies (?P<number>\d+)(?= and \d)"),
    re.compile(r"\bbodies \d+(?: \([^()]*\))? and (?P<number>\d+)\b(?! \()"),
)

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def body_label(number: int, name: str) -> str:
    """A body as lines name it: "body 3", or "body 3 (roof)" if it has a name."""
    return f"body {number} ({name})" if name else f"body {number}"


def body_labels(scene: Scene) -> list[str]:
    """All bodies of a scene as lines name them: "body 3 (roof)", "air of body 3"."""
    labels = [body_label(n, body.name) for n, body in enumerate(scene.bodies)]
    airs = {air: f"air of {labels[n]}" for air, n in bodies_around_air(scene).items()}
    return [airs.get(number, label) for number, label in enumerate(labels)]


def _with_names(line: str, names: Sequence[str]) -> str:
    """A line with the names of the bodies behind the numbers that it has of them."""

    def named(mention: re.Match[str]) -> str:
        number = int(mention["number"])
        name = names[number] if number < len(names) else ""
        return f"{mention[0]} ({name})" if name else mention[0]

    for pattern in _MENTIONS:
        line = pattern.sub(named, line)
    return line


def named_receipt(receipt: Receipt, scene: Scene) -> Receipt:
    """A receipt with the names of the bodies, in its lines too."""
    names = tuple(body.name for body in scene.bodies)
    if not any(names):
        return replace(receipt, body_names=names)

    def named(lines: Iterable[str]) -> tuple[str, ...]:
        return tuple(_with_names(line, names) for line in lines)

    return replace(
        receipt,
        body_names=names,
        left_out=tuple(
            replace(omission, what=_with_names(omission.what, names))
            for omission in receipt.left_out
        ),
        notes=named(receipt.notes),
        warnings=named(receipt.warnings),
    )


def naming_bodies(
    function: Callable[_Arguments, _Result],
) -> Callable[_Arguments, _Result]:
    """Decorator of a function of a scene, whose errors then name its bodies."""

    @wraps(function)
    def with_named_errors(*args: _Arguments.args, **kwargs: _Arguments.kwargs):
        try:
            return function(*args, **kwargs)
        except InputError as error:
            scene = args[0] if args else kwargs["scene"]
            assert isinstance(scene, Scene)
            line = _with_names(str(error), [body.name for body in scene.bodies])
            raise InputError(line) from error

    return with_named_errors
