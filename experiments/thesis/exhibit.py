"""Exhibits: tables, figures and sections of the thesis that are measured again.

An exhibit is a function with the decorator `exhibit`. It returns numbers and pictures;
its text is the section of its name in `docs/thesis`, which quotes the numbers.
"""

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from jaxthermo.report.chart import Chart


class Verdict(StrEnum):
    """Outcome of a claim or an exhibit, from the worst to the best that is judged."""

    FAILED = "failed"
    """An exception stopped the measurement: a fault of ours."""
    CONTRADICTED = "contradicted"
    DIFFERENT = "reproduced with a difference"
    REPRODUCED = "reproduced"
    NOT_REPRODUCIBLE = "not reproducible"
    """The thesis does not give what would be needed, or its hardware is gone."""
    SKIPPED = "skipped"
    """A mesh is missing."""


def judged(reproduced: bool, different: bool = False) -> Verdict:
    """The verdict on a statement that holds, holds with a difference, or does not."""
    if reproduced:
        return Verdict.REPRODUCED
    return Verdict.DIFFERENT if different else Verdict.CONTRADICTED


def rms(values: np.ndarray, weights: np.ndarray | None = None) -> float:
    """Root mean square, weighted by areas if there are any."""
    return float(np.sqrt(np.average(values**2, weights=weights)))


def imbalance(gained: float, lost: float) -> float:
    """Relative difference of what one body gains and the other loses [-]."""
    # No closer than rounding.
    rounding = float(np.finfo(float).eps)
    return max(abs(gained + lost) / abs(gained), rounding)


Numbers = Mapping[str, Any]
"""Nested values that the text of an exhibit quotes and shows as tables."""


class Finding(NamedTuple):
    """Everything that one measurement of an exhibit gives."""

    verdict: Verdict
    """Verdict of the exhibit, and of each of its claims that has none in `claims`."""
    numbers: Numbers
    pictures: Mapping[str, Image.Image | Chart] = {}
    """Pictures and charts by the names of their files, without the ending."""
    claims: Mapping[str, Verdict] = {}
    """Verdicts of single claims, by their id."""


Measure = Callable[[bool], Finding]
"""Measures an exhibit, in the reduced size if the argument is True."""


class _Claim(NamedTuple):
    """A statement of the thesis, in our own words, that can be measured."""

    id: str
    text: str
    place: str
    """Section, table or figure of the thesis."""
    exhibits: tuple[str, ...]
    """Names of the exhibits that answer it."""


def _read_claims() -> tuple[_Claim, ...]:
    path = Path(__file__).with_name("data") / "claims.csv"
    with path.open(encoding="utf-8", newline="") as lines:
        rows = [*csv.DictReader(lines)]
    return tuple(
        _Claim(
            id=row["id"],
            text=row["text"],
            place=row["place"],
            exhibits=tuple(row["exhibits"].split()),
        )
        for row in rows
    )


CLAIMS = _read_claims()


@dataclass(frozen=True)
class Exhibit:
    """A table, a figure or a section of the thesis, with its measurement."""

    name: str
    """Such as "figure-4.3", by which a command finds it."""
    place: str
    """Chapter and figure in the thesis, such as "4.1, figure 4.3"."""
    measure: Measure

    @property
    def claims(self) -> tuple[str, ...]:
        """Ids of the claims that it answers."""
        return tuple(claim.id for claim in CLAIMS if self.name in claim.exhibits)

    @property
    def chapter(self) -> int:
        """Number of the chapter, from its place."""
        return int(self.place[0])

    @property
    def command(self) -> str:
        """The command that measures it alone."""
        return f"experiments run thesis --cases {self.name}"

    @property
    def order(self) -> tuple[int, str, list[int], str]:
        """Sorts exhibits by chapter, then tables and figures by number."""
        category, _, number = self.name.partition("-")
        digits = [int(digit) for digit in number.split(".") if digit.isdigit()]
        return self.chapter, category, digits, self.name


REGISTERED: list[Exhibit] = []
"""Exhibits of the modules that are imported, in no order."""


def exhibit(name: str, place: str) -> Callable[[Measure], Measure]:
    """Register the decorated function as the measurement of an exhibit."""

    def register(measure: Measure) -> Measure:
        REGISTERED.append(Exhibit(name=name, place=place, measure=measure))
        return measure

    return register
