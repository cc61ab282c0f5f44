"""The rows of the cases on the terminal and on a page."""

from rich.box import SIMPLE
from rich.markup import escape
from rich.table import Table as RichTable

from jaxthermo.report import page
from jaxthermo.report.table import Cell, Table, prose

from .case import FAIL, PASS, REFUSED, REPORTED, Case, Row


COLOURS = {PASS: "green", REFUSED: "green", FAIL: "bold red", REPORTED: "yellow"}
HEADS = (
    "what",
    "solver",
    "dtype",
    "over [K]",
    "energy",
    "Newton",
    "linear",
    "run",
    "result",
    "verdict",
)


def counts(rows: list[Row]) -> dict[str, int]:
    """Rows by verdict."""
    verdicts = [row.verdict for row in rows]
    return {name: verdicts.count(name) for name in (PASS, REFUSED, REPORTED, FAIL)}


def cells(row: Row) -> list[str]:
    """As text, in the order of `HEADS`."""
    number = lambda v: "" if v is None else f"{v:.1e}" if v else "0"
    whole = lambda v: "" if v is None else f"{v:,}"
    return [
        row.what,
        row.solver,
        row.dtype,
        number(row.overshoot_K),
        number(row.energy_residual),
        whole(row.newton),
        whole(row.linear),
        _time(row.run_s),
        row.result,
        row.verdict,
    ]


def _time(seconds: float | None) -> str:
    if seconds is None:
        return ""
    return f"{seconds:.2f} s" if seconds >= 1 else f"{1e3 * seconds:.1f} ms"


def told(row: Row) -> list[str]:
    """What was seen, and below it all checks with their limits."""
    checks = "; ".join(check.text for check in row.checks)
    return [line for line in (row.seen, checks) if line]


def case_table(case: Case, rows: list[Row]) -> RichTable:
    """For the terminal: a line a solver under what it solves; a failure says why."""
    title = f"[bold]{case.name}[/]: {escape(case.title)}\n[dim]{escape(case.holds)}[/]"
    table = RichTable(title=title, title_justify="left", title_style="", box=SIMPLE)
    for n, head in enumerate(HEADS[1:], 1):
        right = 3 <= n <= 7
        table.add_column(head, justify="right" if right else "left", no_wrap=n > 1)
    what = None
    for row in rows:
        first, solver, *most, verdict = map(escape, cells(row))
        if first != what:
            table.add_row(f"[bold]{first}[/]")
            what = first
        colour = COLOURS[row.verdict]
        table.add_row(f"  {solver}", *most, f"[{colour}]{verdict}[/]")
        if row.verdict == FAIL:
            table.add_row(f"[red]{escape('; '.join(_missed(row)))}[/]")
    return table


def _missed(row: Row) -> list[str]:
    missed = [check.text for check in row.checks if not check.met]
    return [*missed, *([row.seen] if row.seen else [])]


def page_of(found: list[tuple[Case, list[Row]]], took: float) -> str:
    """The report.

    Args:
        found: cases with their rows.
        took: all of it [s].
    """
    sections = [
        page.paragraph(
            "Each row is one solver on one scene. It passes if all of its checks lie "
            "in their limits, which stand beside it; a run that must be refused passes "
            "if the refusal says why. Reported: the energy is judged, the overshoot is "
            "shown for comparison only."
        ),
        page.paragraph(
            "A result other than successful is what the run says of itself: an error "
            "unless one asks for the result. Bounds and energy are judged all the "
            "same. Run times are of the second run of each, without compilation; "
            f"everything took {took:.0f} s."
        ),
        Table(
            ["case", "about", *(PASS, REFUSED, REPORTED, FAIL)],
            [_summary(case, rows) for case, rows in found],
            left=range(6),
        ),
    ]
    for case, rows in found:
        sections += [
            page.heading(f"{case.name}: {case.title}"),
            page.terms([("must hold", case.holds), ("source", case.source)]),
            Table(
                [*HEADS[1:], "seen; checks and their limits"],
                _page_rows(rows),
                left=(0, 1, 7, 8, 9),
            ),
        ]
    return page.document("Stiff and extreme cases", sections)


def _summary(case: Case, rows: list[Row]) -> list[str | Cell]:
    *good, failed = counts(rows).values()
    number = lambda n: str(n) if n else ""
    return [
        case.name,
        prose(case.title),
        *(Cell(number(n)) for n in good),
        Cell(number(failed), False if failed else None),
    ]


def _page_rows(rows: list[Row]) -> list[list[str | Cell]]:
    """A line a solver under what it solves."""
    lines, what = [], None
    for row in rows:
        if row.what != what:
            lines.append([Cell(row.what, wraps=True, columns=len(HEADS))])
            what = row.what
        lines.append(_page_cells(row))
    return lines


def _page_cells(row: Row) -> list[str | Cell]:
    _, *most, verdict = cells(row)
    met = {FAIL: False, REPORTED: None}.get(row.verdict, True)
    return [
        *most[:2],
        *most[2:7],
        most[7],
        Cell(verdict, met),
        prose(*told(row)),
    ]
