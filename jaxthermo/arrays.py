"""Array code that several packages need."""

import contextlib
from collections.abc import Callable
from typing import Any

import jax
import jax.core
import numpy as np
from jaxtyping import Array, Bool, Float, Int


Vec3 = tuple[float, float, float] | Float[np.ndarray, "3"]
"""A point or a direction given by the user [m or -]."""

Scalar = float | int | Float[Array, ""] | Float[np.ndarray, ""] | np.floating
"""One number, traced or not."""

TimeValue = Scalar | Callable
"""A number, or a function of time [s] that gives one."""

HostFloat = Float[np.ndarray, "..."]
HostInt = Int[np.ndarray, "..."]
HostBool = Bool[np.ndarray, "..."]


def precision(dtype: str) -> contextlib.AbstractContextManager:
    """A context in which arrays of `dtype` can be made."""
    return jax.enable_x64(True) if dtype == "float64" else contextlib.nullcontext()


def is_traced(tree: Any) -> bool:
    """Whether anything in a pytree is being differentiated, mapped or compiled."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def members(group: Int[np.ndarray, " k"], groups: int) -> Int[np.ndarray, "m g"]:
    """The first entry of every group, the second, and so on; k where there is none.

    Args:
        group: of each entry.
        groups: how many there are.
    """
    order = np.argsort(group, kind="stable").astype(np.int32)
    found = np.full((np.bincount(group).max(), groups), len(group), np.int32)
    found[rank_in_group(group[order]), group[order]] = order
    return found


def rank_in_group(group: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """Rank of each entry among those of its group; groups come one after the other."""
    slots = np.arange(len(group))
    first = np.ones(len(group), bool)
    first[1:] = group[1:] != group[:-1]
    return slots - np.maximum.accumulate(np.where(first, slots, 0))


LIST_COST, LIST_START = 6.0, 30_000.0
"""Of an entry of a sparse list, and of having one at all, in gathered entries."""


def gathered_columns(degree: Int[np.ndarray, " n"]) -> int:
    """How many entries to gather for every row, the rest in a list, at the least cost.

    Args:
        degree: entries of each row.
    """
    count = np.bincount(degree)
    beyond = np.cumsum(count[::-1])[::-1]
    """Rows with at least this degree."""
    left_over = np.append(np.cumsum(beyond[::-1])[::-1][1:], 0)
    cost = len(degree) * np.arange(len(count)) + LIST_COST * left_over
    cost += LIST_START * (left_over > 0)
    return int(cost.argmin())
