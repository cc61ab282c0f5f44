"""Rows on disk as they are made, so that a run that was cut off goes on."""

import hashlib
import json
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import jaxthermo
from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError

from .config import fingerprint


Row = dict[str, Any]
Arrays = dict[str, np.ndarray]


class Record:
    """`rows.jsonl` and `arrays/`, both by the fingerprint of what they follow from."""

    def __init__(self, folder: Path):
        """Read the rows that are there; those of other configs stay where they are."""
        self.path = folder / "rows.jsonl"
        self.arrays = folder / "arrays"
        self.rows: dict[str, Row] = {}
        self.reused = 0
        try:
            self.arrays.mkdir(parents=True, exist_ok=True)
            text = self.path.read_text(encoding="utf-8") if self.path.exists() else ""
        except OSError as error:
            raise InputError(f"--out {folder}: {error.strerror}") from error
        for line in text.splitlines():
            row = _parsed(line)
            if row is not None:
                self.rows[row["id"]] = row
        self.earlier = frozenset(self.rows)
        if text and not text.endswith("\n"):
            self._append("")  # the last one was cut off within a row

    def once(
        self, identity: Any, head: Row, make: Callable[[], tuple[Row, Arrays]]
    ) -> Row:
        """The row of that identity: kept from an earlier run, or made and kept now.

        Args:
            identity: plain values: all that the row follows from but the programs.
            head: what the row begins with: its names.
            make: measures the rest; arrays go to a file of their own.

        Returns:
            The row, with the seconds that it took; `refused` says why there is nothing
            else in it. Such a row is tried again next time: there may be more memory
            then.
        """
        key = _key(identity)
        if self.known(identity):
            # What this run made itself serves other claims too.
            self.reused += key in self.earlier
            return self.rows[key]
        clock = time.perf_counter()
        try:
            row, arrays = make()
        except InputError as error:
            row, arrays = {"refused": str(error)}, {}
        took = time.perf_counter() - clock
        row = {"id": key, **head, **row, "took_s": took, "arrays": sorted(arrays)}
        if arrays:
            with replacing(self._array_file(key)) as temporary:
                np.savez(temporary, allow_pickle=False, **arrays)
        self._append(json.dumps(row, allow_nan=False))
        self.rows[key] = row
        return row

    def known(self, identity: Any) -> bool:
        """Whether there is such a row already, with its arrays."""
        row = self.rows.get(_key(identity), {"refused": "", "arrays": []})
        whole = not row["arrays"] or self._array_file(row["id"]).is_file()
        return "refused" not in row and whole

    def arrays_of(self, row: Row) -> Arrays:
        """The arrays that belong to a row."""
        path = self._array_file(row["id"])
        try:
            with path.open("rb") as stream, np.load(stream) as kept:
                return dict(kept)
        except Exception as error:  # damaged bytes make the readers raise anything
            raise InputError(
                f"{path}: cannot be read ({type(error).__name__}): delete it, and the "
                "same command measures it again"
            ) from error

    def _array_file(self, key: str) -> Path:
        return self.arrays / f"{key}.npz"

    def _append(self, line: str) -> None:
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise InputError(f"cannot write {self.path}: {error.strerror}") from error


def _key(identity: Any) -> str:
    return fingerprint([identity, program_hash()])


def _parsed(line: str) -> Row | None:
    """A row; None for a line that was cut off."""
    try:
        row = json.loads(line)
    except json.JSONDecodeError:
        return None
    return row if isinstance(row, dict) and {"id", "arrays"} <= set(row) else None


MEASURING = (
    "cases",
    "config",
    "equilibrium",
    "frames",
    "levels",
    "measure",
    "runner",
    "study",
)
"""The modules here that rows follow from; the others only draw and tell them."""


@cache
def program_hash() -> str:
    """Of what measures, the library included: rows of edited programs do not mix."""
    digest = hashlib.sha256()
    here = [Path(__file__).with_name(f"{name}.py") for name in MEASURING]
    for path in (*sorted(Path(jaxthermo.__file__).parent.rglob("*.py")), *here):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
