"""The exception for a mistake of the user, and the checks that raise it."""

import math
import operator
from typing import Any


class InputError(ValueError):
    """A user's mistake, told in one line: what is wrong, where, what to do.

    The command line prints the message and exits with status 2; anything else that is
    raised is a defect of ours and keeps its traceback.
    """


def positive_length(argument: str, value: float | int) -> float:
    """The value [m] as a float, refused unless positive and finite.

    Raises:
        InputError: naming the argument and its value.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(
            f"{argument}={value} is no length: give a positive number of metres"
        )
    return float(value)


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
