"""`--set bodies.0.pitch=3mm`: a value of the config, replaced from the command line."""

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

from ..errors import InputError
from .messages import close_match, dotted, quoted
from .strict_yaml import parse_yaml
from .types.model import Location, Model, Short, field_parts


_PATH_KEYS = ("set",)
"""Keys whose mapping has paths as keys: the rest of a location is one of them."""

Change: TypeAlias = tuple[Location, str]
"""Location of a value that an override set, and the text of the override."""


def with_overrides(data: Any, texts: Sequence[str]) -> tuple[Any, list[Change]]:
    """A copy of the data with texts "a.b=c" applied in order; c is YAML.

    Raises:
        InputError: for a text of another form, or a path that the data cannot have.
    """
    changed: list[Change] = []
    for text in texts:
        location, value = _parse_override(text)
        try:
            data = _with_override(data, location, value)
        except InputError as error:
            raise InputError(f"--set {error}") from error
        changed.append((location, text))
    return data, changed


def _parse_override(text: str) -> tuple[Location, Any]:
    """The path and the value of "a.0.b=value"; the value is YAML."""
    path, equals, value = text.partition("=")
    parts = [part.strip() for part in path.split(".")]
    if not equals or not all(parts):
        raise InputError(f"--set {text}: expected a path and a value, such as a.b=3")
    location = tuple(int(part) if part.isdigit() else part for part in parts)
    return location, parse_yaml(value, f"--set {text}")


def _with_override(data: Any, location: Location, value: Any) -> Any:
    """A copy of the data with the value at the location."""
    return _replaced(data, location, value, ())


def _replaced(data: Any, rest: Location, value: Any, before: Location) -> Any:
    if not rest:
        return value
    key, here = rest[0], (*before, rest[0])
    if isinstance(data, list):
        index = _index(data, key, before)
        item = _replaced(data[index], rest[1:], value, here)
        return [*data[:index], item, *data[index + 1 :]]
    if before and before[-1] in _PATH_KEYS:
        rest = (dotted(rest),)
        key = rest[0]
    if data is None or data == "auto":
        data = {}
    elif isinstance(data, str) and (word_key := _word_key(before)) is not None:
        data = {word_key: data}
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
    others = _alternatives(key)
    return {**{k: v for k, v in data.items() if k not in others}, key: item}


def _models(base: type[Model] = Model) -> Iterator[type[Model]]:
    for model in base.__subclasses__():
        yield model
        yield from _models(model)


def _alternatives(key: str) -> set[str]:
    """Keys of which a mapping has one, without this: setting it replaces the others."""
    groups = (group for model in _models() for group in model.exactly_one)
    return {other for group in groups if key in group for other in group} - {key}


def _word_key(location: Location) -> str | None:
    """The key that a word alone stands for, as `kind` for "octree" in `structure`."""
    if not location:
        return None
    for model in _models():
        if location[-1] in model.model_fields:
            for part in field_parts(model, str(location[-1])):
                if isinstance(part, Short):
                    return part.key
    return None


def _index(data: list, key: str | int, before: Location) -> int:
    if not isinstance(key, int):
        entries = f"`{dotted(before)}` is a list: give an index, such as 0"
        raise InputError(f"{dotted((*before, key))}: {entries}")
    if key >= len(data):
        entries = f"`{dotted(before)}` has {len(data)} entries, counted from 0"
        raise InputError(f"{dotted((*before, key))}: {entries}")
    return key
