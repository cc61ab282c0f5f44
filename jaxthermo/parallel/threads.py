"""Work of numpy in several threads, which leaves the interpreter while it computes."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar


_Value = TypeVar("_Value")
_Result = TypeVar("_Result")


def in_threads(
    compute: Callable[[_Value], _Result], values: Iterable[_Value]
) -> Iterator[_Result]:
    """Results for values, in their order, from as many threads as processors."""
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        yield from pool.map(compute, values)
