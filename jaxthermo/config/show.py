"""How a message quotes what the user wrote, and what they may have meant."""

import difflib
import reprlib
from collections.abc import Iterable
from typing import Any


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_SHORT.maxlevel = 3


def show(value: Any) -> str:
    """The value on one line, shortened where it is long."""
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
