"""Findings: results of searches in geometry, stored for the next run of the bodies.

Shadows, contacts, view factors and surface cells follow from voxels, poses and
directions, not from materials, coefficients or loads. A process searches once for each
finding, as long as the objects that it belongs to exist.

A finding is identified by these objects, and by the values of everything else that it
depends on. It is dropped with the first of its objects, and the least recently used
ones are dropped when all findings may exceed `MAX_BYTES`, until an eighth of it is
free. Stored arrays are read-only.
"""

import contextlib
import hashlib
import weakref
from collections.abc import Callable, Hashable, Iterator
from contextvars import ContextVar
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from ..arrays import HOST, device_array, is_compiling, is_traced
from .once import once


MAX_BYTES = 512 * 1024**2
"""Size of all findings together [bytes]."""

_FULL = 7 / 8
"""Share of the limit that findings take after the least recently used are dropped."""

_MIN_HASHED = 2**14
"""Size from which the hash of an array that cannot change is kept [bytes]."""

_T = TypeVar("_T")
_searches: ContextVar[list[str] | None] = ContextVar("searches", default=None)


class _Entry(NamedTuple):
    value: Any
    size: int
    objects: tuple[weakref.ref, ...]
    """References to its objects, which drop the entry when one of them ends."""


# By the addresses of objects, which no other object has while the entry exists. Each
# operation on it is atomic, so that threads share it, and so does the collector, which
# may drop an entry at any moment. The least recently used one is the first: a plain
# dict is copied without hashing its keys, which may run Python, and the collector.
_entries: dict[Hashable, _Entry] = {}

_bytes_at_most = 0
"""Size of all findings when they were last added up, and of those stored since."""


def found(
    of: tuple[object, ...],
    by: Hashable,
    find: Callable[[], _T],
    search: str | tuple[str, ...] = "",
) -> _T:
    """Return what `find` finds, without a new search if it was found before.

    Args:
        of: objects that the finding belongs to, compared by identity.
        by: values of everything else that it depends on, with the kind of finding
            first; None where they cannot be compared: the finding is not stored.
        find: the search; of geometry alone, and without effects.
        search: its name for the receipt of a run that makes it, or several; empty for
            none.
    """
    settings: Any = jax.config
    # Arrays differ with JAX's precision and device.
    mode = settings.jax_enable_x64, settings.jax_default_device
    key = by, mode, *map(id, of)
    entry = None
    is_stored = by is not None
    try:
        entry = _entries.get(key)
    except TypeError:
        is_stored = False
    if entry is not None and is_stored:
        with contextlib.suppress(KeyError):
            _entries[key] = _entries.pop(key)
        return entry.value
    names = _searches.get()
    if search and names is not None:
        names += (search,) if isinstance(search, str) else search
    # Geometry is known even while a scene is traced.
    is_tracing = is_compiling()
    with jax.ensure_compile_time_eval() if is_tracing else contextlib.nullcontext():
        value = find()
    if is_stored and not is_traced(value):
        _store(key, of, value)
    return value


def _store(key: Hashable, of: tuple[object, ...], value: Any) -> None:
    global _bytes_at_most
    size = 0
    for leaf in _leaves(value):
        if isinstance(leaf, np.ndarray):
            leaf.flags.writeable = False
        size += int(getattr(leaf, "nbytes", 64))
    if size > MAX_BYTES:
        return
    # A method of the store: names of the module are gone where an interpreter ends.
    drop = partial(_entries.pop, key)
    _entries[key] = _Entry(value, size, tuple(weakref.ref(part, drop) for part in of))
    _bytes_at_most += size
    if _bytes_at_most > MAX_BYTES:
        _make_room()


def _make_room() -> None:
    """Drop the least recently used findings."""
    global _bytes_at_most
    # Findings are many: room for many more, so that they are rarely added up.
    _, _bytes_at_most = findings_size()
    for key, entry in _entries.copy().items():
        if _bytes_at_most <= _FULL * MAX_BYTES:
            break
        _entries.pop(key, None)
        _bytes_at_most -= entry.size


@contextlib.contextmanager
def searches_recorded() -> Iterator[list[str]]:
    """Context that yields a list, to which the name of every search is added."""
    names: list[str] = []
    token = _searches.set(names)
    try:
        yield names
    finally:
        _searches.reset(token)


def forget_findings() -> None:
    """Drop all findings, and the memory that they take."""
    _entries.clear()


def findings_size() -> tuple[int, int]:
    """Return the number of findings, and their size [bytes]."""
    sizes = [entry.size for entry in _entries.copy().values()]
    return len(sizes), sum(sizes)


def digest(array: np.ndarray) -> tuple[str, tuple[int, ...], bytes]:
    """Type, shape and hash of an array, to compare it by; the same in every process."""
    # A view that is read-only may be one of an array that is not.
    is_constant = not array.flags.writeable and array.base is None
    by = "digest" if is_constant and array.nbytes >= _MIN_HASHED else None
    return found((array,), by, lambda: _digest(array))


def _digest(array: np.ndarray) -> tuple[str, tuple[int, ...], bytes]:
    content = np.packbits(array) if array.dtype == bool else np.ascontiguousarray(array)
    return array.dtype.str, array.shape, hashlib.sha256(content.data).digest()


def _leaves(value: Any) -> list[Any]:
    """Arrays and other values within pytrees and plain objects."""
    leaves_here: list[Any] = []
    within = [value]
    while within:
        leaves = jax.tree.leaves(within)
        within = []
        for leaf in leaves:
            fields = getattr(leaf, "__dict__", None)
            is_array = isinstance(leaf, np.ndarray | jax.Array)
            if fields and not is_array and not callable(leaf):
                within += fields.values()
            else:
                leaves_here.append(leaf)
    return leaves_here


def on_device(tree: Any) -> Any:
    """A pytree with its arrays of numpy on the device, each once."""
    move = once(device_array)
    leaves, structure = jax.tree.flatten(tree)
    moved = [move(leaf) if isinstance(leaf, HOST) else leaf for leaf in leaves]
    return structure.unflatten(moved)
