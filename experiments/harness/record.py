"""Rows that are written as they are measured: an interrupted run continues."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.study.rows import Row, append_rows, read_rows
from jaxthermo.archive import text_hash
from jaxthermo.atomic import replacing
from jaxthermo.errors import InputError
from jaxthermo.memo.content_hash import code_hash


Arrays = dict[str, np.ndarray]


class Record:
    """Rows in `rows.jsonl` and `arrays/`, each under the fingerprint of its inputs."""

    def __init__(self, folder: Path, sources: tuple[Path, ...] = ()):
        # Of the experiment: its rows follow from these files, and from the library.
        self.sources = sources
        self.path = folder / "rows.jsonl"
        self.arrays = folder / "arrays"
        try:
            self.arrays.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"--out {folder}: {error.strerror}") from error
        self.rows: dict[str, Row] = {
            row["id"]: row
            for row in read_rows(self.path)
            if {"id", "arrays"} <= set(row)
        }

    def once(
        self, identity: Any, head: Row, make: Callable[[], tuple[Row, Arrays]]
    ) -> Row:
        """The row of an identity, from an earlier run or measured and stored now.

        Args:
            identity: plain values that the row follows from, without the programs.
            head: first fields of the row: its names.
            make: measures the rest; arrays go to a file of their own.
        """
        key = self._key(identity)
        if self.known(identity):
            return self.rows[key]
        clock = time.perf_counter()
        try:
            row, arrays = make()
        except InputError as error:
            # Measured again next time, when there may be more memory.
            row = {"refused": str(error)}
            arrays = {}
        took = time.perf_counter() - clock
        row = {"id": key, **head, **row, "took_s": took, "arrays": sorted(arrays)}
        if arrays:
            with replacing(self._array_file(key)) as temporary:
                np.savez(temporary, allow_pickle=False, **arrays)
        append_rows(self.path, [row])
        self.rows[key] = row
        return row

    def known(self, identity: Any) -> bool:
        """True if the row exists, with its arrays, and was not refused."""
        row = self.rows.get(self._key(identity), {"refused": "", "arrays": []})
        is_complete = not row["arrays"] or self._array_file(row["id"]).is_file()
        return "refused" not in row and is_complete

    def arrays_of(self, row: Row) -> Arrays:
        """The arrays of a row; an InputError if their file is damaged."""
        path = self._array_file(row["id"])
        try:
            with path.open("rb") as stream, np.load(stream) as arrays:
                return dict(arrays)
        except Exception as error:  # damaged bytes make the readers raise anything
            raise InputError(
                f"{path}: cannot be read ({type(error).__name__}): delete it, and the "
                "same command measures it again"
            ) from error

    def _key(self, identity: Any) -> str:
        return fingerprint([identity, program_hash(self.sources)])

    def _array_file(self, key: str) -> Path:
        return self.arrays / f"{key}.npz"


def program_hash(sources: tuple[Path, ...] = ()) -> str:
    """16 hex digits of the library and of `sources`, which rows follow from."""
    # Rows that an edited program measured must not be mixed with older ones.
    return code_hash(*sources)[:16]


def fingerprint(value: Any) -> str:
    """16 hex digits of plain values that a measurement follows from."""
    text = json.dumps(value, sort_keys=True)
    return text_hash(text)
