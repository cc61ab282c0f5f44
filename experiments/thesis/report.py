"""One page of all claims and exhibits, with its pictures beside it as files."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table

from .claims import CLAIMS
from .exhibit import Exhibit, Verdict
from .stored import Files, Plain, sections


PAGE = "report.html"

_TITLE = "The thesis, claim by claim"
_INTRODUCTION = (
    "Every table and figure of \N{LEFT DOUBLE QUOTATION MARK}GPU-based Real-Time "
    "Simulation of Thermography\N{RIGHT DOUBLE QUOTATION MARK} (National Chiao Tung "
    "University, 2010) that can be measured again, and the 27 claims that they stand "
    "for. Nothing is tuned to agree. A claim has the worst verdict of its exhibits; "
    "where the thesis leaves something open, the exhibit says what was taken."
)
_QUICK = (
    "This is the reduced size: coarser voxels and shorter runs than the thesis has. "
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


class Measured(NamedTuple):
    """An exhibit with its stored finding."""

    exhibit: Exhibit
    plain: Plain
    files: Files

    def of_claim(self, claim: str) -> tuple[Verdict, str]:
        """Verdict and reason of one of its claims."""
        own = self.plain["findings"].get(claim, self.plain)
        return Verdict(own["verdict"]), own["reason"]

    def result(self) -> Plain:
        """Plain values for `result.json`."""
        about = {
            "name": self.exhibit.name,
            "title": self.exhibit.title,
            "place": self.exhibit.place,
            "claims": list(self.exhibit.claims),
            "command": self.exhibit.command,
        }
        kept = ("verdict", "reason", "rows", "chosen", "numbers", "took_s")
        own = {key: self.plain[key] for key in kept}
        return {**about, **own, "files": sorted(self.files)}


def claim_results(measured: Sequence[Measured]) -> list[Plain]:
    """Every claim with its verdict, reasons and exhibits, in plain values."""
    found = []
    for claim in CLAIMS:
        answers = [each for each in measured if claim.id in each.exhibit.claims]
        verdicts = [each.of_claim(claim.id)[0] for each in answers]
        found.append(
            {
                **claim._asdict(),
                "verdict": str(min(verdicts, key=_ORDER.index)) if verdicts else "",
                "reasons": {
                    each.exhibit.name: each.of_claim(claim.id)[1] for each in answers
                },
            }
        )
    return found


def claim_table(measured: Sequence[Measured], on_page: bool) -> Table:
    """A line for each claim, with its reasons; on a terminal only of those measured."""
    lines = []
    for claim in claim_results(measured):
        verdict = claim["verdict"] or "not measured yet"
        if not (claim["verdict"] or on_page):
            continue
        line = [
            claim["id"],
            Cell(f"{claim['text']}\n({claim['place']})", wraps=True),
            _marked(verdict),
            Cell("\n".join(claim["reasons"]), wraps=True),
        ]
        if on_page:
            reasons = claim["reasons"].items()
            several = len(reasons) > 1
            texts = [f"{n}: {text}" if several else text for n, text in reasons]
            links = "\n".join(claim["reasons"])
            line[2:] = [_marked(verdict), Cell("\n".join(texts), wraps=True)]
            line.append(Cell(links, links=True))
        lines.append(line)
    columns = ["claim", "in our words", "verdict"]
    columns += ["why", "exhibits"] if on_page else ["exhibits"]
    return Table(columns, lines, left=range(len(columns)))


def _marked(verdict: str) -> Cell:
    known = verdict in set(Verdict)
    return Cell(verdict, _GOOD.get(Verdict(verdict)) if known else None, wraps=True)


def _summary(measured: Sequence[Measured]) -> str:
    verdicts = [claim["verdict"] for claim in claim_results(measured)]
    counts = [(verdicts.count(v), str(v)) for v in reversed(_ORDER)]
    counts.append((verdicts.count(""), "not measured yet"))
    words = ", ".join(f"{n} {text}" for n, text in counts if n)
    return f"{len(CLAIMS)} claims: {words}."


def write_files(each: Measured, folder: Path) -> None:
    """Write the pictures and charts of an exhibit into a folder."""
    for name, content in each.files.items():
        with replacing(folder / name) as path:
            path.write_bytes(content.tobytes())


def write_report(measured: Sequence[Measured], folder: Path, quick: bool) -> None:
    """Write `report.html` of all exhibits into a folder."""
    found: list[page.Section] = [
        _summary(measured),
        _INTRODUCTION,
        *([_QUICK] if quick else []),
        page.heading("The claims"),
        claim_table(measured, on_page=True),
    ]
    for chapter in sorted({each.exhibit.chapter for each in measured}):
        title = f"Chapter {chapter}: {_CHAPTERS.get(chapter, '')}".rstrip(": ")
        found.append(page.heading(title))
        for each in measured:
            if each.exhibit.chapter == chapter:
                found += _exhibit(each)
    page.write_page(folder / PAGE, _TITLE, found)


def _exhibit(each: Measured) -> list[page.Section]:
    exhibit, plain = each.exhibit, each.plain
    own = (_marked(plain["verdict"]), plain["reason"])
    rest = [(c, *each.of_claim(c)) for c in plain["findings"]]
    lines = [["verdict", own[0], Cell(own[1], wraps=True)]]
    lines += [[c, _marked(v), Cell(text, wraps=True)] for c, v, text in rest]
    claims = f", claims {', '.join(exhibit.claims)}" if exhibit.claims else ""
    return [
        page.heading(f"{exhibit.name}: {exhibit.title}", 3, exhibit.name),
        Table(["", "", ""], lines, left=(0, 1, 2)),
        *sections(plain, each.files),
        page.terms(
            [
                ("in the thesis", f"{exhibit.place}{claims}"),
                ("alone", exhibit.command),
                ("took", seconds(plain["took_s"])),
            ]
        ),
    ]
