"""Parts of a config that do not fit together, seen before the values are understood."""

import math
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from pydantic import ValidationError

from .model import Location, Mistake, Model
from .schema_image import ImageConfig
from .schema_time import TimeConfig


AnyModel = TypeVar("AnyModel", bound=Model)

EMISSION = ("surroundings", "radiative_exchange")
"""Kinds of which a scene has one."""


def no_such_body(data: dict[str, Any]) -> list[Mistake]:
    """Terms that name a body which is not there."""
    bodies = data.get("bodies")
    count = len(bodies) if isinstance(bodies, list) else 0
    return [
        (("terms", i, *where), f"there is no body {body}; the last one is {count - 1}")
        for i, term in enumerate(_terms(data))
        for where, body in _named_bodies(term if isinstance(term, dict) else {})
        if type(body) is int and body >= count > 0
    ]


def _named_bodies(term: dict[str, Any]) -> Iterator[tuple[Location, Any]]:
    """The numbers of bodies in a term as it is written, and where they stand."""
    for key in ("on", "within", "cylinders"):
        for part, held in _items(term.get(key)):
            if part == "body":
                yield (key, part), held
            elif isinstance(held, dict):
                yield (key, part, "body"), held.get("body")
    for i, body in _items(term.get("bodies")):
        yield ("bodies", i), body


def _items(value: Any) -> Iterable[tuple[str | int, Any]]:
    if isinstance(value, dict):
        return value.items()
    return enumerate(value) if isinstance(value, list) else ()


def twice_emitted(data: dict[str, Any]) -> list[Mistake]:
    """Terms that would count the emission again."""
    kinds = [t.get("kind") if isinstance(t, dict) else None for t in _terms(data)]
    found = [i for i, kind in enumerate(kinds) if kind in EMISSION]
    return [
        (
            ("terms", i),
            f"{kinds[i]} would count the emission twice, after {kinds[found[0]]} in "
            f"terms.{found[0]}: give one of them",
        )
        for i in found[1:]
    ]


def _terms(data: dict[str, Any]) -> list[Any]:
    terms = data.get("terms")
    return terms if isinstance(terms, list) else []


def not_saved(data: dict[str, Any]) -> list[Mistake]:
    """Frames of times that are not kept."""
    time = _if_valid(TimeConfig, data.get("time"))
    image = data.get("image")
    frames = image.get("frames") if isinstance(image, dict) else None
    image = _if_valid(ImageConfig, {"frames": frames})
    if time is None or image is None:
        return []
    return [
        (("image", "frames", i), f"{frame:g} s is not a saved time")
        for i, frame in enumerate(image.frames or ())
        if not any(math.isclose(frame, t, rel_tol=1e-9) for t in time.save_times)
    ]


def _if_valid(kind: type[AnyModel], data: Any) -> AnyModel | None:
    try:
        return kind.model_validate(data)
    except ValidationError:
        return None
