"""Files of a sweep's folder, as the front reads them."""

import base64
import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from jaxthermo.errors import InputError

from .pareto import Row


class SweepFolder(NamedTuple):
    """Rows of a sweep, and those of rivals that other commands have added."""

    path: Path
    rows: list[Row]
    """One per finished case, without failed ones."""
    failed: list[Row]
    times: list[Row]
    rivals: list[Row]

    @property
    def loads(self) -> set[str]:
        """Names of all loads."""
        return {row["load"] for row in (*self.rows, *self.failed)}

    def picture(self, name: str | None) -> str | None:
        """A picture of a row as base64; None without one."""
        if name is None or not (self.path / name).is_file():
            return None
        return base64.b64encode((self.path / name).read_bytes()).decode("ascii")


def read_folder(path: Path) -> SweepFolder:
    """Read the folder of a sweep.

    Raises:
        InputError: if it has no rows, or a file cannot be read.
    """
    rows = read_rows(path / "rows.jsonl")
    if not rows:
        raise InputError(
            f"{path}: holds no rows of a sweep: name the folder of an "
            "`experiments sweep`, or the config of one"
        )
    finished = [row for row in rows if "failed" not in row]
    failed = [row for row in rows if "failed" in row]
    return SweepFolder(
        path=path,
        rows=finished,
        failed=failed,
        times=read_rows(path / "times.jsonl"),
        rivals=read_rows(path / "rivals.jsonl"),
    )


def read_rows(path: Path) -> list[Row]:
    """Rows of a file, the last one of each id; none if there is no file."""
    try:
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: {reason}") from error
    rows: dict[Any, Row] = {}
    for number, line in enumerate(text.splitlines()):
        # The last line may be cut off, or being written.
        with suppress(json.JSONDecodeError):
            row = json.loads(line)
            if isinstance(row, dict):
                rows[row.get("id", number)] = row
    return list(rows.values())


def append_rows(path: Path, rows: Iterable[Row]) -> None:
    """Add rows to a file.

    Raises:
        InputError: if it cannot be written.
    """
    try:
        with path.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(row, allow_nan=False) + "\n" for row in rows)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
