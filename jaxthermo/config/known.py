"""Names that configs may use, read from the data files: their modules import jax."""

import csv
import json
from functools import cache
from pathlib import Path


_PACKAGE = Path(__file__).parents[1]


@cache
def material_names() -> tuple[str, ...]:
    """Names and aliases of `jaxthermo.material.table`."""
    table = _PACKAGE / "data" / "names.csv"
    with table.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    return tuple(name for r in rows for name in (r["name"], *r["aliases"].split()))


@cache
def palette_names() -> tuple[str, ...]:
    """Names of the palettes of `jaxthermo.image`."""
    return tuple(json.loads((_PACKAGE / "image" / "palettes.json").read_text()))
