"""Numbers of the page on measurements, from a run of them, into `docs/data`.

Run `experiments run measured --out FOLDER` first, then this with that folder.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any


DOCS = Path(__file__).parent
FILE = DOCS / "data" / "temperatures.json"
_NONE = "\N{EN DASH}"


def main(folder: Path) -> None:
    """Write the tables that the page shows, of the cases that were run."""
    page = (DOCS / "how-true.md").read_text(encoding="utf-8")
    shown = re.findall(r"temperatures:([^`\n]+)", page)
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    record = json.loads(FILE.read_text(encoding="utf-8"))
    for case in result["result"]["cases"]:
        # Rows of the literature have no such part: their table is written by hand.
        parts = dict.fromkeys(row.get("what") for row in case["rows"])
        for part in parts:
            name = f"{case['id']}, {part}"
            if name in shown:
                rows = [row for row in case["rows"] if row.get("what") == part]
                record["tables"][name] = _table(rows)
    text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    FILE.write_text(text, encoding="utf-8")


def _table(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """A column for each check of any of the rows, and one for what was seen."""
    columns = dict.fromkeys(
        _heading(check["name"], check["unit"])
        for row in rows
        for check in row["checks"]
    )
    cells = []
    for row in rows:
        values = {
            _heading(check["name"], check["unit"]): _number(check["computed"])
            for check in row["checks"]
        }
        words = [row["seen"]] if "seen" in row else []
        cells.append([row["solver"], *(values.get(c, _NONE) for c in columns), *words])
    verdict = ["verdict"] if "seen" in rows[0] else []
    return {"columns": ["", *columns, *verdict], "rows": cells}


def _heading(name: str, unit: str) -> str:
    """Name and unit of a column."""
    return f"{name} [{unit.replace('^2', '²')}]" if unit else name


def _number(value: float | str) -> str:
    """Two decimals, or as many as tell a small number."""
    if isinstance(value, str):
        return _NONE
    return f"{value:.2f}" if abs(value) >= 0.095 or value == 0 else f"{value:.2g}"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
