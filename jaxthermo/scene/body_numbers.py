"""Bodies in the terms of a scene: numbers in place of patterns of their names."""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import reduce
from operator import is_, or_
from typing import Any

import numpy as np

from ..errors import InputError, located
from ..geometry.part_names import matching_parts, unmatched_name
from ..physics.term import AbstractTerm
from ..voxels.cylinders import Cylinder
from ..voxels.selection import (
    AbstractCombination,
    AbstractOnOneBody,
    AbstractSelection,
    combined,
)


# Fields of terms, and of what they hold, for one body each.
_OF_ONE_BODY = ("body", "air")


def body_numbers(pattern: str, names: Sequence[str]) -> tuple[int, ...]:
    """Numbers of the bodies whose names a pattern matches.

    Raises:
        InputError: if there are none.
    """
    named = {name: number for number, name in enumerate(names) if name}
    matching = matching_parts(pattern, named)
    if not matching:
        raise InputError(unmatched_name(pattern, list(named)))
    return tuple(named[name] for name in matching)


def with_numbers(terms: Any, bodies: Any) -> Any:
    """The terms of a scene with numbers of its bodies where they have names of them.

    Raises:
        InputError: for a pattern that no name matches, or of several bodies where one
            is required.
    """
    if not isinstance(terms, tuple | list) or not isinstance(bodies, tuple | list):
        # The scene refuses them.
        return terms
    names = [getattr(body, "name", "") for body in bodies]
    numbered = []
    for number, term in enumerate(terms):
        with located(f"terms[{number}]"):
            numbered.append(_numbered(term, names))
    return tuple(numbered)


def check_numbers(terms: Sequence[AbstractTerm], count: int) -> None:
    """Raise for a term on a body that is none of a number of them."""
    for number, term in enumerate(terms):
        for body in term.named_bodies:
            if not isinstance(body, int | np.integer):
                raise InputError(
                    f"terms[{number}] is on body {body!r}: give a number or a name"
                )
            if not 0 <= body < count:
                raise InputError(
                    f"terms[{number}] is on body {body}, and there are {count}: count "
                    "from 0"
                )


def _numbered(value: Any, names: Sequence[str]) -> Any:
    """A term, or what it holds, with numbers of bodies; itself if it has no names."""
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        items = tuple(_numbered(item, names) for item in value)
        return value if all(map(is_, items, value)) else items
    if isinstance(value, AbstractOnOneBody):
        if not isinstance(value.body, str):
            return value
        numbers = body_numbers(value.body, names)
        return reduce(or_, [value.numbered(body) for body in numbers])
    if isinstance(value, AbstractCombination):
        if not value.has_names:
            return value
        return combined(value.rule, tuple(_numbered(o, names) for o in value.operands))
    if isinstance(value, AbstractTerm | AbstractSelection | Cylinder):
        return _with_fields(value, names)
    return value


def _with_fields(holder: Any, names: Sequence[str]) -> Any:
    """A term, selection or cylinder with fields in which names are numbers."""
    changes = {}
    for field in fields(holder):
        current = getattr(holder, field.name)
        if field.name in _OF_ONE_BODY:
            new = _single_number(current, names)
        elif field.name == "bodies" and current is not None:
            sides = tuple(_numbers_of_side(side, names) for side in current)
            new = current if sides == current else sides
        else:
            new = _numbered(current, names)
        if new is not current:
            changes[field.name] = new
    return replace(holder, **changes) if changes else holder


def _single_number(body: Any, names: Sequence[str]) -> Any:
    """Number of the body that a name stands for; what is no name does not change."""
    if not isinstance(body, str):
        return body
    number, *others = body_numbers(body, names)
    if others:
        count = 1 + len(others)
        raise InputError(f"{body!r} is the name of {count} bodies: name one")
    return number


def _numbers_of_side(side: Any, names: Sequence[str]) -> Any:
    """The body on a side of a joint, or the bodies of a group."""
    members = side if isinstance(side, tuple) else (side,)
    if not any(isinstance(member, str) for member in members):
        return side
    numbers: set[int] = set()
    for member in members:
        is_name = isinstance(member, str)
        numbers.update(body_numbers(member, names) if is_name else (member,))
    return min(numbers) if len(numbers) == 1 else tuple(sorted(numbers))
