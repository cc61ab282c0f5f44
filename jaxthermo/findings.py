"""Findings: results of searches in geometry, kept for the next run of the same bodies.

Shadows, contacts, view factors and surface cells follow from voxels, poses and
directions, not from materials, coefficients or loads. What is found once is found again
in no other run of this process, as long as the objects that it belongs to exist.

A finding is known by the identity of these objects, and by the values of all else that
it depends on. It is dropped with the first of them; of all together the least recently
used are dropped beyond `MAX_BYTES`. Arrays that are kept refuse to be written to.
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

_MIN_KEPT = 2**14
"""Size above which an array is kept on the device [bytes]: others are as soon there."""

_MAX_NUMBERS = 256
"""Length up to which an array of numbers is compared by its values."""

_T = TypeVar("_T")
_searches: ContextVar[list[str] | None] = ContextVar("searches", default=None)


class _Same:
    """An object as part of a key: equal to itself alone, and not kept alive."""

    __slots__ = ("__weakref__", "_hash", "_seen")

    def __init__(self, seen: object, on_end: Callable[[Any], None] | None = None):
        self._seen, self._hash = weakref.ref(seen, on_end), id(seen)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        # Another object may have taken the address of one that is gone.
        own = self._seen()
        return isinstance(other, _Same) and own is not None and own is other._seen()


class _Kept(NamedTuple):
    value: Any
    size: int


class _Store:
    """Findings by key, the least recently used first; for any number of threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[Hashable, _Kept] = OrderedDict()
        self._size = 0
        # Keys whose object is gone.
        self._ended: deque[Hashable] = deque()

    def get(self, key: Hashable) -> _Kept | None:
        with self._lock:
            self._sweep()
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
            return found

    def put(self, key: Hashable, value: Any, size: int) -> None:
        if size > MAX_BYTES:
            return
        with self._lock:
            self._drop(key)
            self._kept[key] = _Kept(value, size)
            self._size += size
            while self._size > MAX_BYTES:
                self._drop(next(iter(self._kept)))
            self._sweep()

    def end(self, key: Hashable) -> None:
        """Drop a key whose object is gone."""
        # The collector may call this in the middle of anything, also of `put` in this
        # very thread: then it is dropped at the next opportunity.
        self._ended.append(key)
        if self._lock.acquire(blocking=False):
            try:
                self._sweep()
            finally:
                self._lock.release()

    def clear(self) -> None:
        with self._lock:
            self._kept.clear()
            self._ended.clear()
            self._size = 0

    def size(self) -> tuple[int, int]:
        with self._lock:
            self._sweep()
            return len(self._kept), self._size

    def _sweep(self) -> None:
        while self._ended:
            self._drop(self._ended.popleft())

    def _drop(self, key: Hashable) -> None:
        dropped = self._kept.pop(key, None)
        if dropped is not None:
            self._size -= dropped.size


_store = _Store()


def found(
    of: tuple[object, ...], by: Hashable, find: Callable[[], _T], search: str = ""
) -> _T:
    """Return what `find` finds, from before if it was found before.

    Args:
        of: objects, known by their identity, that the finding belongs to.
        by: values of all else that it depends on, with the kind of finding first; None
            where they cannot be compared, for a finding that is not kept.
        find: the search; of geometry alone, and without effects.
        search: its name for the receipt of a run that makes it; empty for none.
    """
    key = None if by is None else _key(of, by)
    kept = None if key is None else _store.get(key)
    if kept is not None:
        return kept.value
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
    """The same key, which is dropped with the first of its objects."""
    whole: list[Hashable] = []
    # Of the store itself: names of the module are gone where an interpreter ends.
    end = _store.end
    on_end = lambda _: end(whole[0])
    key = (by, _mode(), *(_Same(each, on_end) for each in of))
    whole.append(key)
    return key


def _mode() -> Hashable:
    """JAX's precision and device, with which arrays differ."""
    config: Any = jax.config
    return config.jax_enable_x64, config.jax_default_device


@contextlib.contextmanager
def searches_recorded() -> Iterator[list[str]]:
    """Context in whose list the names of all searches appear that are made."""
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
    key = structure, tuple(values)
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
    return not any(each.flags.writeable or each.base is not None for each in arrays)


def _digest(array: np.ndarray) -> Hashable:
    content = np.packbits(array) if array.dtype == bool else np.ascontiguousarray(array)
    code = hashlib.blake2b(content.tobytes(), digest_size=16).digest()
    return array.dtype.str, array.shape, code


def _leaves(value: Any) -> list[Any]:
    """Arrays and other values within pytrees and plain objects."""
    found_here: list[Any] = []
    within = [value]
    while within:
        leaves, within = jax.tree.leaves(within), []
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
    """A pytree with its arrays of numpy on the device, those of findings once."""
    # A function that returns its arguments takes a third of the time of `device_put`.
    leaves, structure = jax.tree.flatten(tree)
    host = {id(leaf): leaf for leaf in leaves if isinstance(leaf, HOST)}
    # Known arrays stay known where other values are traced.
    with jax.ensure_compile_time_eval():
        kept = {
            key: found((leaf,), "on device", lambda own=leaf: _to_device(own))
            for key, leaf in host.items()
            if isinstance(leaf, np.ndarray)
            and leaf.nbytes > _MIN_KEPT
            and is_finding(leaf)
        }
        others = {key: leaf for key, leaf in host.items() if key not in kept}
        moved = dict(zip(others, _to_device(list(others.values())), strict=True))
    moved |= kept
    return structure.unflatten([moved.get(id(leaf), leaf) for leaf in leaves])
