"""A verification case: what was to come out, what did, and whether that is enough."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise


ZERO_CELSIUS = 273.15
"""[K]"""

Number = float | int


@dataclass(frozen=True)
class Value:
    """A number beside the one that it should be."""

    name: str
    unit: str
    expected: Number
    computed: Number
    tolerance: Number | None
    """Largest error, in the same unit; None where nobody states one: not judged."""

    @property
    def error(self) -> float:
        """Computed less expected."""
        return float(self.computed) - float(self.expected)

    @property
    def passes(self) -> bool | None:
        """Whether the error is within the tolerance; a NaN is not. None: not judged."""
        if self.tolerance is None:
            return None
        return abs(self.error) <= self.tolerance


@dataclass(frozen=True)
class Bound:
    """A number that is only known to lie between two."""

    name: str
    unit: str
    computed: Number
    lowest: Number = -math.inf
    highest: Number = math.inf

    @property
    def passes(self) -> bool:
        """Whether it does."""
        return self.lowest <= self.computed <= self.highest


@dataclass(frozen=True)
class Order:
    """How the error falls with the size of a voxel or a step."""

    sizes: tuple[Number, ...]
    """From coarse to fine, in any unit."""
    errors: tuple[Number, ...]
    """Of each, in any unit."""
    asked: Number | None = None
    """The order that theory gives; None where it gives none: not judged."""
    within: Number = 0.3
    """The last observed one may be so far below it."""

    @property
    def observed(self) -> tuple[float, ...]:
        """From each size to the next, log(e1 / e2) / log(h1 / h2)."""
        steps = pairwise(zip(self.sizes, self.errors, strict=True))
        return tuple(
            math.log(e1 / e2) / math.log(h1 / h2) if e1 > 0 and e2 > 0 else math.nan
            for (h1, e1), (h2, e2) in steps
        )

    @property
    def passes(self) -> bool | None:
        """Whether the last is as asked; None: not judged."""
        if self.asked is None:
            return None
        return self.observed[-1] >= self.asked - self.within


Check = Value | Bound


@dataclass(frozen=True)
class Measured:
    """What a case came to."""

    checks: tuple[Check, ...]
    order: Order | None = None

    @property
    def passed(self) -> bool | None:
        """Whether all that is judged passes; None where nothing is."""
        verdicts = [check.passes for check in self.checks]
        if self.order is not None:
            verdicts.append(self.order.passes)
        judged = [verdict for verdict in verdicts if verdict is not None]
        return all(judged) if judged else None


@dataclass(frozen=True)
class Case:
    """One published case, and how it is computed here."""

    id: str
    name: str
    source: str
    tolerance: str
    """As the source states it."""
    how: str
    """What is solved: voxels, steps, solver."""
    measure: Callable[[], Measured]


@dataclass(frozen=True)
class Group:
    """Cases of one idea."""

    title: str
    cases: tuple[Case, ...]


def values(
    names: tuple[str, ...],
    unit: str,
    expected: tuple[Number, ...],
    computed: list[float],
    tolerance: Number | None,
) -> tuple[Value, ...]:
    """Several numbers of one kind.

    Args:
        names: of each.
        unit: of all.
        expected: of each.
        computed: of each.
        tolerance: of all.
    """
    rows = zip(names, expected, computed, strict=True)
    return tuple(Value(n, unit, e, float(c), tolerance) for n, e, c in rows)


def largest_error(checks: tuple[Value, ...]) -> float:
    """Of several numbers, in their unit."""
    return max(abs(value.error) for value in checks)
