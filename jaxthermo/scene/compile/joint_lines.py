"""Joints of a scene: lines on what they join, and a check that they join something."""

import math
from collections.abc import Sequence

import numpy as np

from ...arrays import is_traced
from ...errors import InputError
from ...physics.contact.joint import AbstractJoint
from ..receipt_model import Part
from ..scene import Scene, mechanism_names
from .contacts import APART
from .snapshots import Snapshot


def joint_lines(scene: Scene, parts: Sequence[Part]) -> tuple[str, ...]:
    """A line for each pair of bodies that a joint lets conduct, as at the start."""
    named = zip(mechanism_names(scene), scene.terms, strict=True)
    joints = {name: term for name, term in named if isinstance(term, AbstractJoint)}
    lines = []
    for part in parts:
        term = joints.get(part.mechanism)
        if term is None:
            continue
        extent = (
            f"along {part.length:.4g} m"
            if part.length
            else f"through {part.area:.4g} m2"
        )
        first, second = part.bodies
        lines.append(
            f"{part.mechanism}: bodies {first} and {second} conduct {extent}"
            f"{_conductance(term)}"
        )
    return tuple(lines)


def _conductance(term: AbstractJoint) -> str:
    h_c = term.conductance
    if callable(h_c):
        return ", with a conductance that varies"
    if is_traced(h_c):
        return ""
    value = float(np.asarray(h_c))
    return ", bonded" if math.isinf(value) else f", with {value:.4g} W/(m2 K)"


def check_joints(scene: Scene, snapshots: Sequence[Snapshot]) -> None:
    """Refuse joints of named bodies that are apart, in a scene in which nothing moves.

    Raises:
        InputError: naming the bodies.
    """
    if len(snapshots) > 1:
        # What moves may come together after the end of a run.
        return
    (snapshot,) = snapshots
    apart = {number for number, why in snapshot.unpaired if why == APART}
    # A contact and a seam of the same bodies are one joint of what touches in one way.
    joined = {
        term.bodies
        for number, term in enumerate(scene.terms)
        if isinstance(term, AbstractJoint) and number not in apart
    }
    for number, term in enumerate(scene.terms):
        if number not in apart or not isinstance(term, AbstractJoint):
            continue
        if term.must_join and term.bodies not in joined:
            first, second = term.groups
            # Without the number of the term: rules under `joints` have other numbers.
            raise InputError(
                f"{term.name}: {_listed(first)} and {_listed(second)} are apart: move "
                "them together, give a larger `threshold`, or leave this joint out"
            )


_MAX_LISTED = 3


def _listed(bodies: Sequence[int]) -> str:
    listed = ", ".join(f"body {number}" for number in bodies[:_MAX_LISTED])
    more = len(bodies) - _MAX_LISTED
    return listed if more <= 0 else f"{listed} and {more:,} more"
