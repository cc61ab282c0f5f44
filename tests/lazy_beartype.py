"""Types checked by beartype from a function's first call on.

Most of what a test process imports it never calls: to write the checks of all functions
on import takes longer than all other imports together.
"""

from collections.abc import Callable

from beartype import beartype


def checked_when_called(function: Callable) -> Callable:
    """The function with its arguments and value checked, as beartype does."""
    checked = None

    def check(*arguments, **named):
        nonlocal checked
        if checked is None:
            checked = beartype(function)
        return checked(*arguments, **named)

    return check
