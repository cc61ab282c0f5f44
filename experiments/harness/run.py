"""Running cases and recording what came of them."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rich.console import Console

from .case import FAIL, PASS, REPORTED, VERDICTS, Group
from .outcome import Outcome, check, ids_of, plain
from .report import PageTexts, summary, terminal_tables, write_report


_CONSOLE_WIDTH = 150
"""Width of what is printed to a file [characters]."""


def run_cases(
    groups: Sequence[Group], folder: Path, texts: PageTexts, at_once: int = 1
) -> dict[str, Any]:
    """Run cases, print a table of each group and write `report.html`.

    Args:
        groups: the cases.
        folder: for the page.
        texts: of the page.
        at_once: cases that run at the same time; 1 where run times are compared.
    """
    begin, console = time.perf_counter(), Console()
    if not console.is_terminal:
        console = Console(width=_CONSOLE_WIDTH)
    found: list[tuple[Group, list[Outcome]]] = []
    pool = ThreadPoolExecutor(at_once)
    try:
        coming = [pool.map(check, group.cases) for group in groups]
        for group, each in zip(groups, coming, strict=True):
            outcomes = list(each)
            for table in terminal_tables(group.title, outcomes):
                console.print(table.rich())
            found.append((group, outcomes))
    finally:
        pool.shutdown(cancel_futures=True)
    outcomes = [outcome for _, each in found for outcome in each]
    console.print(summary(outcomes))
    took = time.perf_counter() - begin
    write_report(found, folder / "report.html", texts, took)
    rows = [row.verdict for outcome in outcomes for row in outcome.rows]
    return {
        "passed": ids_of(outcomes, PASS),
        "failed": ids_of(outcomes, FAIL),
        "reported": ids_of(outcomes, REPORTED),
        "verdicts": {verdict: rows.count(verdict) for verdict in VERDICTS},
        "cases": [plain(o, group.title) for group, each in found for o in each],
        "not_covered": [{"id": n, "reason": why} for n, why in texts.not_covered],
        "took_s": round(took, 1),
        "files": ["report.html"],
    }
