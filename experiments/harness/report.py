"""Running cases that are selected by name, and their outcomes as tables and a page."""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, Required, TypedDict, cast

from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError
from jaxthermo.report import page
from jaxthermo.report.numbers import seconds
from jaxthermo.report.table import Cell, Table, prose

from .case import (
    FAIL,
    PASS,
    REFUSED,
    REPORTED,
    Case,
    Check,
    Group,
    Number,
    Order,
    Outcome,
    Row,
    check,
    named_cases,
)


_QUANTITY = ("quantity", "expected", "computed", "error", "tolerance", "verdict")
_RUN = (
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
# Marks what a check has not; an empty cell would look forgotten.
_NONE = "\N{EN DASH}"


class PageTexts(NamedTuple):
    """Texts of a page around its cases."""

    title: str
    introduction: tuple[str, ...]
    not_covered: tuple[tuple[str, str], ...] = ()
    """Name and reason of each published case that is not computed."""


def _ids_of(outcomes: Sequence[Outcome], verdict: str) -> list[str]:
    """Ids of the cases with a verdict."""
    return [o.case.id for o in outcomes if o.verdict == verdict]


def _summary(outcomes: Sequence[Outcome]) -> str:
    """The number of cases that pass, and the ids of the others."""
    text = f"{len(_ids_of(outcomes, PASS))} of {len(outcomes)} cases pass"
    for words, verdict in (("failed", FAIL), ("only reported", REPORTED)):
        ids = "; ".join(_ids_of(outcomes, verdict)) or "none"
        text += f"; {words}: {ids}"
    return text


def terminal_tables(title: str, outcomes: Sequence[Outcome]) -> list[Table]:
    """A line for each case; a table of its own for a case of many rows."""
    single = [outcome for outcome in outcomes if not _has_runs(outcome)]
    tables = [_case_table(single, False, title)] if single else []
    return tables + [_run_table(o, False) for o in outcomes if _has_runs(o)]


def write_report(
    results: Sequence[tuple[Group, Sequence[Outcome]]],
    path: Path,
    texts: PageTexts,
    took: float | None = None,
) -> None:
    """Write the page of all outcomes by group, which took so long [s]."""
    # Failures first, then all cases in a line each, then every detail.
    outcomes = [outcome for _, of_group in results for outcome in of_group]
    took_words = "" if took is None else f" Everything took {took:.0f} s."
    sections: list[page.Section] = [
        f"{_summary(outcomes)}.{took_words}",
        *texts.introduction,
    ]
    failed = [outcome for outcome in outcomes if outcome.verdict == FAIL]
    if failed:
        rows = []
        for outcome in failed:
            reasons = "; ".join(_reasons(outcome))
            rows.append([outcome.case.id, Cell(reasons, False, wraps=True)])
        sections.append(Table(["failed", "reason"], rows))
    sections += [page.heading("All cases"), _case_table(outcomes, True)]
    for group, of_group in results:
        sections.append(page.heading(group.title))
        for outcome in of_group:
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
    if check.expected is None:
        limits = f"{_number(check.lowest, 4)} to {_number(check.highest, 4)}"
        return [check.name, limits, computed, _NONE, _NONE]
    expected = f"{_number(check.expected)} {check.unit}".strip()
    tolerance = _number(check.tolerance, 3)
    return [check.name, expected, computed, f"{check.error:+.1e}", tolerance]


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
    scene = None
    for row in outcome.rows:
        if row.what != scene:
            rows.append([Cell(row.what, wraps=True, columns=len(columns))])
            scene = row.what
        solver, *cells = _run_cells(row)
        if on_page:
            checks = "; ".join(check.text for check in row.checks)
            texts = [text for text in (row.failure, row.seen, checks) if text]
            rows.append([solver, *cells, prose(*texts)])
            continue
        rows.append([f"  {solver}", *cells])
        # A terminal has no room for the checks of all rows, only for those missed.
        if row.verdict == FAIL:
            rows.append([Cell("  " + _row_reason(row), False, wraps=True)])
    case = outcome.case
    title = f"{case.id}: {case.title}\n{case.requirement}"
    return Table(columns, rows, title=title, left=(0, 1, 7, 8, 9), framed=False)


def _run_cells(row: Row) -> list[str | Cell]:
    return [
        row.solver,
        row.dtype,
        _small(row.overshoot_K),
        _small(row.energy_residual),
        _with_thousands(row.newton),
        _with_thousands(row.linear),
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
            cells = []
            for check in row.checks:
                verdict = _marked(verdicts[check.passes])
                cells.append([*_check_cells(check, ""), verdict])
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
    for missed in row.checks:
        if missed.passes is False:
            name, expected, computed, *_ = _check_cells(missed, "")
            texts.append(f"{name}: {computed}, not {expected}")
    if row.order is not None and row.order.passes is False:
        texts.append(f"order {_order_text(row.order)}")
    if row.seen:
        texts.append(row.seen)
    return "; ".join(texts)


def _small(value: float | None) -> str:
    if value is None:
        return ""
    # An exact 0 is not a small number: it says that nothing was rounded.
    return f"{value:.1e}" if value else "0"


def _with_thousands(count: int | None) -> str:
    return "" if count is None else f"{count:,}"


class _CheckResult(TypedDict, total=False):
    """A check, with its limits or with its expected value and error."""

    name: str
    unit: str
    computed: Number | str
    lowest: Number | str
    highest: Number | str
    expected: Number | str
    error: Number | str
    tolerance: Number | None
    passes: bool | None


class _RowResult(TypedDict, total=False):
    """The fields of a row that say something of it."""

    what: str
    solver: str
    dtype: str
    overshoot_K: Number | str
    energy_residual: Number | str
    newton: int
    linear: int
    compile_s: float
    run_s: float
    result: str
    seen: str
    checks: Required[list[_CheckResult]]
    order: dict[str, list[Number | str] | Number | bool | None]
    failure: str
    verdict: Required[str]


class _CaseResult(TypedDict):
    """A case with its outcome, in types that JSON has."""

    id: str
    group: str
    title: str
    source: str
    requirement: str
    method: str
    verdict: str
    took_s: float
    rows: list[_RowResult]


class _NotCovered(TypedDict):
    """A published case that is not computed."""

    id: str
    reason: str


class CasesResult(TypedDict):
    """The outcomes of all cases."""

    passed: list[str]
    failed: list[str]
    reported: list[str]
    verdicts: dict[str, int]
    """Number of rows by verdict."""
    cases: list[_CaseResult]
    not_covered: list[_NotCovered]
    took_s: float
    files: list[str]


def run_cases(
    groups: Sequence[Group],
    names: str | None,
    folder: Path,
    texts: PageTexts,
    at_once: int = 1,
    begin: float | None = None,
) -> CasesResult:
    """Run cases, all or those whose ids begin with one of the names ("V21,A1").

    Prints a table of each group and writes `report.html`. `at_once` cases run at the
    same time: 1 where run times are compared. The page says how long everything took
    since `begin`, a reading of `time.perf_counter`; None for now. An unknown name is an
    InputError.
    """
    groups = select(groups, names)
    if begin is None:
        begin = time.perf_counter()
    console = open_console()
    results: list[tuple[Group, list[Outcome]]] = []
    pool = ThreadPoolExecutor(at_once)
    try:
        # All groups are handed in at once: no thread waits at the end of a group.
        submitted = [pool.map(check, group.cases) for group in groups]
        for group, of_group in zip(groups, submitted, strict=True):
            outcomes = list(of_group)
            for table in terminal_tables(group.title, outcomes):
                # Long texts fold on a terminal, where this console lets lines run on.
                console.print(table.rich(), soft_wrap=False)
            results.append((group, outcomes))
    finally:
        # After an interrupt the cases that have not begun would run to their end.
        pool.shutdown(cancel_futures=True)
    outcomes = [outcome for _, of_group in results for outcome in of_group]
    console.print(_summary(outcomes), soft_wrap=False)
    took = time.perf_counter() - begin
    write_report(results, path=folder / "report.html", texts=texts, took=took)
    row_verdicts = [row.verdict for outcome in outcomes for row in outcome.rows]
    not_covered: list[_NotCovered] = [
        {"id": name, "reason": reason} for name, reason in texts.not_covered
    ]
    return {
        "passed": _ids_of(outcomes, PASS),
        "failed": _ids_of(outcomes, FAIL),
        "reported": _ids_of(outcomes, REPORTED),
        "verdicts": {
            verdict: row_verdicts.count(verdict)
            for verdict in (PASS, REFUSED, REPORTED, FAIL)
        },
        "cases": [
            _plain(outcome, group.title)
            for group, of_group in results
            for outcome in of_group
        ],
        "not_covered": not_covered,
        "took_s": round(took, 1),
        "files": ["report.html"],
    }


def select(groups: Sequence[Group], names: str | None) -> tuple[Group, ...]:
    """Groups with their cases whose ids begin with one of the names, or all.

    Raises:
        InputError: for an unknown name.
    """
    if names is None:
        return tuple(groups)
    cases = [case for group in groups for case in group.cases]
    listed = "; ".join(case.id for case in cases)
    requested = [name.upper() for name in named_cases(names, listed)]
    for name in requested:
        if not any(_is_named(case, [name]) for case in cases):
            raise InputError(f"--cases {name}: there are {listed}")
    picked = []
    for group in groups:
        named = tuple(case for case in group.cases if _is_named(case, requested))
        if named:
            picked.append(Group(group.title, named))
    return tuple(picked)


def _is_named(case: Case, names: list[str]) -> bool:
    # An id such as "V22a, A1" has two, each of which names the case.
    ids = case.id.upper().replace(",", " ").split()
    return any(id_.startswith(name) for id_ in ids for name in names)


def _plain(outcome: Outcome, group: str) -> _CaseResult:
    case = outcome.case
    return {
        "id": case.id,
        "group": group,
        "title": case.title,
        "source": case.source,
        "requirement": case.requirement,
        "method": case.method,
        "verdict": outcome.verdict,
        "took_s": round(outcome.seconds, 2),
        "rows": [_plain_row(row) for row in outcome.rows],
    }


def _plain_row(row: Row) -> _RowResult:
    fields = {name: _plain_number(value) for name, value in row._asdict().items()}
    del fields["if_met"], fields["order"]
    fields["checks"] = [
        _plain_fields(
            check,
            *("name", "unit", "computed"),
            *(("lowest", "highest") if check.expected is None else _OF_A_VALUE),
            "passes",
        )
        for check in row.checks
    ]
    plain = {key: value for key, value in fields.items() if value not in (None, "")}
    if row.order is not None:
        plain["order"] = _plain_fields(row.order, *_OF_AN_ORDER)
    plain["verdict"] = row.verdict
    return cast("_RowResult", plain)


_OF_A_VALUE = ("expected", "error", "tolerance")
_OF_AN_ORDER = ("sizes", "errors", "observed", "expected", "passes")


def _plain_fields(item: Any, *names: str) -> dict[str, Any]:
    return {name: _plain_number(getattr(item, name)) for name in names}


def _plain_number(value: Any) -> Any:
    # JSON has no NaN and no infinity: they are kept as text.
    if isinstance(value, tuple):
        return list(map(_plain_number, value))
    finite = not isinstance(value, float | int) or math.isfinite(value)
    return value if finite else str(value)
