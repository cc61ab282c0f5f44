"""All exhibits: found by name, measured once each, and put on one page.

A measurement is stored when it ends; one that was interrupted goes on with the next.
"""

import difflib
import hashlib
import importlib
import pkgutil
import time
from functools import cache
from pathlib import Path
from typing import Any

import jax

import calibrate
from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError

from ..harness.case import described
from ..harness.meshes import thesis_meshes
from ..harness.record import Record
from . import exhibits
from .bodies import CONFIGS
from .claims import CLAIMS
from .exhibit import Exhibit, Finding, Verdict, skipped
from .report import (
    Measured,
    claim_results,
    claim_table,
    write_files,
    write_report,
)
from .stored import Plain, store


QUICK = {"quick": True}

_FOLDER = Path(__file__).parent
# Of a row in the record: what it follows from, beside the library and the sources.
_SHARED = (
    *(
        path
        for folder in ("thesis", "harness", "verification", "sweep")
        for path in (_FOLDER.parent / folder).glob("*.py")
    ),
    *Path(str(calibrate.__file__)).parent.rglob("*.py"),
    *CONFIGS.rglob("*.yaml"),
)
# Files that only arrange what was measured.
_ARRANGING = ("claims.py", "exhibition.py", "report.py")


def all_exhibits() -> tuple[Exhibit, ...]:
    """The exhibits of all modules in `exhibits/`, in the order of the thesis."""
    return tuple(exhibit for _, exhibit in _with_sources())


def _order(exhibit: Exhibit) -> tuple[int, str, list[int], str]:
    # Tables and figures by number, "figure-4.10" after "figure-4.9".
    kind, _, number = exhibit.name.partition("-")
    digits = [int(part) for part in number.split(".") if part.isdigit()]
    return exhibit.chapter, kind, digits, exhibit.name


@cache
def _with_sources() -> list[tuple[Path, Exhibit]]:
    """Every exhibit with the file of its module."""
    found = []
    for item in pkgutil.iter_modules(exhibits.__path__):
        module = importlib.import_module(f"{exhibits.__name__}.{item.name}")
        own = getattr(module, "EXHIBITS", None) or (module.EXHIBIT,)
        found += [(Path(str(module.__file__)), exhibit) for exhibit in own]
    return sorted(found, key=lambda pair: _order(pair[1]))


def select(names: str | None) -> tuple[Exhibit, ...]:
    """Exhibits by their names or the ids of their claims ("figure-4.3,C09"); or all.

    Raises:
        InputError: for an unknown name.
    """
    every = all_exhibits()
    if names is None:
        return every
    wanted = [name.strip().lower() for name in names.split(",") if name.strip()]
    known = [e.name for e in every] + [claim.id for claim in CLAIMS]
    listed = ", ".join(e.name for e in every)
    if not wanted:
        raise InputError(f"--cases {names!r} names none: there are {listed}")
    for name in wanted:
        if name not in [k.lower() for k in known]:
            close = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise InputError(
                f"--cases {name}: {hint}there are C01 to {CLAIMS[-1].id}, {listed}"
            )
    is_wanted = lambda e: {e.name, *(c.lower() for c in e.claims)} & set(wanted)
    return tuple(exhibit for exhibit in every if is_wanted(exhibit))


def run(folder: Path, cases: str | None = None, quick: bool = False) -> dict[str, Any]:
    """Measure exhibits, all or those that `cases` names, and write `report.html`.

    The page has what the folder already holds of the others, in the same size.
    """
    wanted, begin, console = select(cases), time.perf_counter(), open_console()
    of_all = {"quick": quick, "meshes": _mesh_hashes()}
    measured: list[Measured] = []
    for source, exhibit in _with_sources():
        record = Record(folder, _sources(source))
        identity = {"exhibit": exhibit.name, **of_all}
        known = record.known(identity)
        if known or exhibit in wanted:
            measured.append(_measured(record, identity, exhibit))
            write_files(measured[-1], folder)
        if exhibit in wanted and not known:
            plain = measured[-1].plain
            took = f"{plain['verdict']}, {plain['took_s']:.0f} s"
            console.print(f"{exhibit.name}: {exhibit.title}: {took}")
            # Each program takes mappings of memory, of which a process has so many:
            # without this the last exhibits of the full size cannot be compiled.
            jax.clear_caches()
            # After each one, so that an interrupted run leaves a page.
            write_report(measured, folder, quick)
    write_report(measured, folder, quick)
    console.print(claim_table(measured, on_page=False).rich(), soft_wrap=False)
    files = [name for each in measured for name in sorted(each.files)]
    return {
        "claims": claim_results(measured),
        "exhibits": [each.result() for each in measured],
        "took_s": round(time.perf_counter() - begin, 1),
        "files": ["report.html", *files],
    }


def _measured(record: Record, identity: Plain, exhibit: Exhibit) -> Measured:
    clock = time.perf_counter()
    make = lambda: store(exhibit.measure(identity["quick"]))
    try:
        row = record.once(identity, {"exhibit": exhibit.name}, make)
    except Exception as error:  # one broken exhibit must not stop the others
        finding = Finding(Verdict.FAILED, described(error))
    else:
        if "refused" not in row:
            files = record.arrays_of(row) if row["arrays"] else {}
            return Measured(exhibit, row, files)
        finding = skipped(row["refused"])
    plain, files = store(finding)
    took = time.perf_counter() - clock
    return Measured(exhibit, {**plain, "took_s": took}, files)


def _sources(own: Path) -> tuple[Path, ...]:
    shared = [path for path in _SHARED if path.name not in _ARRANGING]
    return (*sorted(shared), own)


@cache
def _mesh_hashes() -> dict[str, str]:
    """Fingerprints of the meshes that exhibits find, by name."""
    found = {}
    for name, mesh in thesis_meshes().items():
        digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes())
        found[name] = digest.hexdigest()[:16]
    return found
