"""Rows of finished cases in a folder: appended one by one, never mixed, resumed.

A process that is killed while it writes leaves half a line, which the next one drops.
"""

import fcntl
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from jaxthermo.atomic import remove_leftovers, replacing, write_text
from jaxthermo.errors import InputError


Row = dict[str, Any]
"""A line of rows.jsonl, times.jsonl or rivals.jsonl, of any version."""

_CLAIM = "config_hash.txt"
_SUPERSEDED = "superseded.jsonl"


def claim_folder(folder: Path, config_hash: str) -> None:
    """Make a folder that of a config, so that no other config's rows get into it.

    Raises:
        InputError: if it is another one's, or cannot be written.
    """
    path = folder / _CLAIM
    try:
        folder.mkdir(parents=True, exist_ok=True)
        owner = path.read_text(encoding="utf-8").strip() if path.exists() else None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"--out {folder}: {reason}; name a folder") from error
    if owner is None and (folder / "rows.jsonl").exists():
        owner = "unknown"
    if owner not in (None, config_hash):
        raise InputError(
            f"--out {folder}: holds the rows of another config ({owner}, this one is "
            f"{config_hash}): give another folder, or delete this one"
        )
    remove_leftovers(folder)
    if owner is None:
        write_text(path, config_hash + "\n")


def read_rows(path: Path) -> list[Row]:
    """Rows of a file, the last one of each id; none if there is no file.

    Raises:
        InputError: if it cannot be read.
    """
    try:
        content = path.read_bytes() if path.is_file() else b""
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    rows: dict[object, Row] = {}
    for number, row in enumerate(_finished_rows(content)):
        rows[row.get("id", number)] = row
    return list(rows.values())


def append_rows(path: Path, rows: Iterable[Row]) -> None:
    """Add rows to a file, below a line that was cut off, if any.

    Raises:
        InputError: if it cannot be written.
    """
    lines = [json.dumps(row, allow_nan=False) + "\n" for row in rows]
    try:
        with path.open("a+", encoding="utf-8") as file:
            file.seek(0)
            content = file.read()
            if content and not content.endswith("\n"):
                lines.insert(0, "\n")
            file.writelines(lines)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error


def _finished_rows(content: bytes) -> Iterator[Row]:
    """Rows in the content of a file, without lines that were cut off."""
    for line in content.splitlines():
        with suppress(ValueError, RecursionError):
            row = json.loads(line)
            if isinstance(row, dict):
                yield row


class Rows:
    """Rows in a file of JSON lines, the last one of each id."""

    def __init__(self, path: Path, program: str):
        """Read the rows that this program wrote; those of others are put aside.

        Args:
            path: of the file, in a folder that is claimed.
            program: hash of the program, in the field `program` of every row.

        Raises:
            InputError: if another process writes to the file, or it cannot be read.
        """
        self.path = path
        self._program = program
        self.by_id: dict[str, Row] = {}
        try:
            # A file of its own: the one with the rows may be replaced.
            self._lock = (path.parent / f".{path.stem}.lock").open("w")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise InputError(
                f"{path}: another process writes to it: wait for its end, or give "
                "another --out"
            ) from error
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror}") from error
        self._read()

    def close(self) -> None:
        """Let other processes write to the file."""
        self._lock.close()

    def _read(self) -> None:
        content = self.path.read_bytes() if self.path.exists() else b""
        finished = content[: content.rfind(b"\n") + 1]
        superseded = []
        for row in _finished_rows(finished):
            if "id" not in row:
                continue
            if row.get("program") == self._program:
                self.by_id[row["id"]] = row
            else:
                superseded.append(row)
        if superseded:
            append_rows(self.path.parent / _SUPERSEDED, superseded)
        if superseded or len(finished) < len(content):
            self._rewrite()

    def drop_failed(self) -> int:
        """Forget the rows of failed cases; return their number."""
        failed = [key for key, row in self.by_id.items() if "failed" in row]
        for key in failed:
            del self.by_id[key]
        if failed:
            self._rewrite()
        return len(failed)

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows, and wait until they are on the disk.

        Raises:
            InputError: if the disk is full or fails; earlier rows are kept.
        """
        new_rows = [{**row, "program": self._program} for row in rows]
        text = "".join(json.dumps(row, allow_nan=False) + "\n" for row in new_rows)
        end = self.path.stat().st_size if self.path.exists() else 0
        earlier = len(self.by_id)
        # Before they are written: an interrupt just after counts them.
        self.by_id |= {row["id"]: row for row in new_rows}
        try:
            with self.path.open("ab") as file:
                file.write(text.encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            # What was written of a row would stand before the next one. After closing,
            # which writes again what is left.
            with suppress(OSError):
                os.truncate(self.path, end)
            raise InputError(
                f"cannot write {self.path}: {error.strerror}; the {earlier} "
                "rows before are kept, and the same command goes on from there"
            ) from error

    def _rewrite(self) -> None:
        with replacing(self.path) as temporary:
            lines = (json.dumps(row) + "\n" for row in self.by_id.values())
            temporary.write_text("".join(lines), encoding="utf-8")
