"""Joints: terms that let bodies that touch conduct into each other."""

import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from typing_extensions import override

from ...arrays import TimeVarying
from ...errors import InputError
from ...voxels.selection import known_number
from ..term import AbstractPairTerm
from ..time_varying import check_value, is_zero


BodyNumbers = int | str | tuple[int | str, ...]
"""Number of a body, or of several; in place of numbers, patterns of names."""
Groups = tuple[tuple[int, ...], tuple[int, ...]]
"""Numbers of the bodies on either side."""


class AbstractJoint(AbstractPairTerm):
    """Conductance of an area between two bodies that touch, or between groups."""

    conductance: eqx.AbstractVar[TimeVarying]
    """h_c [W/(m^2 K)], a number or a function of time; infinity bonds the bodies."""
    bodies: eqx.AbstractVar[tuple[BodyNumbers, BodyNumbers] | None]
    """Numbers or names of two bodies, or of the bodies of two groups; None for all."""
    threshold: eqx.AbstractVar[float | None]
    """Largest gap over which bodies count as touching [m]; None for a default."""

    def check_joint(self, lengths: Mapping[str, Any]) -> None:
        """Check the conductance, the bodies and lengths by name [m].

        Raises:
            InputError: for a value that is wrong.
        """
        name = type(self).__name__
        h_c = self.conductance
        if not isinstance(h_c, float | int) or h_c != math.inf:
            check_value(h_c, f"{name}(conductance [W/(m^2 K)])", 0.0)
        for argument, length in lengths.items():
            if length is not None and not 0 < length < np.inf:
                raise InputError(
                    f"{name}({argument}={length!r}): give a positive length"
                )
        if self.bodies is None:
            return
        if not isinstance(self.bodies, tuple) or len(self.bodies) != 2:
            raise InputError(
                f"{name}(bodies={self.bodies!r}): give two, as in bodies=(0, 1)"
            )
        if any(map(_has_names, self.bodies)):
            return
        first, second = self.groups
        is_pair = first and second and len({*first, *second}) > 1
        if not is_pair:
            raise InputError(f"{name}(bodies={self.bodies}): name two bodies")

    @property
    @override
    def max_gap(self) -> float | None:
        return self.threshold

    @property
    @override
    def is_idle(self) -> bool:
        return is_zero(self.conductance)

    @property
    def groups(self) -> Groups:
        """Numbers of the bodies on either side; empty for all bodies.

        A scene has replaced their names.
        """
        if self.bodies is None:
            return (), ()
        first, second = self.bodies
        return _numbers(first), _numbers(second)

    @property
    @override
    def named_bodies(self) -> tuple[int, ...]:
        first, second = self.groups
        return (*first, *second)

    @property
    def must_join(self) -> bool:
        """True if it is a mistake that none of its bodies touch."""
        # One group with itself is a rule for all its bodies, as None is.
        first, second = self.groups
        return {*first} != {*second}

    def hides(self, later: "AbstractJoint") -> bool:
        """True if a later joint joins no bodies that this one does not join."""
        first, second = self.groups
        sides = {*first}, {*second}
        others = [{*group} for group in later.groups]
        is_within = sides[0] >= others[0] and sides[1] >= others[1]
        is_within |= sides[0] >= others[1] and sides[1] >= others[0]
        return self.bodies is None or (later.bodies is not None and is_within)

    @override
    def connects(self, a: int, b: int) -> bool:
        if self.bodies is None:
            return True
        first, second = self.groups
        return (a in first and b in second) or (b in first and a in second)


def _has_names(bodies: BodyNumbers) -> bool:
    members = bodies if isinstance(bodies, tuple) else (bodies,)
    return any(isinstance(member, str) for member in members)


def _numbers(bodies: BodyNumbers) -> tuple[int, ...]:
    members = bodies if isinstance(bodies, tuple) else (bodies,)
    return tuple(known_number(member) for member in members)
