"""`experiments run verification`: every published case that can be expressed here."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rich.console import Console

from jaxthermo.errors import InputError

from . import (
    bars,
    bridges,
    contacts,
    enclosure,
    fins_and_shells,
    half_spaces,
    mosaic,
    pictures,
    radiation,
    round_and_square,
    slabs,
    walls,
)
from .case import Case, Group
from .report import cases_table, summary, write_page
from .running import FAILED, PASSED, REPORTED, Outcome, named, plain, run_case
from .uncovered import NOT_COVERED


GROUPS = (
    Group(
        "Half-spaces, slabs and bars in time",
        (*half_spaces.CASES, *slabs.CASES, *bars.CASES),
    ),
    Group("Contact", contacts.CASES),
    Group("Round and square bodies in time", round_and_square.CASES),
    Group("Steady walls", (*walls.CASES, *mosaic.CASES)),
    Group("Steady bodies", (*fins_and_shells.CASES, *bridges.CASES)),
    Group(
        "Radiation, convection, pictures",
        (*radiation.CASES, *enclosure.CASES, *pictures.CASES),
    ),
)


AT_ONCE = 2
"""Cases: most of their time they are compiled, which takes one core."""

WIDTH = 150
"""Of what is printed to a file."""


def chosen(names: str | None) -> tuple[Group, ...]:
    """The groups, with the cases that are meant.

    Args:
        names: beginnings of ids with commas between, such as "V21,A1"; None for all.

    Raises:
        InputError: for one that no case has.
    """
    if names is None:
        return GROUPS
    wanted = [name.strip().upper() for name in names.split(",") if name.strip()]
    every = [case for group in GROUPS for case in group.cases]
    for name in wanted:
        if not any(_meant(case, [name]) for case in every):
            known = "; ".join(case.id for case in every)
            raise InputError(f"--cases {name}: there are {known}")
    if not wanted:
        raise InputError(f"--cases {names!r} names none: give some, such as V21,A1")
    picked = (
        Group(group.title, tuple(c for c in group.cases if _meant(c, wanted)))
        for group in GROUPS
    )
    return tuple(group for group in picked if group.cases)


def _meant(case: Case, names: list[str]) -> bool:
    """Whether a part of its id begins with one of the names."""
    parts = case.id.upper().replace(",", " ").split()
    return any(part.startswith(name) for part in parts for name in names)


def run(folder: Path, cases: str | None = None) -> dict[str, Any]:
    """Run cases; `report.html` has them all, those that fail first.

    Args:
        folder: for the page.
        cases: beginnings of their ids with commas between; all if not given.
    """
    begin, console = time.perf_counter(), Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    found: list[tuple[Group, list[Outcome]]] = []
    groups, pool = chosen(cases), ThreadPoolExecutor(AT_ONCE)
    try:
        coming = [pool.map(run_case, group.cases) for group in groups]
        for group, each in zip(groups, coming, strict=True):
            outcomes = list(each)
            console.print(cases_table(group.title, outcomes))
            found.append((group, outcomes))
    finally:
        pool.shutdown(cancel_futures=True)
    every = [outcome for _, outcomes in found for outcome in outcomes]
    console.print(summary(every))
    write_page(found, folder / "report.html")
    return {
        "passed": named(every, PASSED),
        "failed": named(every, FAILED),
        "reported": named(every, REPORTED),
        "cases": [plain(o, group.title) for group, each in found for o in each],
        "not_covered": [{"id": name, "why": why} for name, why in NOT_COVERED],
        "took_s": round(time.perf_counter() - begin, 1),
    }


def find_case(id_: str) -> Case:
    """The case of that id."""
    return next(c for group in GROUPS for c in group.cases if c.id == id_)
