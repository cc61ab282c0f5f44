"""Joints between bodies that touch, by rules of their names."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

import jaxthermo

from ...geometry.part_names import matching_parts, unmatched_name
from ..types.model import Location, Mistake, Model
from ..types.quantities import ContactConductance, PositiveLength, Two
from ..types.varying import TimeConductance, without_resistance
from .selection import Patterns


class _PairConfig(Model):
    """Joints of some parts with some others; the first rule that matches counts."""

    parts: Annotated[tuple[Patterns, Patterns], Two]
    """Names of two bodies, or a pattern or list of patterns for either side."""
    conductance: TimeConductance
    """Conductance of the area in contact; 0 insulates it, `bonded` is no resistance."""
    threshold: PositiveLength | None = None
    """Largest gap of a joint [m], instead of that of all joints."""


def _word_or_number(value: Any) -> str:
    return (
        "<word>"
        if isinstance(value, str) and value in ("bonded", "none")
        else "<number>"
    )


class JointsConfig(Model):
    """Conduction between bodies that touch, or that share the border of a sheet."""

    default: Annotated[
        Annotated[Literal["bonded", "none"], Tag("<word>")]
        | Annotated[ContactConductance, Tag("<number>")],
        Discriminator(_word_or_number),
    ] = "none"
    """Conductance of all joints without a rule; `none` leaves these bodies apart."""
    pairs: tuple[_PairConfig, ...] = ()
    """Rules for some joints."""
    threshold: PositiveLength | None = None
    """Largest gap of a joint [m]; a cell of the finer body if not given, and a tenth of
    one at the border of a sheet."""

    def wrong_names(self, names: Mapping[str, int]) -> Iterator[Mistake]:
        """Patterns that match no name of a body."""
        for number, pair in enumerate(self.pairs):
            where: Location = ("pairs", number, "parts")
            for side, patterns in enumerate(pair.parts):
                for pattern in patterns:
                    if not matching_parts(pattern, names):
                        yield (*where, side), unmatched_name(pattern, list(names))
            sides = [set(_numbers(side, names)) for side in pair.parts]
            # A side without a body has its own mistake.
            if all(sides) and len(set.union(*sides)) == 1:
                yield where, "is one body twice: name two bodies"

    def build_terms(
        self, names: Mapping[str, int], has_sheets: bool
    ) -> tuple[Any, ...]:
        """The terms of all rules: contacts of faces, and seams at borders of sheets.

        Args:
            names: number of each body by its name.
            has_sheets: True if a body is a sheet.
        """
        rules: list[tuple[Any, Any, float | None]] = []
        for pair in self.pairs:
            first, second = (_numbers(patterns, names) for patterns in pair.parts)
            threshold = self.threshold if pair.threshold is None else pair.threshold
            rules.append(((first, second), pair.conductance, threshold))
        if self.default != "none":
            rules.append((None, self.default, self.threshold))
        kinds = [jaxthermo.Contact, *([jaxthermo.Seam] if has_sheets else [])]
        return tuple(
            kind(without_resistance(conductance), bodies=groups, threshold=threshold)
            for groups, conductance, threshold in rules
            for kind in kinds
        )


def _numbers(patterns: Sequence[str], names: Mapping[str, int]) -> tuple[int, ...]:
    matching = {n for pattern in patterns for n in matching_parts(pattern, names)}
    return tuple(sorted(names[name] for name in matching))
