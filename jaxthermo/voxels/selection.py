"""Selections of a body's surface or space that a term or a material applies to."""

import abc
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, overload

import equinox as eqx
import numpy as np
from equinox import AbstractVar
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from ..arrays import plain_numbers, static_numbers
from ..choices import FaceName
from ..errors import InputError
from ..geometry.vectors import unit_vector
from .spread_points import spread_points


# Boxes that the border of a selection divides and that are sampled at once.
_AT_ONCE = 2**10

FACES = ("front", "back")
"""Faces of a sheet by number; the front is on the side of the normals."""


class FragmentCentres(NamedTuple):
    """Surface fragments of one body (in the body's frame)."""

    position: Float[np.ndarray, "s 3"]
    """Centres [m]."""
    normal: Float[np.ndarray, "s 3"]
    """Outward unit normals."""
    face: Int[np.ndarray, " s"] | None = None
    """Number in `FACES` of the side of a thin wall; None for a solid."""


class SurfaceSamples(NamedTuple):
    """Points on some of the surface fragments of a body (in the body's frame)."""

    fragments: FragmentCentres
    """All fragments."""
    fragment: Int[np.ndarray, " m"]
    """Numbers of the fragments that the points are on."""
    points: Float[np.ndarray, "p m 3"]
    """Several points on each of these fragments [m]."""


class AbstractSelection(eqx.Module):
    """Part of the surface of one body or of several, as an argument `on=`.

    Selections combine: `a & b` is what both select, `a | b` what either does, and `~a`
    the rest of the bodies that `a` is on.
    """

    @property
    @abc.abstractmethod
    def bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that it is on, in increasing order."""

    @abc.abstractmethod
    def on_body(self, body: int) -> "AbstractSelection | None":
        """Its part on one body, None if it is not on that body."""

    @abc.abstractmethod
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        """Flag the selected surface fragments of one body."""

    @property
    def has_names(self) -> bool:
        """True if it names bodies, whose numbers only a scene knows."""
        return False

    @property
    def is_geometric(self) -> bool:
        """True if points and normals suffice, False if it depends on fragments."""
        return True

    def named(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        """Flag the fragments among the selected ones that it names by themselves.

        Others are selected by their position and normal alone.
        """
        return np.full(len(fragments.position), not self.is_geometric)

    def divides(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """Flag the boxes, by their corners, that its border may divide.

        False for a selection that depends on the normal or on the fragment alone.
        """
        del high
        return np.zeros(len(low), bool)

    def contains_samples(self, samples: SurfaceSamples) -> Bool[np.ndarray, "#p m"]:
        """Flag the selected points of fragments."""
        return self.select(samples.fragments)[samples.fragment][None]

    def __and__(self, selection: "AbstractSelection") -> "AbstractSelection":
        return combined("&", (self, selection))

    def __or__(self, selection: "AbstractSelection") -> "AbstractSelection":
        return combined("|", (self, selection))

    def __invert__(self) -> "AbstractSelection":
        return combined("~", (self,))


class AbstractSpace(AbstractSelection):
    """Part of space, which selects the surface and the interior in it.

    A combination of parts of space is one too.
    """

    @abc.abstractmethod
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Flag the points (in the body's frame) that lie in it."""

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        return self.contains(fragments.position)

    @override
    def divides(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        # Corners and the middles between them: a part of space without a rule of its
        # own is not smaller than half a box.
        steps = np.indices((3, 3, 3)).reshape(3, -1).T / 2
        flags = np.stack([self.contains(low + step * (high - low)) for step in steps])
        return np.asarray(flags.any(axis=0) & ~flags.all(axis=0))

    @override
    def contains_samples(self, samples: SurfaceSamples) -> Bool[np.ndarray, "#p m"]:
        points = samples.points
        return self.contains(points.reshape(-1, 3)).reshape(points.shape[:2])

    def fraction_of_boxes(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        """Fraction of each box, by its corners [m], that lies in it [-]."""
        fraction = self.contains((low + high) / 2).astype(float)
        divided = np.flatnonzero(self.divides(low, high))
        samples = spread_points(3)[:, None]
        for start in range(0, len(divided), _AT_ONCE):
            chunk = divided[start : start + _AT_ONCE]
            points = low[chunk] + samples * (high - low)[chunk]
            inside = self.contains(points.reshape(-1, 3))
            fraction[chunk] = inside.reshape(len(samples), -1).mean(axis=0)
        return fraction

    # Editors then know that `within` takes a combination of parts of space.
    @overload
    def __and__(self, selection: "AbstractSpace") -> "AbstractSpace": ...
    @overload
    def __and__(self, selection: AbstractSelection) -> AbstractSelection: ...
    @override
    def __and__(self, selection: AbstractSelection) -> AbstractSelection:
        return super().__and__(selection)

    @overload
    def __or__(self, selection: "AbstractSpace") -> "AbstractSpace": ...
    @overload
    def __or__(self, selection: AbstractSelection) -> AbstractSelection: ...
    @override
    def __or__(self, selection: AbstractSelection) -> AbstractSelection:
        return super().__or__(selection)

    @override
    def __invert__(self) -> "AbstractSpace":
        return _CombinedSpace(rule="~", operands=(self,))


def known_number(body: int | str) -> int:
    """Number of a body, whose name a scene has replaced."""
    assert isinstance(body, int)
    return body


class AbstractOnOneBody(AbstractSelection):
    """Selection on a single body, or on all whose names match a pattern."""

    # A property, not an `AbstractVar`, which editors take for the first argument.
    @property
    @abc.abstractmethod
    def body(self) -> int | str:
        """Number of the body in the scene, or a pattern of names as in `assembly`."""

    def numbered(self, body: int) -> "AbstractOnOneBody":
        """The selection on the body of a number."""
        return replace(self, body=body)

    @property
    @override
    def bodies(self) -> tuple[int, ...]:
        return () if isinstance(self.body, str) else (self.body,)

    @property
    @override
    def has_names(self) -> bool:
        return isinstance(self.body, str)

    @override
    def on_body(self, body: int) -> AbstractSelection | None:
        return self if body == self.body else None


class Side(AbstractOnOneBody):
    """Fragments of a body whose normal is within `half_angle` [rad] of `normal`."""

    normal: tuple[float, float, float] = eqx.field(static=True, converter=plain_numbers)
    body: int | str = static_numbers(0)
    half_angle: float = static_numbers(float(np.pi / 4))

    def __check_init__(self):
        unit_vector(self.normal, "Side(normal=)")
        number = isinstance(self.half_angle, float | int)
        if not number or not 0 < self.half_angle <= np.pi:
            raise InputError(
                f"Side(half_angle={self.half_angle!r}): give radians in (0, pi]"
            )

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        # Tolerance for normals exactly at the half angle, as on a cube or an octagon.
        cosine = fragments.normal @ unit_vector(self.normal)
        return np.greater(cosine, np.cos(self.half_angle) - 1e-9)


class Face(AbstractOnOneBody):
    """One of the two faces of a sheet: "front", on the side of the normals, or "back".

    Example:
        >>> import jaxthermo as jt
        >>> steel = jt.Material(45.0, 7850.0, specific_heat=480.0)
        >>> panel = jt.shapes.rectangle(1.0, 0.5)
        >>> sheet = jt.Sheet(panel, (jt.Layer(steel, 0.8e-3),), pitch=0.05)
        >>> dry = jt.Convection(5.0, 293.0, on=jt.Face("back"))
        >>> windy = jt.Convection(20.0, 283.0, on=~jt.Face("back"))
    """

    name: FaceName = eqx.field(static=True)
    """"front" or "back"."""
    body: int | str = static_numbers(0)

    def __check_init__(self):
        if self.name not in FACES:
            raise InputError(f'Face({self.name!r}): give "front" or "back"')

    @property
    @override
    def is_geometric(self) -> bool:
        return False

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        if fragments.face is None:
            raise InputError(
                f"Face({self.name!r}): body {self.body} is solid and has no face of "
                "that name, only a sheet has: select a Side(normal)"
            )
        return np.equal(fragments.face, FACES.index(self.name))


class Region(AbstractOnOneBody, AbstractSpace):
    """Part of a body inside a box with corners `lower` and `upper` [m]."""

    lower: tuple[float, float, float] = eqx.field(static=True, converter=plain_numbers)
    upper: tuple[float, float, float] = eqx.field(static=True, converter=plain_numbers)
    body: int | str = static_numbers(0)

    def __check_init__(self):
        try:
            corners = np.asarray((self.lower, self.upper), float)
        except (TypeError, ValueError):
            corners = np.zeros(0)
        # Negated, so that NaN is refused too.
        if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
            raise InputError(
                f"Region(lower={self.lower!r}, upper={self.upper!r}): give two corners "
                "of three numbers; each lower one must be below its upper one"
            )

    @property
    def _tolerance(self) -> float:
        # Of positions in float32, so that what is flush with a face lies in it.
        return 1e-6 * float(np.abs([self.lower, self.upper]).max())

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        lower = np.subtract(self.lower, self._tolerance)
        upper = np.add(self.upper, self._tolerance)
        return np.all((points >= lower) & (points <= upper), axis=1)

    @override
    def divides(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        tolerance = self._tolerance
        lower = np.asarray(self.lower)
        upper = np.asarray(self.upper)
        within = (low >= lower - tolerance) & (high <= upper + tolerance)
        beyond = (high <= lower + tolerance) | (low >= upper - tolerance)
        return np.asarray(~within.all(axis=1) & ~(beyond & ~within).any(axis=1))

    @override
    def fraction_of_boxes(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        common = np.minimum(high, self.upper) - np.maximum(low, self.lower)
        return np.prod(np.maximum(common, 0) / (high - low), axis=1)


class Everything(AbstractOnOneBody, AbstractSpace):
    """Whole body."""

    body: int | str = static_numbers(0)

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return np.ones(len(points), bool)

    @override
    def divides(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        del high
        return np.zeros(len(low), bool)


_RULES: dict[str, Callable[[Sequence[np.ndarray]], Any]] = {
    "&": np.logical_and.reduce,
    "|": np.logical_or.reduce,
    "~": lambda flags: ~flags[0],
}
# Flags of a combination, from those of its parts.


class AbstractCombination(AbstractSelection):
    """Combination of selections by one of the rules."""

    rule: AbstractVar[str]
    operands: AbstractVar[tuple[AbstractSelection, ...]]

    @property
    @override
    def bodies(self) -> tuple[int, ...]:
        operand_bodies = [set(operand.bodies) for operand in self.operands]
        together = set.intersection if self.rule == "&" else set.union
        return tuple(sorted(together(*operand_bodies)))

    @property
    @override
    def has_names(self) -> bool:
        return any(operand.has_names for operand in self.operands)

    @override
    def on_body(self, body: int) -> AbstractSelection | None:
        if body not in self.bodies:
            return None
        parts = [operand.on_body(body) for operand in self.operands]
        operands = tuple(part for part in parts if part is not None)
        if len(operands) == 1 and self.rule != "~":
            return operands[0]
        return combined(self.rule, operands)

    @override
    def divides(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        flags = [operand.divides(low, high) for operand in self.operands]
        return np.logical_or.reduce(flags)

    @property
    @override
    def is_geometric(self) -> bool:
        return all(operand.is_geometric for operand in self.operands)

    @override
    def named(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        if self.rule != "|":
            return super().named(fragments)
        flags = [
            operand.named(fragments) & operand.select(fragments)
            for operand in self.operands
        ]
        return np.logical_or.reduce(flags)

    @override
    def contains_samples(self, samples: SurfaceSamples) -> Bool[np.ndarray, "#p m"]:
        flags = [operand.contains_samples(samples) for operand in self.operands]
        return _RULES[self.rule](np.broadcast_arrays(*flags))

    def __repr__(self) -> str:
        texts = [repr(operand) for operand in self.operands]
        if self.rule == "~":
            return f"~{texts[0]}"
        return f"({f' {self.rule} '.join(texts)})"


class _CombinedSurface(AbstractCombination):
    """Combination of which a part depends on the normal or on single fragments."""

    rule: str = eqx.field(static=True)
    operands: tuple[AbstractSelection, ...]

    @override
    def select(self, fragments: FragmentCentres) -> Bool[np.ndarray, " s"]:
        flags = [operand.select(fragments) for operand in self.operands]
        return _RULES[self.rule](flags)


class _CombinedSpace(AbstractCombination, AbstractSpace):
    """Combination of parts of space."""

    rule: str = eqx.field(static=True)
    operands: tuple[AbstractSpace, ...]

    @override
    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        return _RULES[self.rule](
            [operand.contains(points) for operand in self.operands]
        )

    @override
    def fraction_of_boxes(
        self, low: Float[np.ndarray, "n 3"], high: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, " n"]:
        if self.rule == "~":
            return 1 - self.operands[0].fraction_of_boxes(low, high)
        return super().fraction_of_boxes(low, high)


def combined(rule: str, operands: tuple[Any, ...]) -> AbstractSelection:
    """A combination of selections.

    Raises:
        InputError: for anything else, or parts of different bodies in common.
    """
    for operand in operands:
        if not isinstance(operand, AbstractSelection):
            raise InputError(
                f"a selection with {rule} {operand!r}: combine selections only, such "
                "as Side(normal) & Region(lower, upper)"
            )
    combination_class = _CombinedSurface
    if all(isinstance(operand, AbstractSpace) for operand in operands):
        combination_class = _CombinedSpace
    combination = combination_class(rule=rule, operands=operands)
    if not combination.has_names and not combination.bodies:
        raise InputError(
            f"{combination!r}: its parts are on different bodies and have nothing in "
            "common: give both the same `body`, or join them by |"
        )
    return combination
