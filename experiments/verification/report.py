"""Outcomes as tables on the terminal and as a page."""

from pathlib import Path

from rich.table import Table as RichTable
from rich.text import Text

from jaxthermo.atomic import replacing
from jaxthermo.report import page
from jaxthermo.report.table import Cell, Table, prose

from .case import Bound, Check, Group, Order
from .running import FAILED, PASSED, REPORTED, Outcome, named
from .uncovered import NOT_COVERED


TITLE = "Verification: published cases and closed forms"

HEADS = (
    "quantity", "expected", "computed", "error", "tolerance", "verdict",
)  # fmt: skip

STYLE = {PASSED: "green", FAILED: "bold red", REPORTED: ""}

Found = list[tuple[Group, list[Outcome]]]


def number(value: float | int | None, digits: int = 7) -> str:
    """As text; a dash for none."""
    return "–" if value is None else f"{value:.{digits}g}"


def with_unit(text: str, unit: str) -> str:
    """A number with its unit."""
    return f"{text} {unit}".strip()


def check_cells(check: Check) -> list[str]:
    """What a quantity was to be, was, and was off by; as `HEADS` has it."""
    computed = with_unit(number(check.computed), check.unit)
    verdict = verdict_of(check.passes)
    if isinstance(check, Bound):
        between = f"{number(check.lowest, 4)} to {number(check.highest, 4)}"
        return [check.name, between, computed, "–", "–", verdict]
    return [
        check.name,
        with_unit(number(check.expected), check.unit),
        computed,
        f"{check.error:+.1e}",
        number(check.tolerance, 3),
        verdict,
    ]


def verdict_of(passes: bool | None) -> str:
    """In a word."""
    return {True: PASSED, False: FAILED, None: REPORTED}[passes]


def order_text(order: Order | None) -> str:
    """The observed orders from coarse to fine, and the one that is asked for."""
    if order is None:
        return "–"
    observed = ", ".join(f"{p:.2f}" for p in order.observed)
    return observed if order.asked is None else f"{observed} (asked {order.asked:g})"


def cases_table(title: str, outcomes: list[Outcome]) -> RichTable:
    """A line for each case, with the quantity that is worst by its tolerance."""
    table = RichTable(title=title, title_justify="left", expand=False)
    for head in ("case", "worst quantity", *HEADS[1:5], "order", "verdict", "s"):
        table.add_column(head, overflow="fold")
    for outcome in outcomes:
        worst = outcome.worst
        cells = check_cells(worst)[:5] if worst else [outcome.failure, *"––––"]
        order = order_text(outcome.measured.order if outcome.measured else None)
        verdict = Text(outcome.verdict, STYLE[outcome.verdict])
        seconds = f"{outcome.seconds:.0f}"
        table.add_row(outcome.case.id, *cells, order, verdict, seconds)
    return table


def summary(outcomes: list[Outcome]) -> str:
    """How many pass, and which do not."""
    told = f"{len(named(outcomes, PASSED))} of {len(outcomes)} cases pass"
    for what, verdict in (("failed", FAILED), ("only reported", REPORTED)):
        ids = "; ".join(named(outcomes, verdict)) or "none"
        told += f"; {what}: {ids}"
    return told


def _marked(verdict: str) -> Cell:
    met = {PASSED: True, FAILED: False, REPORTED: None}[verdict]
    return Cell(verdict, met)


def _wrong(text: str) -> Cell:
    """In red, over as many lines as it takes."""
    return Cell(text, False, wraps=True)


def _overview(found: Found) -> Table:
    rows: list[list[str | Cell]] = []
    for outcome in (o for _, outcomes in found for o in outcomes):
        case, worst = outcome.case, outcome.worst
        cells = check_cells(worst)[:5] if worst else ["broke off", *"––––"]
        order = outcome.measured.order if outcome.measured else None
        last = "–" if order is None else f"{order.observed[-1]:.2f}"
        about = prose(case.name, case.source)
        told = map(Cell, (*cells, last))
        rows.append([case.id, _marked(outcome.verdict), about, *told])
    heads = [
        "case",
        "verdict",
        "name and source",
        "worst quantity",
        *HEADS[1:5],
        "order",
    ]
    return Table(heads, rows, left=range(len(heads)))


def _details(outcome: Outcome) -> list[page.Section]:
    """One case: where it is from, how it was computed, and all its quantities."""
    case, measured = outcome.case, outcome.measured
    title = page.heading(f"{case.id}: {case.name}", level=3)
    about = page.terms(
        [
            ("source", case.source),
            ("tolerance", case.tolerance),
            ("computed", case.how),
            ("took", f"{outcome.seconds:.1f} s"),
        ]
    )
    if measured is None:
        return [title, about, Table(["failed"], [[_wrong(outcome.failure)]])]
    rows = []
    for check in measured.checks:
        cells = check_cells(check)
        rows.append([*cells[:-1], _marked(cells[-1])])
    return [title, about, Table(list(HEADS), rows), *_order(measured.order)]


def _order(order: Order | None) -> list[page.Section]:
    if order is None:
        return []
    observed = ["–", *(f"{p:.2f}" for p in order.observed)]
    rows = [
        [number(h, 3), f"{e:.2e}", p]
        for h, e, p in zip(order.sizes, order.errors, observed, strict=True)
    ]
    heads = ["size of a voxel or step", "largest error", "order"]
    if order.asked is None:
        return [Table(heads, rows)]
    asked = f"{verdict_of(order.passes)}: {order.asked:g} or {order.within:g} less"
    return [Table(heads, [*rows, ["asked", "", Cell(asked, order.passes)]])]


def write_page(found: Found, path: Path) -> None:
    """The page: what failed, all cases in a line each, then everything.

    Args:
        found: outcomes by group.
        path: of the file.
    """
    every = [outcome for _, outcomes in found for outcome in outcomes]
    failed = [o for o in every if o.verdict == FAILED]
    sections = [
        page.paragraph(
            f"{summary(every)}. Tolerances are those of the sources. Errors are "
            "computed less expected; of each case the quantity is shown that is "
            "farthest off by its tolerance."
        ),
        *(
            Table(
                ["failed", "why"],
                [[o.case.id, _wrong(_why(o))] for o in failed],
                left=(0, 1),
            )
            for _ in failed[:1]
        ),
        page.heading("All cases"),
        _overview(found),
    ]
    for group, outcomes in found:
        sections += [
            page.heading(group.title),
            *(part for o in outcomes for part in _details(o)),
        ]
    sections += [
        page.heading("Not covered"),
        Table(["case", "why"], [[n, prose(w)] for n, w in NOT_COVERED]),
    ]
    with replacing(path) as temporary:
        temporary.write_text(page.document(TITLE, sections), encoding="utf-8")


def _why(outcome: Outcome) -> str:
    """What failed of a case."""
    if outcome.measured is None:
        return outcome.failure
    bad = [c for c in outcome.measured.checks if c.passes is False]
    told = [f"{c.name}: {check_cells(c)[2]}, not {check_cells(c)[1]}" for c in bad]
    order = outcome.measured.order
    if order is not None and order.passes is False:
        told.append(f"order {order_text(order)}")
    return "; ".join(told)
