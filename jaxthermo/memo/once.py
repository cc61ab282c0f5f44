"""Results of one computation, each computed once for the same objects.

The snapshots of a scene share all that does not move: it is the same object in each of
them, and what follows from it is computed once. Unlike findings, these results end with
the computation, and may be traced.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar


_P = ParamSpec("_P")
_T = TypeVar("_T")


def once(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Return the function with its results kept, by the identity of its arguments."""
    results: dict[object, _T] = {}
    # An object that is kept shares its address with no other one.
    kept: list[object] = []

    def known(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        key = (*map(id, args), *kwargs, *map(id, kwargs.values()))
        if key not in results:
            results[key] = function(*args, **kwargs)
            kept.append((args, kwargs))
        return results[key]

    return known
