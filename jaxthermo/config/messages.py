"""Messages about mistakes in a config: what is wrong, where, and what to write."""

import difflib
import reprlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from ..alike_lines import grouped_lines


# Type of an error whose message is already one of this package.
MISTAKE = "mistake"

_EXPECTED = {
    "bool_type": "true or false",
    "string_type": "a word or a text",
    "tuple_type": "a list",
    "dict_type": "names with values, as in `{name: ..}`",
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
# A value may be a whole list of numbers, and a message is one line.
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_SHORT.maxlevel = 3


def quoted(value: Any) -> str:
    """The value as the user wrote it, on one line, shortened where it is long."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    return _SHORT.repr(value)


def close_match(word: object, choices: Iterable[str]) -> str:
    """An ending "; did you mean 'x'?" or, without a match, the choices."""
    names = list(choices)
    matches = difflib.get_close_matches(str(word), names, n=1)
    if matches:
        return f"; did you mean '{matches[0]}'?"
    return f"; choose from {', '.join(names)}" if names else ""


def explain(error: Mapping[str, Any]) -> str:
    """One line for one entry of `ValidationError.errors()`."""
    error_type = error["type"]
    value = error.get("input")
    context = error.get("ctx") or {}
    if error_type == "missing":
        return "missing, and it has no default"
    if error_type in _EXPECTED:
        return f"expected {_EXPECTED[error_type]}, got {quoted(value)}"
    if error_type in _LIMITS:
        words, limit = _LIMITS[error_type]
        return f"must be {words} {context[limit]:g}, got {quoted(value)}"
    if error_type == "literal_error":
        choices = context["expected"].replace(" or ", ", ").replace("'", "")
        return f"{quoted(value)} is not known{close_match(value, choices.split(', '))}"
    if error_type == "union_tag_not_found":
        return f"expected a mapping with a `kind`, got {quoted(value)}"
    if error_type == "union_tag_invalid":
        choices = context["expected_tags"].translate(str.maketrans("", "", "<>'"))
        tag = context["tag"].strip("<>")
        return f"unknown kind '{tag[:60]}'{close_match(tag, choices.split(', '))}"
    if error_type == "string_too_short":
        return "must not be empty"
    return error["msg"]


def _untagged(location: Iterable[str | int]) -> tuple[str | int, ...]:
    # Tags in brackets mark the member of a union; no config has a key like them.
    return tuple(key for key in location if not str(key).startswith("<"))


def described(
    error: ValidationError, source: Callable[[tuple[str | int, ...]], str]
) -> str:
    """A line for each mistake of a config, and one for many that are alike.

    Args:
        error: raised by a config model.
        source: start of the line of a mistake at a location.
    """
    return "\n".join(
        grouped_lines(
            f"{source(_untagged(mistake['loc']))}: {mistake['msg']}"
            for mistake in error.errors(include_url=False)
        )
    )


def in_file(source: object, location: tuple[str | int, ...]) -> str:
    """A file and a location in it: "scene.yaml: bodies.0.pitch"."""
    return ": ".join(filter(None, (str(source), dotted(location))))


def dotted(location: Iterable[str | int]) -> str:
    """The location as it is typed after --set."""
    return ".".join(map(str, location))
