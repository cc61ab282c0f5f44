"""Stacks of layers by name, those of the ground and of clothes: `stacks["asphalt"]`."""

import csv
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from typing_extensions import override

from ..errors import InputError
from .layer import Layer
from .named_table import AbstractNamedTable
from .table import similar_names


_TABLE = Path(__file__).parents[1] / "data" / "stacks.csv"


@dataclass(frozen=True)
class LayerRow:
    """One layer of a named stack.

    Attributes:
        stack: key in `stacks`.
        material: name of its material in `materials`.
        thickness: d [m].
        source: what the layer is, and the source of its thickness.
    """

    stack: str
    material: str
    thickness: float
    source: str


@functools.cache
def stack_rows() -> dict[str, tuple[LayerRow, ...]]:
    """Layers of all named stacks, from the top or front, by the name of the stack."""
    rows: dict[str, tuple[LayerRow, ...]] = {}
    with _TABLE.open(encoding="utf-8", newline="") as lines:
        for line in csv.DictReader(lines):
            row = LayerRow(
                stack=line["name"],
                material=line["material"],
                thickness=float(line["thickness_m"]),
                source=line["source"],
            )
            rows[row.stack] = (*rows.get(row.stack, ()), row)
    return rows


class _StackTable(AbstractNamedTable[tuple[Layer, ...]]):
    """Mapping of names to stacks of layers, each from the top or the front."""

    def __getitem__(self, name: str) -> tuple[Layer, ...]:
        rows = stack_rows()
        if name not in rows:
            hint = ", ".join(similar_names(name, rows) or rows)
            raise InputError(f"stack {name!r} is not known: did you mean {hint}?")
        return tuple(Layer(row.material, row.thickness) for row in rows[name])

    def __iter__(self) -> Iterator[str]:
        return iter(stack_rows())

    def __len__(self) -> int:
        return len(stack_rows())

    @property
    @override
    def known_names(self) -> Mapping[str, object]:
        return stack_rows()


stacks = _StackTable()
