"""The stiff and extreme cases: `experiments run stiff`."""

import time
from pathlib import Path
from typing import Any

from rich.console import Console

from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError

from . import (
    air,
    cold,
    contrasts,
    digits,
    emission,
    islands,
    light,
    meshes,
    parameters,
    scales,
    times,
    touching,
)
from .case import Case, Row, rows_of
from .tables import case_table, counts, page_of


MODULES = (
    contrasts,
    scales,
    emission,
    cold,
    digits,
    touching,
    islands,
    meshes,
    air,
    light,
    parameters,
    times,
)
CASES = tuple(
    sorted((c for module in MODULES for c in module.CASES), key=lambda c: c.name)
)

WIDTH = 132
"""Of what is printed to a file."""


def chosen(names: str | None) -> tuple[Case, ...]:
    """Cases by name; all of them for None.

    Args:
        names: such as "S01,S06".

    Raises:
        InputError: for one that there is not.
    """
    if names is None:
        return CASES
    known = {case.name: case for case in CASES}
    wanted = [name.strip().upper() for name in names.split(",") if name.strip()]
    for name in wanted:
        if name not in known:
            raise InputError(f"--cases {name}: there are {', '.join(known)}")
    if not wanted:
        raise InputError(f"--cases {names!r} names none: there are {', '.join(known)}")
    return tuple(known[name] for name in wanted)


def run(folder: Path, cases: str | None = None) -> dict[str, Any]:
    """Run the cases and write `report.html`.

    Args:
        folder: for the page.
        cases: their names, with commas between; all if not given.
    """
    console, found, clock = _console(), [], time.perf_counter()
    spans = {}
    for case in chosen(cases):
        begin = time.perf_counter()
        rows = list(rows_of(case))
        spans[case.name] = time.perf_counter() - begin
        console.print(case_table(case, rows))
        found.append((case, rows))
    took = time.perf_counter() - clock
    every = [row for _, rows in found for row in rows]
    console.print(", ".join(f"{n} {verdict}" for verdict, n in counts(every).items()))
    with replacing(folder / "report.html") as path:
        path.write_text(page_of(found, took), encoding="utf-8")
    return {
        "verdicts": counts(every),
        "took_s": took,
        "cases": [
            {
                "case": case.name,
                "title": case.title,
                "holds": case.holds,
                "source": case.source,
                "took_s": spans[case.name],
                "rows": [plain(row) for row in rows],
            }
            for case, rows in found
        ],
        "files": ["report.html"],
    }


def _console() -> Console:
    """As wide as the terminal; wide enough for a table where there is none."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)


def plain(row: Row) -> dict[str, Any]:
    """A row in types that JSON has; numbers that it has not, as text."""
    fields = {**row._asdict(), "verdict": row.verdict}
    del fields["if_met"]
    fields["checks"] = [
        {
            "what": check.what,
            "found": _number(float(check.found)),
            "least": _number(float(check.least)),
            "most": _number(float(check.most)),
            "met": bool(check.met),
        }
        for check in row.checks
    ]
    return {name: _number(value) for name, value in fields.items()}


def _number(value: Any) -> Any:
    """JSON has neither NaN nor infinity."""
    odd = isinstance(value, float) and value - value != 0
    return str(value) if odd else value
