"""Findings: results of searches in geometry, stored for the next run of the bodies.

Shadows, contacts, view factors and surface cells follow from voxels, poses and
directions, not from materials, coefficients or loads. A process searches once for each
finding, as long as the objects that it belongs to exist.

A finding is identified by these objects, and by the values of everything else that it
depends on. It is dropped with the first of its objects, and the least recently used
ones are dropped when all findings exceed `MAX_BYTES`. Stored arrays are read-only.
"""

import contextlib
import hashlib
import threading
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable, Iterator
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar

import jax
import jax.core
import numpy as np

from .arrays import HOST, is_traced


MAX_BYTES = 512 * 1024**2
"""Size of all findings together [bytes]."""

_MIN_STORED = 2**14
"""Size above which an array stays on the device [bytes]: others move there at once."""

_MAX_NUMBERS = 256
"""Length up to which an array of numbers is compared by its values."""

_T = TypeVar("_T")
_searches: ContextVar[list[str] | None] = ContextVar("searches", default=None)


class _Same:
    """An object within a key: equal to itself alone, and not kept alive."""

    __slots__ = ("__weakref__", "_hash", "_seen")

    def __init__(self, seen: object, on_end: Callable[[Any], None] | None = None):
        self._seen = weakref.ref(seen, on_end)
        self._hash = id(seen)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        # Another object may have taken the address of one that is gone.
        object_seen = self._seen()
        return (
            isinstance(other, _Same)
            and object_seen is not None
            and object_seen is other._seen()
        )


class _Entry(NamedTuple):
    value: Any
    size: int


class _Store:
    """Findings by key, the least recently used first; for any number of threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: OrderedDict[Hashable, _Entry] = OrderedDict()
        self._size = 0
        # Keys whose object no longer exists.
        self._ended: deque[Hashable] = deque()

    def get(self, key: Hashable) -> _Entry | None:
        with self._lock:
            self._sweep()
            entry = self._entries.get(key)
            if entry is not None:
                self._entries.move_to_end(key)
            return entry

    def put(self, key: Hashable, value: Any, size: int) -> None:
        if size > MAX_BYTES:
            return
        with self._lock:
            self._drop(key)
            self._entries[key] = _Entry(value, size)
            self._size += size
            while self._size > MAX_BYTES:
                self._drop(next(iter(self._entries)))
            self._sweep()

    def end(self, key: Hashable) -> None:
        """Drop a key whose object no longer exists."""
        # The collector may call this at any moment, even within `put` of this thread:
        # the key is then dropped at the next opportunity.
        self._ended.append(key)
        if self._lock.acquire(blocking=False):
            try:
                self._sweep()
            finally:
                self._lock.release()

    def clear(self) -> None:
        with self._lock:
            self._entries.clear()
            self._ended.clear()
            self._size = 0

    def size(self) -> tuple[int, int]:
        with self._lock:
            self._sweep()
            return len(self._entries), self._size

    def _sweep(self) -> None:
        while self._ended:
            self._drop(self._ended.popleft())

    def _drop(self, key: Hashable) -> None:
        dropped = self._entries.pop(key, None)
        if dropped is not None:
            self._size -= dropped.size


_store = _Store()


def found(
    of: tuple[object, ...], by: Hashable, find: Callable[[], _T], search: str = ""
) -> _T:
    """Return what `find` finds, without a new search if it was found before.

    Args:
        of: objects that the finding belongs to, compared by identity.
        by: values of everything else that it depends on, with the kind of finding
            first; None where they cannot be compared: the finding is not stored.
        find: the search; of geometry alone, and without effects.
        search: its name for the receipt of a run that makes it; empty for none.
    """
    key = None if by is None else _key(of, by)
    entry = None if key is None else _store.get(key)
    if entry is not None:
        return entry.value
    names = _searches.get()
    if search and names is not None:
        names.append(search)
    # Geometry is known even while a scene is traced.
    with jax.ensure_compile_time_eval():
        value = find()
    if key is not None and not is_traced(value):
        leaves = _leaves(value)
        for leaf in leaves:
            if isinstance(leaf, np.ndarray):
                leaf.flags.writeable = False
        size = sum(int(getattr(leaf, "nbytes", 64)) for leaf in leaves)
        _store.put(_ending_key(of, by), value, size)
    return value


def _key(of: tuple[object, ...], by: Hashable) -> Hashable | None:
    key = (by, _mode(), *map(_Same, of))
    try:
        hash(key)
    except TypeError:
        return None
    return key


def _ending_key(of: tuple[object, ...], by: Hashable) -> Hashable:
    """Key as of `_key`, which is dropped with the first of its objects."""
    keys: list[Hashable] = []
    # A method of the store: names of the module are gone where an interpreter ends.
    end = _store.end
    key = (by, _mode(), *(_Same(member, lambda _: end(keys[0])) for member in of))
    keys.append(key)
    return key


def _mode() -> Hashable:
    """JAX's precision and device, with which arrays differ."""
    config: Any = jax.config
    return config.jax_enable_x64, config.jax_default_device


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
    _store.clear()


def findings_size() -> tuple[int, int]:
    """Return the number of findings, and their size [bytes]."""
    return _store.size()


def values_of(tree: Any) -> Hashable:
    """Values of all numbers of a pytree, and its structure, to compare it by.

    None where they are not known, or too many to compare.
    """
    leaves, structure = jax.tree.flatten(tree)
    values: list[Hashable] = []
    for leaf in leaves:
        if isinstance(leaf, jax.core.Tracer):
            return None
        if isinstance(leaf, np.ndarray | np.generic | jax.Array):
            if leaf.size > _MAX_NUMBERS:
                return None
            host = np.asarray(leaf)
            values.append((host.dtype.str, host.shape, host.tobytes()))
        else:
            values.append((type(leaf), leaf))
    key = (structure, tuple(values))
    try:
        hash(key)
    except TypeError:
        return None
    return key


def digest(array: np.ndarray) -> Hashable:
    """Type, shape and hash of an array, to compare it by."""
    by = "digest" if is_finding(array) else None
    return found((array,), by, lambda: _digest(array))


def is_finding(*arrays: np.ndarray) -> bool:
    """True for arrays that no one can change, such as those of findings."""
    # A view that is read-only may be one of an array that is not.
    return not any(array.flags.writeable or array.base is not None for array in arrays)


def _digest(array: np.ndarray) -> Hashable:
    content = np.packbits(array) if array.dtype == bool else np.ascontiguousarray(array)
    code = hashlib.blake2b(content.tobytes(), digest_size=16).digest()
    return array.dtype.str, array.shape, code


def _leaves(value: Any) -> list[Any]:
    """Arrays and other values within pytrees and plain objects."""
    found_here: list[Any] = []
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
                found_here.append(leaf)
    return found_here


_to_device = jax.jit(lambda arrays: arrays)


def on_device(tree: Any) -> Any:
    """A pytree with its arrays of numpy on the device; those of findings move once."""
    # One call of a function that returns its arguments is faster than `device_put` of
    # each of them.
    leaves, structure = jax.tree.flatten(tree)
    host = {id(leaf): leaf for leaf in leaves if isinstance(leaf, HOST)}
    # Known arrays stay known where other values are traced.
    with jax.ensure_compile_time_eval():
        on_device_already = {
            key: found((leaf,), "on device", lambda leaf=leaf: _to_device(leaf))
            for key, leaf in host.items()
            if isinstance(leaf, np.ndarray)
            and leaf.nbytes > _MIN_STORED
            and is_finding(leaf)
        }
        not_there_yet = {
            key: leaf for key, leaf in host.items() if key not in on_device_already
        }
        moved = dict(
            zip(not_there_yet, _to_device(list(not_there_yet.values())), strict=True)
        )
    moved |= on_device_already
    return structure.unflatten([moved.get(id(leaf), leaf) for leaf in leaves])
