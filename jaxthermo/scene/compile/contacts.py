"""Where bodies touch: found at every moment, kept in arrays of one size."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...geometry.pose import Pose
from ...physics.contact.bodies import PlacedGrid
from ...physics.contact.links import Contact, ContactLinks
from ...physics.contact.pairs import ContactPairs, no_pairs
from ...physics.contact.search import contacts_between
from ...physics.term import AbstractTerm
from ...physics.time_varying import for_jit, is_zero
from ..receipt import Omission
from ..scene import Scene
from .bodies import PreparedBody


Key = tuple[int, int, int]
"""Number of the term, and of both bodies."""


class Touching(NamedTuple):
    """What touches what at one moment."""

    pairs: dict[Key, ContactPairs]
    covered: tuple[Float[np.ndarray, " s"], ...]
    """Of each body, the share of every fragment that something touches."""
    omitted: tuple[Omission, ...]


def find_contacts(
    scene: Scene, poses: tuple[Pose, ...], names: tuple[str, ...]
) -> Touching:
    """The pairs of fragments that every `Contact` joins.

    Args:
        scene: bodies and terms.
        poses: of the bodies at this moment.
        names: of the terms.

    Raises:
        InputError: if bodies overlap deeply, or two terms join the same ones.
    """
    terms = [
        (n, term) for n, term in enumerate(scene.terms) if isinstance(term, Contact)
    ]
    covered = [np.zeros(len(b.structure.grid.fragment_area)) for b in scene.bodies]
    if not terms or len(scene.bodies) == 1:
        why = "there is one body"
        return Touching(
            {}, tuple(covered), tuple(Omission(names[n], why) for n, _ in terms)
        )
    placed = tuple(
        PlacedGrid(body.structure.grid, pose, f"body {index}")
        for index, (body, pose) in enumerate(zip(scene.bodies, poses, strict=True))
    )
    pairs: dict[Key, ContactPairs] = {}
    omitted = []
    for number, term in terms:
        touching = contacts_between(placed, term.threshold)
        found = {key: each for key, each in touching.items() if term.connects(*key)}
        if not found:
            omitted.append(Omission(names[number], "no bodies touch"))
        elif is_zero(term.conductance):
            omitted.append(Omission(names[number], "its conductance is 0"))
        for (one, other), each in found.items():
            _refuse_twice(pairs, number, one, other)
            if not is_zero(term.conductance):
                pairs[number, one, other] = each
            covered[one] = covered[one] + each.coverage_a
            covered[other] = covered[other] + each.coverage_b
    return Touching(
        pairs, tuple(np.minimum(share, 1) for share in covered), tuple(omitted)
    )


def _refuse_twice(pairs: dict[Key, ContactPairs], number: int, one: int, other: int):
    for before in pairs:
        if before[1:] == (one, other):
            raise InputError(
                f"terms[{before[0]}] and terms[{number}] both join bodies {one} and "
                f"{other}: say which bodies each joins"
            )


def touching_sizes(snapshots: list[Touching]) -> dict[Key, int]:
    """The most pairs at any moment, of all bodies that ever touch."""
    sizes: dict[Key, int] = {}
    for snapshot in snapshots:
        for key, pairs in snapshot.pairs.items():
            sizes[key] = max(sizes.get(key, 0), len(pairs.area))
    return {key: sizes[key] for key in sorted(sizes)}


def contact_links(
    term: AbstractTerm,
    prepared: tuple[PreparedBody, ...],
    touching: Touching,
    key: Key,
    size: int,
    entry: int,
    dtype: Any,
) -> ContactLinks:
    """Two bodies' contact, in arrays of one size.

    Args:
        term: that joins them.
        prepared: all bodies.
        touching: what touches at this moment.
        key: of the term and the bodies.
        size: of the arrays.
        entry: in the ledger.
        dtype: of the state.
    """
    assert isinstance(term, Contact)
    names = f"bodies {key[1]} and {key[2]}"
    first, second = prepared[key[1]], prepared[key[2]]
    found = touching.pairs.get(key)
    if found is None:
        found = no_pairs(len(first.fragment_node), len(second.fragment_node))
    pairs = found.padded(term.max_pairs or size, names)
    ends = [
        _end(one, fragment, pairs.area, dtype)
        for one, fragment in ((first, pairs.fragment_a), (second, pairs.fragment_b))
    ]
    address, half_cell, per_capacity, share = zip(*ends, strict=True)
    return ContactLinks(
        entry=entry,
        bodies=(key[1], key[2]),
        address=address,
        fragment=(jnp.asarray(pairs.fragment_a), jnp.asarray(pairs.fragment_b)),
        half_cell=half_cell,
        per_capacity=per_capacity,
        area_fraction=share,
        area=jnp.asarray(pairs.area * term.gap_factor(pairs.gap), dtype),
        conductance=for_jit(term.conductance, dtype),
    )


def _end(one: PreparedBody, fragment: np.ndarray, area: np.ndarray, dtype: Any):
    """Address, half cell, 1 / capacity and share of the pairs' fragments."""
    node = one.fragment_node[fragment]
    address = tuple(jnp.asarray(index[node]) for index in one.address)
    share = (area / one.body.structure.grid.fragment_area[fragment]).astype(dtype)
    capacity = one.network.capacity_at(address)
    if not capacity.ndim:
        capacity = jnp.broadcast_to(capacity, share.shape)
    half_cell = one.half_cell[fragment] * share
    return address, jnp.asarray(half_cell), 1 / capacity, jnp.asarray(share)
