"""One page of all claims and exhibits; its pictures are also files of its folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table
from jaxthermo.report.templates import Html

from ..harness.record import Arrays
from .exhibit import CLAIMS, Exhibit, Verdict
from .statements import Statement, statement, title_of


_TITLE = "The thesis, claim by claim"
_INTRODUCTION = (
    "Every table and figure of “GPU-based Real-Time Simulation of Thermography” "
    "(National Chiao Tung University, 2010) that can be measured again, and its 27 "
    "claims. Nothing is tuned to agree. A claim has the worst verdict of its exhibits; "
    "where the thesis leaves something open, the exhibit says what was chosen."
)
_QUICK = (
    "This is the reduced size: coarser voxels and shorter runs than in the thesis. "
    "Leave out --quick for its own resolutions."
)
_CHAPTERS = {
    1: "Introduction",
    3: "Overview",
    4: "Voxelization",
    5: "Simulation of heat transfer",
    6: "Experiment results",
    7: "Conclusion, and the whole text",
}
_ORDER = tuple(Verdict)
_GOOD = {Verdict.REPRODUCED: True, Verdict.CONTRADICTED: False, Verdict.FAILED: False}


class _ExhibitResult(TypedDict):
    """An exhibit with its measurement, in types that JSON has."""

    name: str
    title: str
    place: str
    claims: list[str]
    command: str
    verdict: str
    reason: str
    numbers: Mapping[str, Any]
    """Nested values, which each exhibit has of its own."""
    took_s: float
    files: list[str]


class Measured(NamedTuple):
    """An exhibit with what was measured of it."""

    exhibit: Exhibit
    verdict: Verdict
    seconds: float
    """Time that the measurement took [s]."""
    numbers: Mapping[str, Any] = {}
    claims: Mapping[str, Verdict] = {}
    """Verdicts of single claims."""
    files: Arrays = {}
    """Bytes of each picture and chart by the name of its file."""
    failure: str = ""
    """Reason why there are no numbers."""

    @property
    def statement(self) -> Statement:
        """The text of the exhibit with these numbers."""
        name = self.exhibit.name
        if self.failure:
            return Statement(title_of(name), self.failure, claims={}, blocks=())
        return statement(name, self.numbers, pictures=_pictures(self.files))

    def verdict_of(self, claim: str) -> Verdict:
        """Verdict of one of its claims."""
        return self.claims.get(claim, self.verdict)

    def plain(self) -> _ExhibitResult:
        """Plain values for `result.json`."""
        text = self.statement
        return {
            "name": self.exhibit.name,
            "title": text.title,
            "place": self.exhibit.place,
            "claims": list(self.exhibit.claims),
            "command": self.exhibit.command,
            "verdict": str(self.verdict),
            "reason": text.reason,
            "numbers": dict(self.numbers),
            "took_s": self.seconds,
            "files": sorted(self.files),
        }


def _pictures(files: Arrays) -> dict[str, page.Section]:
    """Each picture and chart as a part of a page, by its name without ending."""
    sections: dict[str, page.Section] = {}
    for file, content in files.items():
        name, _, ending = file.rpartition(".")
        data = content.tobytes()
        sections[name] = (
            page.embedded(data, name) if ending == "png" else Html(data.decode("utf-8"))
        )
    return sections


class _ClaimResult(TypedDict):
    """A claim with its verdict."""

    id: str
    text: str
    place: str
    verdict: str
    """Empty if no exhibit that answers it was measured."""
    reasons: dict[str, str]
    """Reasons by exhibit."""


def claim_results(measured: Sequence[Measured]) -> list[_ClaimResult]:
    """Every claim with its verdict, reasons and exhibits, in plain values."""
    results: list[_ClaimResult] = []
    for claim in CLAIMS:
        answers = [m for m in measured if m.exhibit.name in claim.exhibits]
        verdicts = [answer.verdict_of(claim.id) for answer in answers]
        reasons = {}
        for answer in answers:
            text = answer.statement
            reasons[answer.exhibit.name] = text.claims.get(claim.id, text.reason)
        results.append(
            {
                "id": claim.id,
                "text": claim.text,
                "place": claim.place,
                "verdict": str(min(verdicts, key=_ORDER.index)) if verdicts else "",
                "reasons": reasons,
            }
        )
    return results


def claim_table(measured: Sequence[Measured], on_page: bool) -> Table:
    """A line for each claim, with its reasons; on a terminal only of those measured."""
    lines = []
    for claim in claim_results(measured):
        if not (claim["verdict"] or on_page):
            continue
        names = "\n".join(claim["reasons"])
        reasons = claim["reasons"].items()
        texts = [f"{n}: {text}" if len(reasons) > 1 else text for n, text in reasons]
        line: list[str | Cell] = [
            claim["id"],
            Cell(f"{claim['text']}\n({claim['place']})", wraps=True),
            _marked(claim["verdict"] or "not measured yet"),
            Cell(names, links=True) if on_page else Cell(names, wraps=True),
        ]
        if on_page:
            line.insert(3, Cell("\n".join(texts), wraps=True))
        lines.append(line)
    columns = ["claim", "in our words", "verdict", "exhibits"]
    if on_page:
        columns.insert(3, "why")
    return Table(columns, lines, left=range(len(columns)))


def _marked(verdict: str) -> Cell:
    is_good = _GOOD.get(Verdict(verdict)) if verdict in set(Verdict) else None
    return Cell(verdict, is_good, wraps=True)


def _summary(measured: Sequence[Measured]) -> str:
    verdicts = [claim["verdict"] for claim in claim_results(measured)]
    counts = [(verdicts.count(v), str(v)) for v in reversed(_ORDER)]
    counts.append((verdicts.count(""), "not measured yet"))
    words = ", ".join(f"{n} {text}" for n, text in counts if n)
    return f"{len(CLAIMS)} claims: {words}."


def write_files(result: Measured, folder: Path) -> None:
    """Write the pictures and charts of an exhibit into a folder."""
    for name, content in result.files.items():
        with replacing(folder / name) as path:
            path.write_bytes(content.tobytes())


def write_report(measured: Sequence[Measured], folder: Path, quick: bool) -> None:
    """Write `report.html` of all exhibits into a folder."""
    sections: list[page.Section] = [
        _summary(measured),
        _INTRODUCTION,
        *([_QUICK] if quick else []),
        page.heading("The claims"),
        claim_table(measured, on_page=True),
    ]
    for chapter in sorted({result.exhibit.chapter for result in measured}):
        sections.append(page.heading(f"Chapter {chapter}: {_CHAPTERS[chapter]}"))
        for result in measured:
            if result.exhibit.chapter == chapter:
                sections += _exhibit_sections(result)
    page.write_page(folder / "report.html", _TITLE, sections)


def _exhibit_sections(result: Measured) -> list[page.Section]:
    exhibit = result.exhibit
    text = result.statement
    verdicts = [("verdict", result.verdict, text.reason)]
    verdicts += [
        (claim, verdict, text.claims.get(claim, text.reason))
        for claim, verdict in result.claims.items()
    ]
    lines = [
        [word, _marked(verdict), Cell(reason, wraps=True)]
        for word, verdict, reason in verdicts
    ]
    claims = f", claims {', '.join(exhibit.claims)}" if exhibit.claims else ""
    return [
        page.heading(f"{exhibit.name}: {text.title}", 3, exhibit.name),
        Table(["", "", ""], lines, left=(0, 1, 2)),
        *text.blocks,
        page.terms(
            [
                ("in the thesis", f"{exhibit.place}{claims}"),
                ("alone", exhibit.command),
                ("took", seconds(result.seconds)),
            ]
        ),
    ]
