"""Running cases that are selected by name, and recording what came of them."""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError

from .case import FAIL, PASS, REFUSED, REPORTED, Bound, Case, Group, Outcome, Row, check
from .report import PageTexts, ids_of, summary, terminal_tables, write_report


def run_cases(
    groups: Sequence[Group],
    names: str | None,
    folder: Path,
    texts: PageTexts,
    at_once: int = 1,
) -> dict[str, Any]:
    """Run cases, all or those whose ids begin with one of the names ("V21,A1").

    Prints a table of each group and writes `report.html`. `at_once` cases run at the
    same time: 1 where run times are compared. An unknown name is an InputError.
    """
    groups = _select(groups, names)
    begin, console = time.perf_counter(), open_console()
    found: list[tuple[Group, list[Outcome]]] = []
    pool = ThreadPoolExecutor(at_once)
    try:
        # All groups are handed in at once: no thread waits at the end of a group.
        coming = [pool.map(check, group.cases) for group in groups]
        for group, each in zip(groups, coming, strict=True):
            outcomes = list(each)
            for table in terminal_tables(group.title, outcomes):
                # Long texts fold on a terminal, where this console lets lines run on.
                console.print(table.rich(), soft_wrap=False)
            found.append((group, outcomes))
    finally:
        # After an interrupt the cases that have not begun would run to their end.
        pool.shutdown(cancel_futures=True)
    outcomes = [outcome for _, each in found for outcome in each]
    console.print(summary(outcomes), soft_wrap=False)
    took = time.perf_counter() - begin
    write_report(found, path=folder / "report.html", texts=texts, took=took)
    rows = [row.verdict for outcome in outcomes for row in outcome.rows]
    return {
        "passed": ids_of(outcomes, PASS),
        "failed": ids_of(outcomes, FAIL),
        "reported": ids_of(outcomes, REPORTED),
        "verdicts": {v: rows.count(v) for v in (PASS, REFUSED, REPORTED, FAIL)},
        "cases": [_plain(o, group.title) for group, each in found for o in each],
        "not_covered": [{"id": n, "reason": why} for n, why in texts.not_covered],
        "took_s": round(took, 1),
        "files": ["report.html"],
    }


def _select(groups: Sequence[Group], names: str | None) -> tuple[Group, ...]:
    if names is None:
        return tuple(groups)
    wanted = [name.strip().upper() for name in names.split(",") if name.strip()]
    cases = [case for group in groups for case in group.cases]
    known = "there are " + "; ".join(case.id for case in cases)
    if not wanted:
        raise InputError(f"--cases {names!r} names none: {known}")
    for name in wanted:
        if not any(_is_named(case, [name]) for case in cases):
            raise InputError(f"--cases {name}: {known}")
    picked = (
        Group(group.title, tuple(c for c in group.cases if _is_named(c, wanted)))
        for group in groups
    )
    return tuple(group for group in picked if group.cases)


def _is_named(case: Case, names: list[str]) -> bool:
    # An id such as "V22a, A1" is found by each of its parts.
    parts = case.id.upper().replace(",", " ").split()
    return any(part.startswith(name) for part in parts for name in names)


def _plain(outcome: Outcome, group: str) -> dict[str, Any]:
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


def _plain_row(row: Row) -> dict[str, Any]:
    fields = {name: _number(value) for name, value in row._asdict().items()}
    del fields["if_met"], fields["order"]
    fields["checks"] = [
        _numbers(
            check,
            *("name", "unit", "computed"),
            *(("lowest", "highest") if isinstance(check, Bound) else _OF_A_VALUE),
            "passes",
        )
        for check in row.checks
    ]
    found = {k: v for k, v in fields.items() if v not in (None, "")}
    if row.order is not None:
        found["order"] = _numbers(row.order, *_OF_AN_ORDER)
    return {**found, "verdict": row.verdict}


_OF_A_VALUE = ("expected", "error", "tolerance")
_OF_AN_ORDER = ("sizes", "errors", "observed", "expected", "passes")


def _numbers(item: Any, *names: str) -> dict[str, Any]:
    return {name: _number(getattr(item, name)) for name in names}


def _number(value: Any) -> Any:
    # JSON has no NaN and no infinity: they are kept as text.
    if isinstance(value, tuple):
        return list(map(_number, value))
    finite = not isinstance(value, float | int) or math.isfinite(value)
    return value if finite else str(value)
