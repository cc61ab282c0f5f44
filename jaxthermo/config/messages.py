"""What pydantic found, in words for the person who wrote the config."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from .show import close_match, show


MISTAKE = "mistake"
"""The type of an error whose message is ours already."""

_EXPECTED = {
    "bool_type": "true or false",
    "string_type": "a word or a text",
    "tuple_type": "a list",
    "int_type": "a whole number",
    "float_type": "a number",
    "path_type": "a file name",
}
_LIMITS = {
    "greater_than": ("more than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}


def explain(error: Mapping[str, Any]) -> str:
    """One line for one entry of `ValidationError.errors()`."""
    kind, value = error["type"], error.get("input")
    context = error.get("ctx") or {}
    if kind == "missing":
        return "missing, and it has no default"
    if kind in _EXPECTED:
        return f"expected {_EXPECTED[kind]}, got {show(value)}"
    if kind in _LIMITS:
        words, limit = _LIMITS[kind]
        return f"must be {words} {context[limit]:g}, got {show(value)}"
    if kind == "literal_error":
        choices = context["expected"].replace(" or ", ", ").replace("'", "")
        return f"{show(value)} is not known{close_match(value, choices.split(', '))}"
    if kind == "union_tag_not_found":
        return f"expected a mapping with a `kind`, got {show(value)}"
    if kind == "union_tag_invalid":
        choices = context["expected_tags"].translate(str.maketrans("", "", "<>'"))
        given = context["tag"].strip("<>")
        return f"unknown kind '{given[:60]}'{close_match(given, choices.split(', '))}"
    return error["msg"]


def place(error: Mapping[str, Any]) -> tuple[str | int, ...]:
    """Where the mistake stands: of a union without such a member, at its `kind`."""
    beyond = ("kind",) if error["type"] == "union_tag_invalid" else ()
    return (*error["loc"], *beyond)


def untagged(location: Iterable[str | int]) -> tuple[str | int, ...]:
    """The location without the <tags> that mark the member of a union."""
    return tuple(part for part in location if not str(part).startswith("<"))


def described(
    error: ValidationError, source: Callable[[tuple[str | int, ...]], str]
) -> str:
    """A line for each mistake: where it is, and what is wrong.

    Args:
        error: of a config.
        source: where a mistake is, such as file and place; of its place.
    """
    entries = error.errors(include_url=False)
    return "\n".join(f"{source(untagged(e['loc']))}: {e['msg']}" for e in entries)


def in_file(source: object, place: tuple[str | int, ...]) -> str:
    """A place with where it was written: "scene.yaml: bodies.0.pitch"."""
    return ": ".join(filter(None, (str(source), dotted(place))))


def dotted(location: Iterable[str | int]) -> str:
    """The location as it is typed after --set."""
    return ".".join(map(str, location))
