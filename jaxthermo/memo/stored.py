"""Results on disk, for the next process that computes them from the same inputs.

A file's name is the hash of everything that its result follows from, with the code of
this library. `found` remembers within one process, by the identity of objects.
"""

import contextlib
import functools
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from . import store
from .content_hash import code_hash, content_hash
from .values import NoContentError, PlainValue, fields, read_value


_MIN_SECONDS = 0.03
"""Duration of a computation below which it is as fast to compute again."""

_T = TypeVar("_T")
_P = ParamSpec("_P")


def stored_search(
    category: str, types: tuple[type, ...] = ()
) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Decorator of a function whose result depends on its arguments alone.

    Arguments are those of `stored`.
    """

    def decorated(compute: Callable[_P, _T]) -> Callable[_P, _T]:
        @functools.wraps(compute)
        def run(*args: _P.args, **kwargs: _P.kwargs) -> _T:
            return stored(
                category,
                inputs=(args, kwargs),
                compute=lambda: compute(*args, **kwargs),
                types=types,
            )

        return run

    return decorated


def stored(
    category: str,
    inputs: Any,
    compute: Callable[[], _T],
    types: tuple[type, ...] = (),
) -> _T:
    """Return what any process computed before, or compute and store it.

    Args:
        category: name of such results, in lower case.
        inputs: everything that the result depends on: numbers, texts, arrays, None, or
            tuples, dicts and dataclasses of this library with these. With anything
            else, such as a traced value or a class of the user, nothing is stored.
        compute: computes the result, of values of these types and of `types`.
        types: dataclasses and NamedTuples that occur in the result.
    """
    folder = store.cache_folder()
    if folder is None:
        return compute()
    try:
        key = content_hash((code_hash(), category, inputs))
    except NoContentError:
        return compute()
    path = store.result_path(folder, category, key)
    # A file that is missing or damaged raises any exception.
    with contextlib.suppress(Exception), path.open("rb") as file:
        value = read_value(
            file, {value_type.__name__: value_type for value_type in types}
        )
        store.mark_used(path)
        return value
    clock = time.perf_counter()
    value = compute()
    if time.perf_counter() - clock >= _MIN_SECONDS:
        _write(folder, path=path, value=value, types=types)
    return value


def _write(folder: Path, path: Path, value: Any, types: tuple[type, ...]) -> None:
    def fields_of(value: Any) -> Iterable[Any]:
        if type(value) not in types:
            raise NoContentError(f"cannot be stored: {type(value)}")
        return fields(value)

    with contextlib.suppress(NoContentError):
        plain = PlainValue.of(value, fields_of)
        store.write_entry(folder, path=path, size=plain.size, write=plain.write)
