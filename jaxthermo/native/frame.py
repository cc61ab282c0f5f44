"""Frames of arrays in which XLA calls a function, as numba reads them.

XLA calls a function of one argument, the address of a frame, which lists the addresses
of the arrays to read and to fill. The layout is that of `xla/ffi/api/c_api.h`, version
0.3; a later one that is called in another way fails in `require_native`.
"""

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic


# Positions in structures of XLA, counted in words of eight bytes.
_EXTENSION, _API, _STAGE, _ARGUMENTS, _RESULTS = 1, 2, 4, 9, 14
_METADATA, _VERSION, _TRAITS, _VERSION_OF_API = 3, 3, 4, 4
_DATA, _RANK, _EXTENTS = 3, 4, 5
_EXECUTE = 3

_FAST = {"contract"}
"""Fused products; sums stay in their order, exact 0 between equal temperatures."""


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    """A function in machine code, kept beside the source or in numba's own cache."""
    # Without its types, which tests check: numba cannot read those.
    plain = inspect.unwrap(function)
    try:
        return numba.njit(cache=True, **options)(plain)
    except RuntimeError:
        # No folder may be written: compiled again in every process.
        return numba.njit(**options)(plain)


def serial(function: Callable[..., Any]) -> Any:
    """A function in machine code."""
    return _compiled(function)


def parallel(loop: Callable[..., None]) -> Any:
    """A loop over arrays in machine code, in all threads that numba may use."""
    # Several threads of XLA may call at once, which this layer answers with an abort.
    several = _threading_layer() != "workqueue"
    return _compiled(loop, parallel=several, fastmath=_FAST)


@cache
def _threading_layer() -> str:
    def fill(values):
        for n in numba.prange(len(values)):
            values[n] = n

    # Known once a loop has run, which also starts the threads of loops from a cache.
    _compiled(fill, parallel=True)(np.zeros(2))
    return numba.threading_layer()  # pyright: ignore[reportPrivateImportUsage]


def _pointer_to(typingctx, address, like):
    target = numba.types.CPointer(like)

    def generate(context, builder, signature, values):
        return builder.inttoptr(values[0], context.get_value_type(target))

    return target(numba.types.int64, like), generate


_pointer = intrinsic(inspect.unwrap(_pointer_to))
"""Pointer to values of the type of `like` at an address."""


@serial
def extent_at(addresses, n, axis):
    """Extent of array n of a list of XLA along an axis."""
    word = np.int64(0)
    buffer = _pointer(_pointer(addresses, word)[n], word)
    return _pointer(buffer[_EXTENTS], word)[axis]


@serial
def array_at(addresses, n, like):
    """Array n of a list of XLA as a vector, of values of the type of `like`."""
    word = np.int64(0)
    buffer = _pointer(_pointer(addresses, word)[n], word)
    size, extents = 1, _pointer(buffer[_EXTENTS], word)
    for axis in range(buffer[_RANK]):
        size *= extents[axis]
    return numba.carray(_pointer(buffer[_DATA], like), (size,))


def handler(entry: Any, dtype: str) -> int:
    """Address of a function that XLA can call, around an `entry` for a precision.

    That is a function of the addresses of the lists of arguments and of results, and of
    a number of the type of the arrays.
    """
    like = np.dtype(dtype).type(0)
    address = numba.types.int64
    entry.compile((address, address, numba.typeof(like)))

    def call(frame):
        word = np.int64(0)
        words = _pointer(frame, word)
        if words[_EXTENSION] != 0:
            # XLA asks for the version of its interface for which this was written.
            asked = _pointer(words[_EXTENSION], word)
            metadata = _pointer(asked[_METADATA], word)
            metadata[_VERSION] = _pointer(words[_API], word)[_VERSION_OF_API]
            metadata[_TRAITS] = 0
        elif words[_STAGE] & 0xFFFFFFFF == _EXECUTE:
            entry(words[_ARGUMENTS], words[_RESULTS], like)
        # No error.
        return 0

    # Not from a cache, from which threads would not be started.
    made = numba.cfunc(address(address))(inspect.unwrap(call))
    _kept.append(made)
    assert made.address is not None
    return made.address


# XLA has their addresses for as long as the process runs.
_kept: list[Any] = []


@serial
def double(args, results, like):
    """Twice an array, as a trial."""
    values, out = array_at(args, 0, like), array_at(results, 0, like)
    out[:] = values + values
