"""From every body's own load to one of all bodies, alike at all moments."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...arrays import is_traced
from ...physics.join_laws import Moments, can_join, join_laws
from ...physics.newton_iteration_bound import ALL_STEPS
from ...physics.surface_energy_balance import SurfaceTerms
from ...physics.term import BoundTerm
from .joined import JoinedLoad
from .surface_load import SurfaceLoad


class _Joint(NamedTuple):
    """One term of the joined load: by body, its entry and its terms at all moments."""

    name: str
    entry: dict[int, int]
    terms: dict[int, tuple[BoundTerm, ...]]


def _laws(terms: tuple[BoundTerm, ...]) -> Moments:
    return tuple(term.law for term in terms)


def join_loads(moments: Sequence[tuple[SurfaceLoad, ...]]) -> list[JoinedLoad]:
    """The load of all bodies at every moment.

    Args:
        moments: loads of the bodies that have one, at every moment.
    """
    first = moments[0]
    places = tuple(len(load.node) for load in first)
    free = _joints(moments, lambda terms: terms.natural)
    held = _joints(moments, lambda terms: terms.prescribed)
    joints, steps = [*free, *held], _steps(first)
    bound = [_bound(joint, places) for joint in joints]
    each = [
        tuple(joint.entry.get(body, -1) for body in range(len(places)))
        for joint in joints
    ]
    # Those of the same entries, such as sky and ground, have one number.
    entries = tuple(dict.fromkeys(each))
    numbers = [entries.index(own) for own in each]
    made = []
    for m, loads in enumerate(moments):
        numbered = tuple((k, t[m]) for k, t in zip(numbers, bound, strict=True))
        terms = SurfaceTerms(
            names=tuple(joints[numbers.index(k)].name for k in range(len(entries))),
            half_cell=_concatenate([load.terms.half_cell for load in loads]),
            natural=numbered[: len(free)],
            prescribed=numbered[len(free) :],
            steps=steps,
        )
        made.append(JoinedLoad(terms, entries, places))
    return made


def _joints(moments, pick) -> list[_Joint]:
    """Terms of one mechanism and law on several bodies, each body's in their order."""
    joints: list[_Joint] = []
    for body, loads in enumerate(zip(*moments, strict=True)):
        for each in zip(*(pick(load.terms) for load in loads), strict=True):
            entry, terms = each[0][0], tuple(term for _, term in each)
            name = loads[0].terms.names[entry]
            fitting = (
                joint
                for joint in joints
                if joint.name == name
                and body not in joint.terms
                and can_join([*map(_laws, joint.terms.values()), _laws(terms)])
            )
            joint = next(fitting, None)
            if joint is None:
                joint = _Joint(name, {}, {})
                joints.append(joint)
            joint.entry[body], joint.terms[body] = entry, terms
    return joints


def _bound(joint: _Joint, places: tuple[int, ...]) -> list[BoundTerm]:
    """The joined term at every moment."""
    own = [joint.terms.get(body) for body in range(len(places))]
    laws = join_laws([None if each is None else _laws(each) for each in own], places)
    dtype = next(iter(joint.terms.values()))[0].effective_area.dtype
    nothing = [np.zeros(count, dtype) for count in places]
    none = np.zeros((), dtype)
    pairs = list(zip(own, nothing, strict=True))
    return [
        BoundTerm(
            effective_area=_concatenate(
                [t[m].effective_area if t else no for t, no in pairs]
            ),
            total_effective_area=_stack(
                [t[m].total_effective_area if t else none for t in own]
            ),
            law=law,
        )
        for m, law in enumerate(laws)
    ]


def _steps(loads: tuple[SurfaceLoad, ...]) -> int:
    """Of Newton's method, the most that any body needs; linear laws need none."""
    bent = [load.terms.steps for load in loads if not load.terms.is_linear]
    return max(bent, default=ALL_STEPS)


def _concatenate(values: list[Any]) -> Any:
    return (jnp if is_traced(values) else np).concatenate(values)


def _stack(values: list[Any]) -> Any:
    return (jnp if is_traced(values) else np).stack(values)
