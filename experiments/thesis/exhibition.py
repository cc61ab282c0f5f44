"""All exhibits: found by name, measured once each, and put on one page.

A measurement is stored when it ends; one that was interrupted goes on with the next.
"""

import difflib
import hashlib
import importlib
import io
import pkgutil
import sys
import time
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from PIL import Image

import calibrate
from jaxthermo.console.terminal import open_console
from jaxthermo.errors import InputError
from jaxthermo.report.chart import chart_svg

from ..harness.case import described, named_cases
from ..harness.meshes import thesis_meshes
from ..harness.record import Arrays, Record
from . import exhibits
from .bodies import CONFIGS
from .exhibit import CLAIMS, REGISTERED, Exhibit, Finding, Verdict
from .report import Measured, claim_results, claim_table, write_files, write_report
from .statements import title_of


QUICK = {"quick": True}

_FOLDER = Path(__file__).parent
# Files that only arrange what was measured.
_ARRANGING = ("exhibition.py", "report.py", "statements.py")
# What a row in the record follows from, in addition to the library and its module.
_SHARED = tuple(
    path
    for path in (
        *sorted(
            path
            for folder in ("thesis", "harness", "verification", "benchmarks")
            for path in (_FOLDER.parent / folder).glob("*.py")
        ),
        *sorted(Path(str(calibrate.__file__)).parent.rglob("*.py")),
        *sorted(CONFIGS.rglob("*.yaml")),
    )
    if path.name not in _ARRANGING
)


@cache
def all_exhibits() -> tuple[Exhibit, ...]:
    """The exhibits of all modules in `exhibits/`, in the order of the thesis."""
    for module in pkgutil.iter_modules(exhibits.__path__):
        importlib.import_module(f"{exhibits.__name__}.{module.name}")
    return tuple(sorted(REGISTERED, key=lambda exhibit: exhibit.order))


def select(names: str | None) -> tuple[Exhibit, ...]:
    """Exhibits by their names or the ids of their claims ("figure-4.3,C09"); or all.

    Raises:
        InputError: for an unknown name.
    """
    if names is None:
        return all_exhibits()
    exhibit_names = [exhibit.name for exhibit in all_exhibits()]
    all_names = exhibit_names + [claim.id for claim in CLAIMS]
    listed = ", ".join(exhibit_names)
    requested = {name.lower() for name in named_cases(names, listed)}
    for name in sorted(requested - {name.lower() for name in all_names}):
        close = difflib.get_close_matches(name, all_names, 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise InputError(
            f"--cases {name}: {hint}there are C01 to {CLAIMS[-1].id}, {listed}"
        )
    return tuple(
        exhibit
        for exhibit in all_exhibits()
        if requested & {exhibit.name, *(claim.lower() for claim in exhibit.claims)}
    )


def run(folder: Path, cases: str | None = None, quick: bool = False) -> dict[str, Any]:
    """Measure exhibits, all or those that `cases` names, and write `report.html`.

    The page has what the folder already holds of the others, in the same size.
    """
    requested = select(cases)
    begin = time.perf_counter()
    console = open_console()
    conditions = {"quick": quick, "meshes": _mesh_hashes()}
    measured: list[Measured] = []
    for exhibit in all_exhibits():
        record = Record(folder, sources(exhibit))
        identity = {"exhibit": exhibit.name, **conditions}
        is_stored = record.known(identity)
        if not is_stored and exhibit not in requested:
            continue
        result = _measured(record, identity, exhibit)
        measured.append(result)
        write_files(result, folder)
        if not is_stored:
            outcome = f"{result.verdict}, {result.seconds:.0f} s"
            console.print(f"{exhibit.name}: {title_of(exhibit.name)}: {outcome}")
            # Programs take mappings of memory, whose number is limited in a process:
            # without this the last exhibits of the full size cannot be compiled.
            jax.clear_caches()
            # After each one, so that an interrupted run leaves a page.
            write_report(measured, folder, quick)
    write_report(measured, folder, quick)
    console.print(claim_table(measured, on_page=False).rich(), soft_wrap=False)
    files = [name for result in measured for name in sorted(result.files)]
    return {
        "claims": claim_results(measured),
        "exhibits": [result.plain() for result in measured],
        "took_s": round(time.perf_counter() - begin, 1),
        "files": ["report.html", *files],
    }


def _measured(
    record: Record, identity: Mapping[str, Any], exhibit: Exhibit
) -> Measured:
    begin = time.perf_counter()
    measure = partial(exhibit.measure, identity["quick"])
    verdict = Verdict.FAILED
    try:
        row = record.once(
            identity, {"exhibit": exhibit.name}, lambda: _store(measure())
        )
    except Exception as error:  # one broken exhibit must not stop the others
        failure = described(error)
    else:
        if "refused" not in row:
            files = record.arrays_of(row) if row["arrays"] else {}
            return Measured(
                exhibit=exhibit,
                verdict=Verdict(row["verdict"]),
                seconds=row["took_s"],
                numbers=row["numbers"],
                claims={key: Verdict(value) for key, value in row["claims"].items()},
                files=files,
            )
        verdict = Verdict.SKIPPED
        failure = row["refused"]
    seconds = time.perf_counter() - begin
    return Measured(exhibit, verdict=verdict, seconds=seconds, failure=failure)


def _store(finding: Finding) -> tuple[dict[str, Any], Arrays]:
    """A finding in types that JSON has, and its pictures as the bytes of files."""
    files: Arrays = {}
    for name, picture in finding.pictures.items():
        if isinstance(picture, Image.Image):
            file = f"{name}.png"
            stream = io.BytesIO()
            picture.save(stream, "PNG", optimize=True)
            content = stream.getvalue()
        else:
            file = f"{name}.svg"
            content = chart_svg(picture).encode("utf-8")
        files[file] = np.frombuffer(content, np.uint8)
    row = {
        "verdict": str(finding.verdict),
        "claims": {claim: str(verdict) for claim, verdict in finding.claims.items()},
        "numbers": plain(finding.numbers),
    }
    return row, files


def plain(value: Any) -> Any:
    """Nested values in types that JSON has; what is not finite becomes None."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {_key(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _key(key: Any) -> str:
    return f"{key:g}" if isinstance(key, float) else str(key)


def sources(exhibit: Exhibit) -> tuple[Path, ...]:
    """Files that the measurement of an exhibit follows from, besides the library."""
    module = sys.modules[exhibit.measure.__module__]
    return (*_SHARED, Path(str(module.__file__)))


@cache
def _mesh_hashes() -> dict[str, str]:
    """Fingerprints of the meshes that exhibits find, by name."""
    hashes = {}
    for name, mesh in thesis_meshes().items():
        digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes())
        hashes[name] = digest.hexdigest()[:16]
    return hashes
