"""The exception for a mistake of the user, the checks that raise it, and a warning."""

import math
import operator
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class InputError(ValueError):
    """Mistake of the user, in one line: what is wrong, where, and a remedy.

    The command line prints the message and exits with status 2; any other exception is
    a defect of this package and keeps its traceback.
    """


class LongComputation(UserWarning):
    """A computation that takes long, told before most of it is done."""


@contextmanager
def located(where: str) -> Iterator[None]:
    """Begin the messages of errors with their place in the scene, as "terms[1]"."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def require(
    value: Any, classes: type | tuple[type, ...], argument: str, give: str
) -> None:
    """Refuse a value that is not of a class.

    Args:
        value: the argument.
        classes: its class, or several.
        argument: how it is written, e.g. "Body(material=)".
        give: what to give instead.

    Raises:
        InputError: naming the argument and its value.
    """
    if isinstance(value, classes):
        return
    # A class is a frequent slip: `Sun` where `Sun(...)` is meant.
    if isinstance(value, type):
        name = value.__name__
        raise InputError(
            f"{argument[:-1]}{name}): is the class {name} itself: give {give}"
        )
    raise InputError(f"{argument[:-1]}{shortened(value)}): give {give}")


def shortened(value: Any) -> str:
    """The representation of a value on one line, of at most 60 characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def positive_length(argument: str, value: float | int) -> float:
    """Convert a length [m] to a float.

    Raises:
        InputError: unless it is positive and finite.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(
            f"{argument}={value} is no length: give a positive number of metres"
        )
    return number


def whole_number(value: Any, option: str, minimum: int = 1) -> int:
    """Convert the value of an option, e.g. "Octree(levels=)", to an int.

    Raises:
        InputError: unless the value is an integer of at least `minimum`.
    """
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    # bool is an integer in Python, but True levels are a mistake.
    if number is None or number < minimum or isinstance(value, bool):
        raise InputError(
            f"{option[:-1]}{value!r}): give a whole number of at least {minimum}"
        )
    return number
