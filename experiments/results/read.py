"""Results folders of all commands: their kind, their content, and their damage."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

from calibrate.config.fit_record import read_fit
from calibrate.study.rows import Row, read_rows
from jaxthermo.archive import check_regular, read_record
from jaxthermo.errors import InputError


Kind = Literal["run", "fit", "sweep", "experiment", "reduced model", "plan"]

NOT_AS_WRITTEN = (KeyError, TypeError, ValueError, IndexError, AttributeError)
"""Errors of a program that reads values of another form than it expects."""
# In the order in which they are searched for in a folder.
_FILES = ("fit.json", "summary.json", "result.json", "plan.json")
_ROWS = "rows.jsonl"
_TIMES = "times.jsonl"
# Folders of files that belong to a result.
_PARTS = frozenset({"frames", "arrays", "pictures", "contacts", "__pycache__"})
_MAKERS = "`jaxthermo simulate`, `calibrate fit` or `experiments` wrote"
# Keys without which a file is something else, or damaged.
_REQUIRED = {
    "run": ("receipt", "bodies", "config", "times_s"),
    "reduced model": ("config", "size"),
    "sweep": ("config",),
    "experiment": ("experiment", "result"),
}


@dataclass(frozen=True)
class Result:
    """One result as it is stored."""

    kind: Kind
    file: Path
    content: Mapping[str, Any]
    """Content of the file."""
    rows: tuple[Row, ...] = ()
    """Rows of a sweep or an experiment, the last one of each id."""
    times: dict[str, list[float]] = field(default_factory=dict)
    """Times of the compiled loop of a sweep's rows [s], by the row's id."""

    @property
    def folder(self) -> Path:
        """The folder of all its files."""
        return self.file.parent

    @property
    def body(self) -> Mapping[str, Any]:
        """Values of the result; those of an experiment are in its entry `result`."""
        return self.content["result"] if self.kind == "experiment" else self.content

    @property
    def config(self) -> Mapping[str, Any]:
        """The resolved config; empty if it has none."""
        config = self.body.get("config")
        return config if isinstance(config, dict) else {}

    @property
    def config_hash(self) -> str | None:
        """Hash of the resolved config."""
        return self.content.get("config_hash") or self.body.get("config_hash")

    @property
    def name(self) -> str:
        """Name of the config or the experiment, else of the folder."""
        named = self.config.get("name")
        if self.kind == "sweep" and "scene" in self.config:
            named = Path(str(self.config["scene"])).stem
        if self.kind == "experiment":
            named = self.content["experiment"]
        return str(named or self.content.get("name") or self.folder.resolve().name)

    @property
    def date(self) -> datetime:
        """Time of the end of the run; that of the file if the result has none."""
        try:
            return datetime.fromisoformat(self.content["date"]).astimezone(UTC)
        except NOT_AS_WRITTEN:
            return datetime.fromtimestamp(self.file.stat().st_mtime, UTC)


class Damaged(NamedTuple):
    """A result that cannot be read, with the reason."""

    file: Path
    reason: str


def read_result(path: Path) -> Result:
    """Read a result from its folder, or from its file in it.

    Raises:
        InputError: if there is none, or it cannot be read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such folder; name one that {_MAKERS}")
    if not path.is_dir():
        return _read(path.parent / "result.json" if path.name == _ROWS else path)
    for name in _FILES:
        if (path / name).exists():
            return _read(path / name)
    if (path / _ROWS).exists():
        raise InputError(f"{path}: {_UNFINISHED}")
    raise InputError(f"{path}: no result ({', '.join(_FILES)}); name what {_MAKERS}")


def find_results(folder: Path) -> Iterator[Result | Damaged]:
    """All results in a folder and below it, and those that cannot be read.

    Raises:
        InputError: if there is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name one with results")
    for subfolder, below, files in os.walk(folder):
        hidden = {name for name in below if name.startswith(".")}
        below[:] = sorted(set(below) - hidden - _PARTS)
        result_files = [Path(subfolder) / name for name in _FILES if name in files]
        for file in result_files:
            try:
                yield _read(file)
            except InputError as error:
                yield Damaged(file, str(error).removeprefix(f"{file}: "))
        if not result_files and _ROWS in files:
            yield Damaged(Path(subfolder) / _ROWS, _UNFINISHED)


_UNFINISHED = "not finished: it has rows, and no result.json; the same command goes on"


def _read(file: Path) -> Result:
    if file.name == "fit.json":
        return Result("fit", file=file, content=dict(read_fit(file)))
    if file.name == "plan.json":
        record = read_record(
            file, format_name="plan", version=1, remedy="run `calibrate plan` again"
        )
        content = record | record.get("provenance", {})
        return Result("plan", file=file, content=content)
    content = _read_json(file)
    kind = _kind(file, content)
    if missing := [key for key in _REQUIRED[kind] if key not in content]:
        raise InputError(f"{file}: {missing[0]} is missing: damaged, or no result")
    if kind == "experiment" and not isinstance(content["result"], dict):
        raise InputError(f"{file}: result has no values: damaged, or no result")
    if kind in ("run", "reduced model"):
        return Result(kind, file=file, content=content)
    times = {
        row["id"]: row["loop_s"]
        for row in read_rows(file.with_name(_TIMES))
        if "id" in row and isinstance(row.get("loop_s"), list)
    }
    return Result(
        kind=kind,
        file=file,
        content=content,
        rows=tuple(row for row in read_rows(file.with_name(_ROWS)) if "id" in row),
        times=times,
    )


def _kind(file: Path, content: Mapping[str, Any]) -> Literal[Kind]:
    if file.name == "summary.json":
        return "reduced model" if content.get("kind") == "reduced model" else "run"
    return "sweep" if content.get("experiment", "sweep") == "sweep" else "experiment"


def _read_json(file: Path) -> Mapping[str, Any]:
    check_regular(file, f"name what {_MAKERS}")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: damaged ({reason})") from error
    if not isinstance(content, dict):
        raise InputError(f"{file}: damaged, or no result")
    return content
