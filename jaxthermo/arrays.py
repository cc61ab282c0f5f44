"""Arrays: names of their types, precision, tracing, grouping of entries.

Shape letters: n nodes, e links, s surface fragments, x y z voxels, v vertices,
f faces, k raster fragments, l levels, t saved times, b bodies, h w pixels, p points.
"""

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextvars import ContextVar
from functools import cache
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import mlir
from jaxtyping import Array, Bool, Float, Int, Shaped
from numpy.typing import ArrayLike


Scalar = float | int | Float[Array, ""] | Float[np.ndarray, ""] | np.floating
"""One number, traced or not."""

Time = Float[Array, ""]
"""A moment, or the length of a step, inside of a compiled step [s]."""

SplitTimes = Float[Any, "2 ..."]
"""Times as rounded numbers and their remainders [s]; the sum is the time."""

HostTime = Float[np.ndarray, ""] | np.floating
"""A moment in float64 on the host [s]."""

if TYPE_CHECKING:
    Number = Scalar
    Numbers = ArrayLike | Float[Array, "..."]
    Samples = Float[np.ndarray, " k"]
    Vector = Sequence[Scalar] | Float[np.ndarray, "3"]
    Points = Sequence[Sequence[Scalar]] | Float[np.ndarray, "n 3"]
    TimeVarying = Numbers | Callable[[Float[Array, ""]], Numbers]
    PositionVarying = Scalar | Callable[[Float[np.ndarray, "n 3"]], ArrayLike]
else:
    # For editors only: a wrong value is refused by its class, with argument, value and
    # remedy, and the type check of a test run would come first.
    Number = Numbers = Samples = Vector = Points = TimeVarying = PositionVarying = Any

Quantity = Scalar | Float[Array, "..."] | Float[np.ndarray, "..."]
"""A number or an array of them, of any shape."""

HostFloat = Float[np.ndarray, "..."]
"""Array of numpy, of any shape."""

HOST = np.ndarray | np.generic
"""Arrays and numbers of numpy."""


def precision(dtype: str) -> contextlib.AbstractContextManager:
    """Context in which arrays of `dtype` can be created."""
    # Local, so that a float64 scene leaves the precision of other code unchanged.
    return jax.enable_x64(True) if dtype == "float64" else contextlib.nullcontext()


def is_traced(tree: Any) -> bool:
    """True if any leaf of a pytree is being differentiated, mapped or compiled."""
    if isinstance(tree, float | HOST):
        return False
    # By their types, which are few: a scene has many leaves.
    return any(map(_is_tracer, set(map(type, jax.tree.leaves(tree)))))


def is_compiling() -> bool:
    """True while JAX traces a function that it compiles."""
    # An operation of JAX itself would be dispatched to the device, which costs more.
    return isinstance(_identity.bind(np.float32(0)), jax.core.Tracer)


_identity = Primitive("identity")
_identity.def_impl(lambda value: value)
_identity.def_abstract_eval(lambda value: value)
mlir.register_lowering(_identity, lambda _, value: [value])


@cache
def _is_tracer(leaf_type: type) -> bool:
    return issubclass(leaf_type, jax.core.Tracer)


def stop_gradient(tree: Any) -> Any:
    """Return a pytree whose arrays carry no derivatives."""
    return jax.tree.map(
        lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, tree
    )


def namespace(values: Any) -> Any:
    """Module for computing with the values: jax.numpy if any is traced, else numpy."""
    return jnp if is_traced(values) else np


def array_namespace(values: Any) -> Any:
    """Module of the values' arrays: jax.numpy if any is one of JAX, else numpy."""
    on_device = any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(values))
    return jnp if on_device else np


def typed_array(value: Any, dtype: Any) -> Any:
    """The value as an array of a type: of numpy, unless it is one of JAX or traced."""
    # The arrays of a scene move to the device together, at its end.
    return array_namespace(value).asarray(value, dtype)


class _Row(NamedTuple):
    """A row of an array of rows."""

    row: Array
    array: Array
    number: int


_known_rows: ContextVar[dict[int, _Row] | None] = ContextVar("rows", default=None)


@contextlib.contextmanager
def rows_remembered() -> Iterator[None]:
    """Context in which `stacked` knows the arrays of the rows of `rows_of`."""
    token = _known_rows.set({})
    try:
        yield
    finally:
        _known_rows.reset(token)


def rows_of(array: Float[Array, "b ..."]) -> list[Float[Array, "..."]]:
    """Rows of an array, which `stacked` puts together without an operation."""
    rows = list(jnp.unstack(array))
    known = _known_rows.get()
    if known is not None:
        for number, row in enumerate(rows):
            known[id(row)] = _Row(row, array, number)
    return rows


def stacked(values: Sequence[Any], dtype: Any) -> Any:
    """Numbers as one array: of numpy, unless one of them is of JAX or traced."""
    known = _known_rows.get() or {}
    rows = [known.get(id(value)) for value in values]
    if any(row is not None for row in rows):
        return _gathered(values, rows, dtype)
    xp = array_namespace(values)
    return xp.stack([xp.asarray(value, dtype) for value in values])


def _gathered(
    values: Sequence[Any], rows: Sequence[_Row | None], dtype: Any
) -> Float[Array, "b ..."]:
    """Values as one array, those that are rows from the arrays of these rows."""
    sources: list[Array] = []
    first_of: dict[int, int] = {}
    index = []
    end = 0
    for value, row in zip(values, rows, strict=True):
        source = row.array if row else jnp.asarray(value)[None]
        if id(source) not in first_of:
            first_of[id(source)] = end
            sources.append(source)
            end += len(source)
        index.append(first_of[id(source)] + (row.number if row else 0))
    typed = [source.astype(dtype) for source in sources]
    array = typed[0] if len(typed) == 1 else jnp.concatenate(typed)
    is_whole = np.array_equal(index, np.arange(end))
    return array if is_whole else array[np.array(index)]


def device_array(value: Any, dtype: Any = None) -> Any:
    """The value as an array on the device; `dtype` is None for that of the value.

    Arrays of numpy, which must not change afterwards, are moved: `jnp.asarray` compiles
    a program for each of their shapes.
    """
    if not isinstance(value, HOST):
        return jnp.asarray(value, dtype)
    # Known arrays stay known where other values are traced.
    with jax.ensure_compile_time_eval():
        return jax.device_put(np.asarray(value, dtype))


def plain_numbers(value: Any) -> Any:
    """Numbers of numpy and JAX as Python's own, arrays as tuples, within tuples too.

    A converter of static fields, which must be hashable; other values do not change.
    """
    if isinstance(value, jax.Array) and not is_traced(value):
        value = np.asarray(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        return tuple(plain_numbers(item) for item in value)
    return value


def static_numbers(default: Any) -> Any:
    """Static field of plain numbers, which compiled programs take as constants."""
    return eqx.field(static=True, converter=plain_numbers, default=default)


def split_times(times: Any) -> SplitTimes:
    """Times [s] as numbers of float32 and their remainders.

    Times of a device have a remainder in float64 alone: those of float32 are rounded.
    """
    if isinstance(times, jax.Array):
        # Not by two conversions, which XLA may leave out as one of excess precision.
        rounded = jax.lax.reduce_precision(times, exponent_bits=8, mantissa_bits=23)
        return jnp.stack([rounded, times - rounded])
    exact = np.asarray(times, float)
    rounded = exact.astype(np.float32).astype(float)
    return np.stack([rounded, exact - rounded])


def smooth_step(t: Any) -> Any:
    """Smooth rise t^2 (3 - 2 t) from 0 at 0 to 1 at 1, with slopes of 0 there."""
    return t * t * (3 - 2 * t)


def linear_map(
    vectors: Float[np.ndarray, "*n 3"], matrix: Float[np.ndarray, "3 m"]
) -> Float[np.ndarray, "*n m"]:
    """Product `vectors @ matrix`, column by column.

    BLAS divides such flat products among threads, which on a busy machine wait for each
    other.
    """
    return np.stack(_columns_of_product(vectors, matrix), axis=-1)


def linear_map_in_columns(
    vectors: Float[np.ndarray, "*n 3"], matrix: Float[np.ndarray, "3 m"]
) -> Float[np.ndarray, "*n m"]:
    """The numbers of `linear_map`, with those of a column side by side in memory.

    Extremes of coordinates are found faster there, and columns are read faster.
    """
    return np.moveaxis(np.stack(_columns_of_product(vectors, matrix)), 0, -1)


def _columns_of_product(
    vectors: Float[np.ndarray, "*n 3"], matrix: Float[np.ndarray, "3 m"]
) -> list[Any]:
    # Coordinates in a row each, and one array for products: new memory for each of them
    # takes longer than the arithmetic.
    dtype = np.result_type(vectors, matrix)
    x, y, z = np.ascontiguousarray(np.moveaxis(vectors, -1, 0), dtype)
    term = np.empty_like(x)
    columns = []
    for a, b, c in matrix.T:
        column = x * a
        column += np.multiply(y, b, out=term)
        column += np.multiply(z, c, out=term)
        columns.append(column)
    return columns


EXACT = jax.lax.Precision.HIGHEST
"""Products in the precision of their type: a GPU rounds float32 to 10 bits otherwise,
3 mK of 300 K."""


def product(
    left: Float[Array, "..."], right: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Return left @ right on a device, in the full precision of its type."""
    return jnp.matmul(left, right, precision=EXACT)


def taken(values: Shaped[Array, "..."], address: Any) -> Shaped[Array, "..."]:
    """Return values[address], of indices that are neither negative nor too large."""
    # Negative ones, which count from the end, would cost a second array of indices.
    return values.at[address].get(mode="promise_in_bounds", wrap_negative_indices=False)


def added(
    values: Shaped[Array, "..."],
    address: Any,
    values_to_add: Shaped[Array, "..."],
    *,
    is_sorted: bool = False,
    is_unique: bool = False,
) -> Shaped[Array, "..."]:
    """Return values with others added at an address, of indices as in `taken`."""
    return values.at[address].add(
        values_to_add,
        mode="promise_in_bounds",
        wrap_negative_indices=False,
        indices_are_sorted=is_sorted,
        unique_indices=is_unique,
    )


def consecutive(sizes: Iterable[int]) -> list[slice]:
    """Slices of these sizes, one after the other."""
    ends = list(accumulate(sizes, initial=0))
    return [slice(start, stop) for start, stop in pairwise(ends)]


def members(group: Int[np.ndarray, " k"], groups: int) -> Int[np.ndarray, "m g"]:
    """Indices of the first entry of every group, the second, ..., padded with k."""
    order = np.argsort(group, kind="stable").astype(np.int32)
    entries = np.full((np.bincount(group).max(), groups), len(group), np.int32)
    entries[rank_in_group(group[order]), group[order]] = order
    return entries


def rank_in_group(group: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Rank of each entry within its group; equal groups must be adjacent."""
    slots = np.arange(len(group))
    first = np.diff(group, prepend=-1) != 0
    return slots - np.maximum.accumulate(np.where(first, slots, 0))


def stable_order(key: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Order that sorts numbers of at least 0, as by `np.argsort(kind="stable")`."""
    return sorted_with_order(key)[1]


def sorted_with_order(
    key: Int[np.ndarray, " n"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Sorted numbers of at least 0, and their order, as by a stable sort."""
    # Unlike numpy's stable sort, one of keys with their indices in the low bits uses
    # vector instructions.
    bits = max(len(key) - 1, 0).bit_length()
    if int(key.max(initial=0)) >> (63 - bits):
        order = np.argsort(key, kind="stable")
        return key[order], order
    count = len(key)
    packed = key.astype(np.int64)
    # Frees a long array that the caller does not hold.
    del key
    packed <<= bits
    packed |= np.arange(count)
    packed.sort()
    order = packed & ((1 << bits) - 1)
    packed >>= bits
    return packed, order


def flat_index(
    cells: Int[np.ndarray, "m 3"], shape: tuple[int, ...]
) -> Int[np.ndarray, " m"]:
    """Indices of cells in the flat array of a lattice of that shape."""
    return np.asarray(np.ravel_multi_index(tuple(cells.T), shape))


def sorted_union(
    first: Int[np.ndarray, " n"], *more_arrays: Int[np.ndarray, " _"]
) -> Int[np.ndarray, " k"]:
    """Numbers that are in any of the arrays, each once, as by `np.union1d`."""
    # numpy would hash them first, which is slower than to sort them.
    values = np.sort(np.concatenate((first, *more_arrays)))
    begins = np.ones(len(values), bool)
    np.not_equal(values[1:], values[:-1], out=begins[1:])
    return values[begins]


def in_sorted(
    values: Int[np.ndarray, "*n"], ordered: Int[np.ndarray, " k"]
) -> Bool[np.ndarray, "*n"]:
    """Flag values that occur in sorted numbers, as by `np.isin`."""
    # numpy would hash them first, which is slower than to look each up.
    if not len(ordered):
        return np.zeros(values.shape, bool)
    place = np.searchsorted(ordered, values)
    return ordered[np.minimum(place, len(ordered) - 1)] == values


def unique_rows(
    rows: Int[np.ndarray, "n c"],
) -> tuple[Int[np.ndarray, "k c"], Int[np.ndarray, " n"]]:
    """Different rows, sorted, and the number of each row among them.

    As by `np.unique` along the first axis, which compares rows as bytes.
    """
    low = rows.min(axis=0, initial=0)
    counts = [int(n) for n in rows.max(axis=0, initial=0) - low + 1]
    if math.prod(counts) > np.iinfo(np.int64).max:
        distinct, number = np.unique(rows, axis=0, return_inverse=True)
        return distinct, number.reshape(-1)
    # One number a row, which sorts as the row does.
    key = np.zeros(len(rows), np.int64)
    for column, lowest, count in zip(rows.T, low, counts, strict=True):
        key = key * count + (column - lowest)
    distinct_keys = numbered(key)
    return rows[distinct_keys.first], distinct_keys.number


class Numbered(NamedTuple):
    """Different numbers of an array, in their order."""

    value: Int[np.ndarray, " k"]
    first: Int[np.ndarray, " k"]
    """Index at which each occurs first."""
    number: Int[np.ndarray, " n"]
    """Rank of each entry among them."""
    order: Int[np.ndarray, " n"]
    """Indices of the entries, sorted by their numbers; equal ones in their order."""


def numbered(key: Int[np.ndarray, " n"]) -> Numbered:
    """Number the different ones of numbers of at least 0, as by `np.unique`."""
    ordered, order = sorted_with_order(key)
    begins = np.ones(len(key), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=begins[1:])
    number = np.empty(len(key), np.intp)
    number[order] = np.cumsum(begins) - 1
    return Numbered(
        value=ordered[begins], first=order[begins], number=number, order=order
    )


def ranks(label: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Rank of each label among those that occur, as by `numbered`, without a sort.

    Labels are small numbers of at least 0: there is an entry for all up to the largest.
    """
    occurs = np.zeros(int(label.max(initial=-1)) + 1, bool)
    occurs[label] = True
    return (np.cumsum(occurs) - 1)[label]


LIST_ENTRY_COST = 10.0
"""Cost of one entry of a sparse list over that of a gathered one: scatters are slow."""

LIST_COST = 3_000.0
"""Cost of a sparse list over that of a gathered entry: it adds operations to a step."""


def gathered_columns(degree: Int[np.ndarray, " n"]) -> int:
    """Entries to gather for rows of these degrees; the rest goes to a sparse list."""
    count = np.bincount(degree)
    rows_from = np.cumsum(count[::-1])[::-1]
    # Entries beyond the first k of every row: the rows of higher degrees, summed.
    remaining = np.append(np.cumsum(rows_from[::-1])[::-1][1:], 0)
    cost = len(degree) * np.arange(len(count)) + LIST_ENTRY_COST * remaining
    cost += LIST_COST * (remaining > 0)
    return int(cost.argmin())
