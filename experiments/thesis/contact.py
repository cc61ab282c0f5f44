"""Claims on contact (5.3): figure 5.3's resolutions, pruning, a ball on a head."""

from pathlib import Path
from typing import Any

from rich.console import Console

from .contact_area import area_chart, area_sheet, area_table, measure_areas
from .contact_head import balls_on_heads, head_table
from .contact_pruning import measure_pruning, pruning_table
from .meshes import thesis_meshes


HEIGHT = 60
"""Of the heads, in voxels."""


def run(folder: Path, height: int = HEIGHT) -> dict[str, Any]:
    """C18 and C19, and the contact textures of figure 5.5.

    Args:
        folder: for the charts and pictures.
        height: of the heads, in voxels.
    """
    console = Console()
    areas = measure_areas()
    console.print(area_table(areas))
    area_chart(areas, folder / "contact_area")
    area_sheet(folder / "contact_area_layers.png")
    pruning = measure_pruning()
    console.print(pruning_table(pruning))
    heads = balls_on_heads(thesis_meshes(), height, folder)
    console.print(head_table(heads))
    return {"C18": areas, "C19": pruning, "heads": heads}
