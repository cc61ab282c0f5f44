"""Numbers of the thesis pages, from a run of its exhibits, into `docs/data/thesis`.

Run `experiments run thesis --quick --out FOLDER` first, then this with that folder.
"""

import json
import sys
from pathlib import Path

from experiments.thesis.statements import quoted, references, table_of_values
from jaxthermo.report.table import Cell


DATA = Path(__file__).parent / "data" / "thesis"


def main(folder: Path) -> None:
    """Write a file for each exhibit, with what its text quotes."""
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    command = "experiments run thesis" + (" --quick" if result["quick"] else "")
    DATA.mkdir(exist_ok=True)
    for exhibit in result["result"]["exhibits"]:
        numbers = exhibit["numbers"]
        values, tables = references(exhibit["name"])
        if not numbers:
            continue
        record = {
            "about": f"Numbers of {exhibit['name']}: {exhibit['title']}.",
            "command": f"{command} --cases {exhibit['name']}",
            "machine": result["host"],
            "values": {name: quoted(numbers, name) for name in values},
            "tables": {name: _plain_table(numbers, name) for name in tables},
        }
        text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
        (DATA / f"{exhibit['name']}.json").write_text(text, encoding="utf-8")


def _plain_table(numbers: dict, name: str) -> dict[str, list]:
    table = table_of_values(numbers, name)
    rows = [
        [cell.text if isinstance(cell, Cell) else cell for cell in row]
        for row in table.rows
    ]
    return {"columns": list(table.columns), "rows": rows}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
