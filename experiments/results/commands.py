"""`experiments compare` and `experiments report` at the terminal."""

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from jaxthermo.console.terminal import open_console, print_line, status
from jaxthermo.report.numbers import count
from jaxthermo.report.table import Cell, Table

from .changes import ABSENT, Change
from .compare import Comparison, compare
from .index_page import write_index
from .read import Damaged, find_results, read_result


_MAX_TEXT = 48


def compare_results(old: Path, new: Path, as_json: bool) -> None:
    """Print the changes between two results, or write them as JSON.

    Raises:
        InputError: if one of them cannot be read, or they are of two kinds.
    """
    comparison = compare(read_result(old), read_result(new))
    if as_json:
        sys.stdout.write(json.dumps(comparison.as_dict(), indent=2) + "\n")
    else:
        _show(open_console(), comparison)


def report_results(folder: Path) -> None:
    """Write the index page of a folder and print a summary.

    Raises:
        InputError: if the folder does not exist, holds no result or cannot be written.
    """
    console = open_console()
    with status(console, "reading the results"):
        results = list(find_results(folder))
        page = write_index(folder, results)
    damaged = [result for result in results if isinstance(result, Damaged)]
    for result in damaged:
        print_line(console, f"not readable: {result.file}: {result.reason}")
    print_line(console, f"{count(len(results) - len(damaged), 'result')} in {page}")


def _show(console: Console, comparison: Comparison) -> None:
    groups = (
        ("config", comparison.config),
        ("versions and machine", comparison.origin),
        ("numbers, beyond noise", comparison.numbers),
    )
    for title, changes in groups:
        if changes:
            console.print(_table(title, changes).rich(), soft_wrap=False)
    for remark in comparison.remarks:
        print_line(console, f"note: {remark}")
    changed = any(changes for _, changes in groups)
    last = "nothing else changed" if changed else "nothing changed"
    print_line(console, last)


def _table(title: str, changes: tuple[Change, ...]) -> Table:
    rows: list[list[str | Cell]] = [
        [change.key, _text(change.old), _text(change.new), change.note]
        for change in changes
    ]
    columns = ["", "old", "new", ""]
    # Without a note the column of notes is left out.
    if not any(change.note for change in changes):
        columns = columns[:3]
        rows = [row[:3] for row in rows]
    return Table(columns, rows, title=title, left=(0, 3), framed=False)


def _text(value: Any) -> str:
    if value is ABSENT:
        return "absent"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _MAX_TEXT else f"{text[: _MAX_TEXT - 3]}..."
