"""Checks of what a structure is asked for."""

import operator
from typing import Any

from ..errors import InputError


def whole_number(value: Any, option: str, least: int = 1) -> int:
    """The value as an int.

    Args:
        value: given by the user.
        option: such as "Octree(levels=)".
        least: smallest that is allowed.

    Raises:
        InputError: unless the value is an integer of at least `least`.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least or isinstance(value, bool):
        raise InputError(
            f"{option[:-1]}{value!r}): give a whole number of at least {least}"
        )
    return number
