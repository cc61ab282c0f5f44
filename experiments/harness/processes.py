"""Calls in new processes, which inherit neither threads nor memory nor findings."""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import ParamSpec, TypeVar


_P = ParamSpec("_P")
_R = TypeVar("_R")


def in_new_process(
    function: Callable[_P, _R], *args: _P.args, **options: _P.kwargs
) -> _R:
    """The result of a function of a module, or its exception."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh) as pool:
        return pool.submit(function, *args, **options).result()
