"""A table or figure of the thesis, and what is found when it is measured again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from PIL import Image

from jaxthermo.report.chart import Chart
from jaxthermo.report.table import Table


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


Number = float | int | str | None


@dataclass(frozen=True)
class Row:
    """One quantity as the thesis has it, and as it is found here."""

    quantity: str
    """Name and unit."""
    thesis: Number
    """Number or words of the thesis; None where it gives nothing."""
    ours: Number
    note: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture with the text below it; `name` is that of its file in the folder."""

    name: str
    image: Image.Image
    caption: str


@dataclass(frozen=True)
class Plot:
    """A chart with the text below it; `name` is that of its file in the folder."""

    name: str
    chart: Chart
    caption: str


@dataclass(frozen=True)
class Note:
    """A paragraph in grey, beside plain texts in black."""

    text: str


Part = Picture | Plot | Table | Note | str
"""Anything that a page shows of an exhibit, a plain text being a paragraph."""


@dataclass(frozen=True)
class Finding:
    """Everything that one measurement of an exhibit gives."""

    verdict: Verdict
    """Verdict of the exhibit, and of each of its claims that has none in `claims`."""
    reason: str
    """Full sentences: why the verdict is what it is, with the decisive numbers."""
    rows: tuple[Row, ...] = ()
    """Quantities beside those of the thesis."""
    claims: Mapping[str, tuple[Verdict, str]] = field(default_factory=dict)
    """Verdict and reason of single claims, by their id."""
    chosen: tuple[tuple[str, str], ...] = ()
    """Choices that the thesis leaves open: word, and what was taken here."""
    parts: tuple[Part, ...] = ()
    """Shown below the rows, in this order."""
    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Plain values for `result.json`, beside the rows."""


def skipped(reason: str) -> Finding:
    """The finding of an exhibit that cannot be measured here."""
    return Finding(Verdict.SKIPPED, reason)


@dataclass(frozen=True)
class Exhibit:
    """A table, a figure or a section of the thesis that is measured again.

    A module in `exhibits/` names its own `EXHIBIT`, or several of one kind `EXHIBITS`.
    """

    name: str
    """Such as "figure-4.3", by which a command finds it."""
    title: str
    place: str
    """Chapter and figure in the thesis, such as "4.1, figure 4.3"."""
    claims: tuple[str, ...]
    """Ids of the claims that it answers."""
    measure: Callable[[bool], Finding]
    """Measures it, in the reduced size if True."""

    @property
    def chapter(self) -> int:
        """Number of the chapter, from its place."""
        return int(self.place.split(".")[0].split(",")[0])

    @property
    def command(self) -> str:
        """The command that measures it alone."""
        return f"experiments run thesis --cases {self.name}"
