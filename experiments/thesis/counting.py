"""Claims on counts: cells of cubes, compression, table 6.1, and lost capacity."""

from typing import Any

from rich.console import Console

from .compression import (
    compression_table,
    count_heights,
    count_table_6_1,
    table_6_1,
)
from .cubes import count_cubes, cube_table
from .irregular_capacity import capacity_table, measure_capacity
from .meshes import thesis_meshes


def run() -> dict[str, Any]:
    """C05, C06, C15 and the counts of table 6.1."""
    console = Console()
    cubes = count_cubes()
    console.print(cube_table(cubes))
    meshes = thesis_meshes()
    rows = {name: count_heights(mesh) for name, mesh in meshes.items()}
    console.print(compression_table(rows))
    # The Happy Buddha, or what stands in for it.
    name, mesh = next(iter(meshes.items()))
    table = count_table_6_1(mesh)
    console.print(table_6_1(table, name))
    capacity = measure_capacity(mesh)
    console.print(capacity_table(capacity, name))
    return {
        "meshes": {name: mesh.name for name, mesh in meshes.items()},
        "C05": cubes,
        "C06": rows,
        "table_6_1": {"mesh": name, **table},
        "C15": {"mesh": name, **capacity},
    }
