"""Bodies in the terms of a scene, before it is validated: numbers in place of names.

A side without a body is that of every body.
"""

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError

from ...geometry.part_names import matching_parts, unmatched_name
from ..types.model import Data, Location, Mistake, MistakesError
from .selection import SideConfig


_ByNames = Callable[[Data, Mapping[str, int]], Data]
_COMBINED = ("all", "any")
_ON_BODIES = ("side", "face", "region", "fragments")


def with_numbers(data: Data) -> Data:
    """The data with numbers of bodies where its terms have names of them.

    Raises:
        MistakesError: for names or patterns that no body has.
    """
    bodies = data.get("bodies")
    names = {name: number for number, name in _names(bodies)}
    count = len(bodies) if isinstance(bodies, list) else 0
    mistakes: list[Mistake] = []

    def numbered(item: Any, where: Location, by_names: _ByNames) -> Any:
        try:
            return by_names(item, names) if isinstance(item, dict) else item
        except MistakesError as error:
            mistakes.extend(((*where, *inner), line) for inner, line in error.mistakes)
            return item

    result = dict(data)
    if isinstance(data.get("terms"), list):
        result["terms"] = [
            numbered(_on_all_bodies(term, count), ("terms", number), _numbered_term)
            for number, term in enumerate(data["terms"])
        ]
    outdoors = data.get("outdoors")
    if isinstance(outdoors, dict) and isinstance(outdoors.get("longwave"), dict):
        planes = {
            plane: numbered(surface, ("outdoors", "longwave", plane), _numbered_plane)
            for plane, surface in outdoors["longwave"].items()
        }
        result["outdoors"] = {**outdoors, "longwave": planes}
    if mistakes:
        raise MistakesError(mistakes)
    return result


def equal_names(data: Mapping[str, object]) -> list[Mistake]:
    """Bodies that are missing, or have the name of an earlier one."""
    if "bodies" not in data:
        return [(("bodies",), "missing: give them, or an `assembly`")]
    first: dict[str, int] = {}
    mistakes: list[Mistake] = []
    for number, name in _names(data["bodies"]):
        if first.setdefault(name, number) != number:
            message = f"{name!r} is the name of body {first[name]} too: change one"
            mistakes.append((("bodies", number, "name"), message))
    return mistakes


def _names(bodies: object) -> list[tuple[int, str]]:
    """Number and name of each body that has a name."""
    listed = enumerate(bodies if isinstance(bodies, list) else ())
    named = [(number, body) for number, body in listed if isinstance(body, dict)]
    named = [(number, body.get("name")) for number, body in named]
    return [(number, name) for number, name in named if isinstance(name, str)]


def _on_all_bodies(term: Any, count: int) -> Any:
    """A term whose sides without a body are those of all bodies."""
    if not isinstance(term, dict) or "on" not in term or count < 2:
        return term
    return {**term, "on": _sides_of_all(term["on"], count)}


def _sides_of_all(selection: Any, count: int) -> Any:
    if isinstance(selection, list):
        return [_sides_of_all(inner, count) for inner in selection]
    if not isinstance(selection, dict):
        return selection
    side = selection.get("side")
    if len(selection) == 1 and isinstance(side, dict) and _is_of_all(side):
        return {"any": [{"side": {**side, "body": body}} for body in range(count)]}
    return {key: _sides_of_all(value, count) for key, value in selection.items()}


def _is_of_all(side: Data) -> bool:
    if {"body", "part"} & side.keys():
        return False
    try:
        SideConfig.model_validate(side)
    except ValidationError:
        # Its mistakes are told once, where they are.
        return False
    return True


def _numbered_term(term: Data, names: Mapping[str, int]) -> Data:
    """A term whose selections and bodies are numbers.

    Raises:
        MistakesError: for a name or pattern that no body has.
    """
    numbered = dict(term)
    for key in ("on", "within"):
        if key in term:
            numbered[key] = _numbered(term[key], (key,), names)
    if isinstance(term.get("cylinders"), list):
        numbered["cylinders"] = [
            _numbered_cylinder(cylinder, ("cylinders", i), names)
            for i, cylinder in enumerate(term["cylinders"])
        ]
    if isinstance(term.get("bodies"), list):
        numbered["bodies"] = [
            _single(body, ("bodies", i), names) if isinstance(body, str) else body
            for i, body in enumerate(term["bodies"])
        ]
    return numbered


def _numbered_cylinder(cylinder: Any, where: Location, names: Mapping[str, int]) -> Any:
    if not isinstance(cylinder, dict) or cylinder.get("part") is None:
        return cylinder
    number = _single(cylinder["part"], (*where, "part"), names)
    without_part = {key: value for key, value in cylinder.items() if key != "part"}
    return {**without_part, "body": number}


def _numbered_plane(surface: Data, names: Mapping[str, int]) -> Data:
    return _numbered(surface, (), names)


def _numbered(selection: Any, where: Location, names: Mapping[str, int]) -> Any:
    """A selection with numbers of bodies for patterns of their names."""
    if not isinstance(selection, dict):
        return selection
    result = {}
    for key, value in selection.items():
        if key == "body" and isinstance(value, str) and value in names:
            line = f"expected a number; give a name by `part: {value}`"
            raise MistakesError([((*where, key), line)])
        if key == "part":
            chosen = [{"body": n} for n in _matching(value, (*where, key), names)]
        elif key in _ON_BODIES and isinstance(value, dict) and "part" in value:
            of_body = {k: v for k, v in value.items() if k != "part"}
            numbers = _matching(value["part"], (*where, key, "part"), names)
            chosen = [{key: {**of_body, "body": n}} for n in numbers]
        elif key in _COMBINED and isinstance(value, list):
            result[key] = [
                _numbered(inner, (*where, key, i), names)
                for i, inner in enumerate(value)
            ]
            continue
        else:
            result[key] = _numbered(value, (*where, key), names)
            continue
        result |= chosen[0] if len(chosen) == 1 else {"any": chosen}
    return result


def _matching(patterns: Any, where: Location, names: Mapping[str, int]) -> list[int]:
    """Numbers of the bodies that a pattern, or a list of them, stands for."""
    numbers = set()
    for pattern in patterns if isinstance(patterns, list) else [patterns]:
        matching = matching_parts(str(pattern), names)
        if not matching:
            line = unmatched_name(str(pattern), list(names))
            raise MistakesError([(where, line)])
        numbers |= {names[name] for name in matching}
    return sorted(numbers)


def _single(name: Any, where: Location, names: Mapping[str, int]) -> int:
    numbers = _matching(name, where, names)
    if len(numbers) > 1:
        line = f"{name!r} is the name of {len(numbers)} bodies: name one"
        raise MistakesError([(where, line)])
    return numbers[0]
