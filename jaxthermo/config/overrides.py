"""`--set bodies.0.pitch=3mm`: a value of the config, replaced from the command line."""

from collections.abc import Sequence
from typing import Any, TypeAlias

from ..errors import InputError
from .messages import close_match, dotted, quoted
from .strict_yaml import parse_yaml
from .types.model import Location


ALTERNATIVES = (
    ("mesh", "shape"),
    ("pitch", "voxels_high"),
    ("unit", "height"),
    ("save_at", "save_every"),
    ("side", "region", "fragments", "body"),
    ("radiance", "temperature"),
)
"""Keys of which a mapping holds one: setting it takes the place of the other."""

SHORT = {
    "structure": "kind",
    "surface_map": "kind",
    "wake": "kind",
    "material": "name",
    "weights": "card",
}
"""Keys that may hold a word alone, and what the word is a value of."""


PATHS = ("set",)
"""Keys whose mapping has paths as keys: the rest of a location is one of them."""


Change: TypeAlias = tuple[Location, str]
"""Location of a value that an override set, and the text of the override."""


def with_overrides(data: Any, texts: Sequence[str]) -> tuple[Any, list[Change]]:
    """A copy of the data with "a.b=c" each, in order; c is YAML.

    Raises:
        InputError: for one that is none, or has no place in the data.
    """
    changed: list[Change] = []
    for text in texts:
        location, value = parse_override(text)
        try:
            data = with_override(data, location, value)
        except InputError as error:
            raise InputError(f"--set {error}") from error
        changed.append((location, text))
    return data, changed


def parse_override(text: str) -> tuple[Location, Any]:
    """The path and the value of "a.0.b=value"; the value is YAML."""
    path, equals, value = text.partition("=")
    parts = [part.strip() for part in path.split(".")]
    if not equals or not all(parts):
        raise InputError(f"--set {text}: expected a path and a value, such as a.b=3")
    location = tuple(int(part) if part.isdigit() else part for part in parts)
    return location, parse_yaml(value, f"--set {text}")


def with_override(data: Any, location: Location, value: Any) -> Any:
    """A copy of the data in which the value stands at the location."""
    return _replaced(data, location, value, ())


def _replaced(data: Any, rest: Location, value: Any, before: Location) -> Any:
    if not rest:
        return value
    key, here = rest[0], (*before, rest[0])
    if isinstance(data, list):
        index = _index(data, key, before)
        item = _replaced(data[index], rest[1:], value, here)
        return [*data[:index], item, *data[index + 1 :]]
    if before and before[-1] in PATHS:
        rest = (dotted(rest),)
        key = rest[0]
    if data is None or data == "auto":
        data = {}
    elif isinstance(data, str) and before and before[-1] in SHORT:
        data = {SHORT[str(before[-1])]: data}
    if not isinstance(data, dict):
        raise InputError(
            f"{dotted(here)}: `{dotted(before)}` is {quoted(data)} in the config, "
            f"which has no parts; set `{dotted(before)}` as a whole"
        )
    if isinstance(key, int):
        hint = close_match(key, data)
        raise InputError(f"{dotted(here)}: `{dotted(before)}` is not a list{hint}")
    if len(rest) > 1 and key not in data and isinstance(rest[1], int):
        raise InputError(f"{dotted(here)}: no such list{close_match(key, data)}")
    item = _replaced(data.get(key), rest[1:], value, here)
    others = {o for group in ALTERNATIVES if key in group for o in group} - {key}
    return {**{k: v for k, v in data.items() if k not in others}, key: item}


def _index(data: list, key: str | int, before: Location) -> int:
    if not isinstance(key, int):
        entries = f"`{dotted(before)}` is a list: give an index, such as 0"
        raise InputError(f"{dotted((*before, key))}: {entries}")
    if key >= len(data):
        entries = f"`{dotted(before)}` has {len(data)} entries, counted from 0"
        raise InputError(f"{dotted((*before, key))}: {entries}")
    return key
