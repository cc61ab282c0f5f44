"""One law for the places of several bodies, from the same term's law on each of them.

Values a place are put one body after the other. A number that is the same on all bodies
stays one; one that differs, such as the reference of the state, is repeated a place.
Laws that differ in anything else, such as two functions of time, stay apart.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import is_traced
from .term import AbstractFluxLaw


Moments = tuple[AbstractFluxLaw, ...]
"""One law at all moments, alike but for its numbers."""


def _own(values: Any) -> Any:
    return jnp if is_traced(values) else np


def _same(one: Any, other: Any) -> bool:
    """Whether two leaves are known to be equal."""
    if one is other:
        return True
    if is_traced((one, other)):
        return False
    if callable(one) or callable(other):
        return bool(one == other)
    return np.array_equal(one, other)


def _each_place(law: AbstractFluxLaw) -> list[bool]:
    """Of every leaf, whether it holds a value a place: it grows with the places."""
    grown = law.coarsened(lambda values: _own(values).concatenate([values, values], -1))
    pairs = zip(jax.tree.leaves(law), jax.tree.leaves(grown), strict=True)
    return [np.shape(leaf) != np.shape(more) for leaf, more in pairs]


def _rows(laws: Sequence[Moments]) -> list[list[list[Any]]]:
    """Of every leaf, of every moment, those of all laws."""
    leaves = [[jax.tree.leaves(law) for law in moments] for moments in laws]
    return [
        [[law[m][k] for law in leaves] for m in range(len(leaves[0]))]
        for k in range(len(leaves[0][0]))
    ]


def _differs(row: list[list[Any]]) -> bool:
    """Whether a leaf is another one on another body at any moment."""
    return not all(_same(now[0], leaf) for now in row for leaf in now)


def can_join(laws: Sequence[Moments]) -> bool:
    """Whether laws on several bodies make one."""
    if len({jax.tree.structure(law) for moments in laws for law in moments}) > 1:
        return False
    return all(
        each_place or not _differs(row) or all(map(_is_number, row[0]))
        for each_place, row in zip(_each_place(laws[0][0]), _rows(laws), strict=True)
    )


def _is_number(leaf: Any) -> bool:
    return not callable(leaf) and np.shape(leaf) == ()


def join_laws(laws: Sequence[Moments | None], places: Sequence[int]) -> Moments:
    """The joined law at every moment.

    Args:
        laws: of every body; None where the term does not act.
        places: how many each body has.
    """
    present = [moments for moments in laws if moments is not None]
    first = present[0]
    each_place = _each_place(first[0])
    varies = [_differs(row) for row in _rows(present)]
    kinds = list(zip(each_place, varies, strict=True))
    return tuple(
        _join(
            [None if moments is None else moments[m] for moments in laws], places, kinds
        )
        for m in range(len(first))
    )


def _join(laws, places, kinds) -> AbstractFluxLaw:
    """Of one moment; `kinds`: whether a leaf has a value a place, and differs."""
    first = next(law for law in laws if law is not None)
    starts = np.cumsum([0, *places[:-1]]).tolist()
    spread = [
        jax.tree.leaves(law.coarsened(lambda v, at=at: _placed(v, at, sum(places))))
        for law, at in zip(laws, starts, strict=True)
        if law is not None
    ]
    joined = []
    for k, (each_place, varies) in enumerate(kinds):
        # A law that does not act takes the numbers of one that does, which are valid.
        leaves = [jax.tree.leaves(law or first)[k] for law in laws]
        if each_place:
            joined.append(sum(leaf[k] for leaf in spread))
        elif varies:
            joined.append(_repeated(leaves, places))
        else:
            joined.append(leaves[0])
    return jax.tree.unflatten(jax.tree.structure(first), joined)


def _placed(values: Any, at: int, places: int) -> Any:
    """Values on the last axis from place `at` on, and 0 at all others."""
    widths = [(0, 0)] * (np.ndim(values) - 1)
    return _own(values).pad(values, [*widths, (at, places - at - values.shape[-1])])


def _repeated(leaves, places):
    own, pairs = _own(leaves), zip(leaves, places, strict=True)
    return own.concatenate([own.broadcast_to(leaf, (n,)) for leaf, n in pairs])
