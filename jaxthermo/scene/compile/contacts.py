"""Contacts of the bodies of a scene at one moment, by the terms that join them."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...memo.found import found
from ...physics.contact.joint import AbstractJoint
from ...physics.contact.rays import PlacedGrid
from ...physics.contact.seam_search import SeamPairs
from ...physics.contact.search import ContactPairs
from ...physics.term import AbstractPairTerm
from ..scene import Scene


PairKey = tuple[int, int, int]
"""Numbers of a term and of both its bodies."""

TouchingPairs = ContactPairs | SeamPairs
"""Fragments of two bodies that touch."""

APART = "no bodies touch"
"""Why a pair term does not act where its bodies are apart."""


class Contacts(NamedTuple):
    """Contacts of the bodies at one moment."""

    pairs: dict[PairKey, TouchingPairs]
    """Touching fragments of each pair of bodies."""
    covered: list[Float[np.ndarray, " _"] | None]
    """Covered fraction of each body's fragments; None for a body nothing touches."""
    unpaired: tuple[tuple[int, str], ...]
    """Pair terms that do not act, by their number, and why."""


def find_contacts(scene: Scene, placed: tuple[PlacedGrid, ...]) -> Contacts:
    """Contacts of each pair of bodies that a term joins.

    Raises:
        InputError: if bodies overlap deeply, or two terms join the same ones.
    """
    terms = [
        (n, term)
        for n, term in enumerate(scene.terms)
        if isinstance(term, AbstractPairTerm)
    ]
    # Where another body covers a fragment, no other term acts.
    covered: list[Any] = [None for _ in scene.bodies]
    if not terms or len(scene.bodies) == 1:
        omitted = tuple((n, "there is one body") for n, _ in terms)
        return Contacts(pairs={}, covered=covered, unpaired=omitted)
    pairs: dict[PairKey, TouchingPairs] = {}
    joined_by: dict[tuple[str, int, int], int] = {}
    omitted = []
    for number, term in terms:
        touches = _touching(placed, term)
        joined = {key: pair for key, pair in touches.items() if term.connects(*key)}
        if not joined:
            omitted.append((number, APART))
        # An idle pair still covers the surface: it insulates it.
        elif term.is_idle:
            omitted.append((number, "its conductance is 0"))
        for (first, second), touching in joined.items():
            earlier = joined_by.setdefault((term.name, first, second), number)
            if earlier != number:
                _check_hidden(scene, earlier, number, bodies=(first, second))
                continue
            if not term.is_idle:
                pairs[number, first, second] = touching
            if isinstance(touching, SeamPairs):
                # A seam is beside the faces.
                continue
            for body, coverage in (
                (first, touching.coverage_a),
                (second, touching.coverage_b),
            ):
                covered_so_far = 0 if covered[body] is None else covered[body]
                covered[body] = np.minimum(covered_so_far + coverage, 1)
    return Contacts(pairs=pairs, covered=covered, unpaired=tuple(omitted))


def _check_hidden(
    scene: Scene, first: int, second: int, bodies: tuple[int, int]
) -> None:
    """Refuse a joint of bodies that an earlier one joins, unless it joins others too.

    Raises:
        InputError: naming both terms and two of the bodies.
    """
    earlier = scene.terms[first]
    later = scene.terms[second]
    if not isinstance(earlier, AbstractJoint) or not isinstance(later, AbstractJoint):
        return
    if earlier.hides(later):
        raise InputError(
            f"terms[{first}] and terms[{second}] both join bodies {bodies[0]} and "
            f"{bodies[1]}: say which bodies each joins, the fewer first"
        )


# Contacts depend on voxels and poses alone: they are computed once for all runs, and
# again for pairs of which one has moved.
def _touching(
    placed: tuple[PlacedGrid, ...], term: AbstractPairTerm
) -> dict[tuple[int, int], TouchingPairs]:
    gap = None if term.max_gap is None else float(term.max_gap)
    return found(
        tuple(body.grid for body in placed),
        by=(f"{term.name}s", tuple(body.pose.key for body in placed), gap),
        find=lambda: term.touching(placed),
    )
