"""Outcomes of cases as tables on a terminal and as a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jaxthermo.report import page
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table, prose

from .case import FAIL, PASS, REPORTED, Bound, Check, Group, Order, Outcome, Row


_QUANTITY = ("quantity", "expected", "computed", "error", "tolerance", "verdict")
_RUN = (
    "solver", "dtype", "over [K]", "energy", "Newton", "linear", "run", "result",
    "verdict",
)  # fmt: skip
# Marks what a check has not; an empty cell would look forgotten.
_NONE = "\N{EN DASH}"


class PageTexts(NamedTuple):
    """Texts of a page around its cases."""

    title: str
    introduction: tuple[str, ...]
    not_covered: tuple[tuple[str, str], ...] = ()
    """Name and reason of each published case that is not computed."""


def ids_of(outcomes: Sequence[Outcome], verdict: str) -> list[str]:
    """Ids of the cases with a verdict."""
    return [o.case.id for o in outcomes if o.verdict == verdict]


def summary(outcomes: Sequence[Outcome]) -> str:
    """The number of cases that pass, and the ids of the others."""
    text = f"{len(ids_of(outcomes, PASS))} of {len(outcomes)} cases pass"
    for words, verdict in (("failed", FAIL), ("only reported", REPORTED)):
        ids = "; ".join(ids_of(outcomes, verdict)) or "none"
        text += f"; {words}: {ids}"
    return text


def terminal_tables(title: str, outcomes: Sequence[Outcome]) -> list[Table]:
    """A line for each case; a table of its own for a case of many rows."""
    single = [outcome for outcome in outcomes if not _has_runs(outcome)]
    tables = [_case_table(single, False, title)] if single else []
    return tables + [_run_table(o, False) for o in outcomes if _has_runs(o)]


def write_report(
    found: Sequence[tuple[Group, Sequence[Outcome]]],
    path: Path,
    texts: PageTexts,
    took: float | None = None,
) -> None:
    """Write the page of all outcomes by group, which took so long [s]."""
    # Failures first, then all cases in a line each, then every detail.
    outcomes = [outcome for _, each in found for outcome in each]
    took_words = "" if took is None else f" Everything took {took:.0f} s."
    sections: list[page.Section] = [
        f"{summary(outcomes)}.{took_words}",
        *texts.introduction,
    ]
    failed = [outcome for outcome in outcomes if outcome.verdict == FAIL]
    if failed:
        rows = [
            [o.case.id, Cell("; ".join(_reasons(o)), False, wraps=True)] for o in failed
        ]
        sections.append(Table(["failed", "reason"], rows))
    sections += [page.heading("All cases"), _case_table(outcomes, True)]
    for group, each in found:
        sections.append(page.heading(group.title))
        for outcome in each:
            sections += _details(outcome)
    if texts.not_covered:
        rows = [[name, prose(reason)] for name, reason in texts.not_covered]
        sections += [page.heading("Not covered"), Table(["case", "reason"], rows)]
    page.write_page(path, texts.title, sections)


def _has_runs(outcome: Outcome) -> bool:
    # Solvers are told apart by rows; one row is a list of quantities.
    return len(outcome.rows) > 1 or any(row.solver for row in outcome.rows)


def _marked(verdict: str) -> Cell:
    # A refusal that was due is as good as a pass.
    return Cell(verdict, {FAIL: False, REPORTED: None}.get(verdict, True))


def _number(value: float | int | None, digits: int = 7) -> str:
    return _NONE if value is None else f"{value:.{digits}g}"


def _check_cells(check: Check | None, otherwise: str) -> list[str | Cell]:
    """Name, expected, computed, error and tolerance of a check."""
    if check is None:
        return [Cell(otherwise, wraps=True), *_NONE * 4]
    computed = f"{_number(check.computed)} {check.unit}".strip()
    if isinstance(check, Bound):
        limits = f"{_number(check.lowest, 4)} to {_number(check.highest, 4)}"
        return [check.name, limits, computed, _NONE, _NONE]
    expected = f"{_number(check.expected)} {check.unit}".strip()
    error, tolerance = f"{check.error:+.1e}", _number(check.tolerance, 3)
    return [check.name, expected, computed, error, tolerance]


def _orders(outcome: Outcome) -> str:
    texts = [_order_text(row.order) for row in outcome.rows if row.order is not None]
    return "; ".join(texts) or _NONE


def _order_text(order: Order) -> str:
    observed = ", ".join(f"{p:.2f}" for p in order.observed)
    if order.expected is None:
        return observed
    return f"{observed} (expected {order.expected:g})"


def _case_table(outcomes: Sequence[Outcome], on_page: bool, title: str = "") -> Table:
    """A line for each case, with its worst quantity."""
    columns = ["worst quantity", *_QUANTITY[1:5], "order"]
    if on_page:
        columns = ["case", "verdict", "title and source", *columns]
    else:
        columns = ["case", *columns, "verdict", "s"]
    rows = []
    for o in outcomes:
        # A terminal shows the exception here; the page has it below its case.
        failure = "stopped by an exception" if on_page and o.failure else o.failure
        worst = [*_check_cells(o.worst, failure), _orders(o)]
        verdict = _marked(o.verdict)
        if on_page:
            about = prose(o.case.title, o.case.source)
            rows.append([o.case.id, verdict, about, *worst])
        else:
            rows.append([o.case.id, *worst, verdict, f"{o.seconds:.0f}"])
    left = range(len(columns)) if on_page else (0, 1, 6, 7)
    return Table(columns, rows, title=title, left=left)


def _run_table(outcome: Outcome, on_page: bool) -> Table:
    """A line for each solver, below the scene that it solves."""
    columns = (*_RUN, "observed; checks and their limits") if on_page else _RUN
    rows: list[list[str | Cell]] = []
    what = None
    for row in outcome.rows:
        if row.what != what:
            rows.append([Cell(row.what, wraps=True, columns=len(columns))])
            what = row.what
        solver, *cells = _run_cells(row)
        if on_page:
            texts = (row.failure, row.seen, "; ".join(c.text for c in row.checks))
            rows.append([solver, *cells, prose(*(text for text in texts if text))])
            continue
        rows.append([f"  {solver}", *cells])
        # A terminal has no room for the checks of all rows, only for those missed.
        if row.verdict == FAIL:
            rows.append([Cell("  " + _row_reason(row), False, wraps=True)])
    case = outcome.case
    title = f"{case.id}: {case.title}\n{case.requirement}"
    return Table(columns, rows, title=title, left=(0, 1, 7, 8, 9), framed=False)


def _run_cells(row: Row) -> list[str | Cell]:
    # An exact 0 is not a small number: it says that nothing was rounded.
    small = lambda v: "" if v is None else f"{v:.1e}" if v else "0"
    whole = lambda v: "" if v is None else f"{v:,}"
    return [
        row.solver,
        row.dtype,
        small(row.overshoot_K),
        small(row.energy_residual),
        whole(row.newton),
        whole(row.linear),
        "" if row.run_s is None else seconds(row.run_s),
        row.result,
        _marked(row.verdict),
    ]


def _details(outcome: Outcome) -> list[page.Section]:
    """One case: its source, its method, and all its checks."""
    case = outcome.case
    about = [
        ("must hold", case.requirement),
        ("source", case.source),
        ("computed by", case.method),
        ("took", f"{outcome.seconds:.1f} s"),
    ]
    sections: list[page.Section] = [
        page.heading(f"{case.id}: {case.title}", level=3),
        page.terms([(word, text) for word, text in about if text]),
    ]
    # Rows by solver share the columns of one table; others have a table of checks each.
    if _has_runs(outcome):
        return [*sections, _run_table(outcome, True)]
    for row in outcome.rows:
        if row.failure:
            failure = Cell(row.failure, False, wraps=True)
            sections.append(Table(["failed"], [[failure]]))
        if row.checks:
            verdicts = {True: PASS, False: FAIL, None: REPORTED}
            cells = [
                [*_check_cells(c, ""), _marked(verdicts[c.passes])] for c in row.checks
            ]
            sections.append(Table(_QUANTITY, cells))
        if row.order is not None:
            sections.append(_order_table(row.order))
    return sections


def _order_table(order: Order) -> Table:
    observed = [_NONE, *(f"{p:.2f}" for p in order.observed)]
    rows: list[list[str | Cell]] = [
        [_number(h, 3), f"{e:.2e}", p]
        for h, e, p in zip(order.sizes, order.errors, observed, strict=True)
    ]
    if order.expected is not None:
        verdict = PASS if order.passes else FAIL
        text = f"{verdict}: {order.expected:g}, or up to {order.margin:g} less"
        rows.append(["expected", "", Cell(text, order.passes)])
    return Table(["size of a voxel or step", "largest error", "order"], rows)


def _reasons(outcome: Outcome) -> list[str]:
    return [_row_reason(row) for row in outcome.rows if row.verdict == FAIL]


def _row_reason(row: Row) -> str:
    if row.failure:
        return row.failure
    texts = []
    for check in row.checks:
        if check.passes is False:
            name, expected, computed, *_ = _check_cells(check, "")
            texts.append(f"{name}: {computed}, not {expected}")
    if row.order is not None and row.order.passes is False:
        texts.append(f"order {_order_text(row.order)}")
    return "; ".join([*texts, *([row.seen] if row.seen else [])])
