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


# Positions in the structures of XLA, counted in words of eight bytes: of a call frame,
_EXTENSION = 1
_API = 2
_STAGE = 4
_ARGUMENTS = 9
_RESULTS = 14
# of the extension that asks for the version, and of the interface,
_METADATA = 3
_VERSION = 3
_TRAITS = 4
_VERSION_OF_API = 4
# and of a buffer.
_DATA = 3
_RANK = 4
_EXTENTS = 5

_EXECUTE = 3
"""Stage of a call that computes."""

_FAST = {"contract"}
"""Fused products; sums stay in their order, exact 0 between equal temperatures."""


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    """A function in machine code, cached next to the source or in numba's folder."""
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
    is_shared = _threading_layer() != "workqueue"
    return _compiled(loop, parallel=is_shared, fastmath=_FAST)


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
    size = 1
    extents = _pointer(buffer[_EXTENTS], word)
    for axis in range(buffer[_RANK]):
        size *= extents[axis]
    return numba.carray(_pointer(buffer[_DATA], like), (size,))


def handler(entry: Any, dtype: str) -> int:
    """Address of a function that XLA can call, which calls an `entry` in a precision.

    The entry takes the addresses of the lists of arguments and of results, and a number
    of the type of the arrays.
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
    compiled = numba.cfunc(address(address))(inspect.unwrap(call))
    _compiled_calls.append(compiled)
    assert compiled.address is not None
    return compiled.address


# XLA holds their addresses as long as the process runs.
_compiled_calls: list[Any] = []


@serial
def double(args, results, like):
    """Twice an array, as a trial."""
    values = array_at(args, 0, like)
    out = array_at(results, 0, like)
    out[:] = values + values
