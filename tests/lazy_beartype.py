"""Types checked by beartype from a function's first call on.

Most of what a test process imports it never calls: to write the checks of all functions
on import takes longer than all other imports together.
"""

from collections.abc import Callable
from typing import Any

from beartype import beartype


def checked_when_called(function: Callable) -> Callable:
    """The function with its arguments and value checked, as beartype does."""
    checked = None

    def check(*arguments, **named):
        nonlocal checked
        if checked is None:
            checked = beartype(_value_alone(function))
        return checked(*arguments, **named)

    return check


def _value_alone(function: Callable) -> Callable:
    # Jaxtyping has arguments checked before a call, by a function that returns Any, and
    # again with the value: by then the sizes that they have in common are known.
    value = function.__annotations__.get("return", Any)
    if value is not Any:
        function.__annotations__ = {"return": value}
    return function
