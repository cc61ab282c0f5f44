"""Report of a sheet: its cells, what joining its triangles did, and doubts about it."""

from typing import TypedDict

import numpy as np

from ..arrays import is_traced
from ..sheets.doubts import curvature, double_area, poor_conduction
from ..sheets.through import resolved_time
from .kinds.sheet import Sheet


class _ThroughPart(TypedDict):
    """Cells through the thickness of one part of a sheet."""

    part: str
    """Empty for a mesh without parts."""
    thickness_m: float
    cells_m: list[float]
    """Thickness of each cell, from the front [m]."""
    resolved_time_s: float
    """Shortest duration of a load that the cells at the faces resolve [s]."""


class SheetReport(TypedDict):
    """Cells of a sheet, and what was done to join its triangles."""

    back: str
    through: list[_ThroughPart]
    border_m: float
    """Length of the free border [m]."""
    open_seams_m: float
    """Length of the border next to another one, with which it was perhaps one [m]."""
    welded_vertices: int
    dropped_double_faces: int
    dropped_faces_without_area: int
    edges_cut_at_vertices: int


def sheet_report(sheet: Sheet) -> SheetReport:
    """Cells of a sheet along its surface and through its thickness."""
    cells = sheet.grid.cells
    return SheetReport(
        back="adiabatic" if sheet.grid.has_adiabatic_back else "open",
        through=_through(sheet),
        border_m=cells.border,
        open_seams_m=cells.open_seams,
        welded_vertices=cells.welded.welded_vertices,
        dropped_double_faces=cells.welded.double_faces,
        dropped_faces_without_area=cells.welded.degenerate_faces,
        edges_cut_at_vertices=cells.welded.cut_edges,
    )


def _through(sheet: Sheet) -> list[_ThroughPart]:
    from_front = sheet.grid.has_adiabatic_back
    names = sheet.grid.part_names or ("",)
    rows = []
    for name, stack, division in zip(names, sheet.stacks, sheet.divisions, strict=True):
        thickness = np.array([float(layer.thickness) for layer in stack])
        rows.append(
            _ThroughPart(
                part=name,
                thickness_m=float(thickness.sum()),
                cells_m=(np.asarray(division) @ thickness).tolist(),
                resolved_time_s=resolved_time(stack, division, from_front),
            )
        )
    return rows


def sheet_notes(sheet: Sheet) -> list[str]:
    """Lines on the cells of a sheet; none on its thickness if that is traced."""
    lines = []
    if not is_traced(sheet.stacks):
        # Parts of equal walls have one line.
        rows = {_cells_line(row): row["part"] for row in _through(sheet)}
        for line, part in rows.items():
            lines.append(f"{part}: {line}" if part and len(rows) > 1 else line)
    cells = sheet.grid.cells
    counts = {
        "faces that are there twice": cells.welded.double_faces,
        "faces without area": cells.welded.degenerate_faces,
    }
    dropped = [f"{number:,} {what}" for what, number in counts.items() if number]
    if dropped:
        lines.append(f"left out: {', '.join(dropped)}")
    return lines


def _cells_line(row: _ThroughPart) -> str:
    sizes = [f"{size * 1e3:.3g}" for size in row["cells_m"]]
    if len(sizes) > 4:
        sizes = [*sizes[:2], "..", *sizes[-2:]]
    count = len(row["cells_m"])
    cells = f"{count} cell{'s' * (count != 1)} through it ({', '.join(sizes)} mm)"
    return (
        f"a wall of {row['thickness_m'] * 1e3:.4g} mm has {cells}, for loads of "
        f"{row['resolved_time_s']:.2g} s and longer"
    )


def sheet_warnings(sheet: Sheet) -> list[str]:
    """Lines on open seams, double faces, poor conduction, and walls that would fold."""
    lines = []
    cells = sheet.grid.cells
    if cells.open_seams > 0:
        lines.append(
            f"{cells.open_seams:.3g} m of its border run next to another border, and "
            "no heat crosses: if both are one seam, join it with a longer weld"
        )
    double = double_area(sheet.grid)
    if double is not None:
        lines.append(
            f"{double.area:.3g} m^2 of its faces lie on other faces, at "
            f"{_point(double.position)} m: both are walls; delete one of them"
        )
    poor = poor_conduction(sheet.grid)
    if poor is not None:
        lines.append(
            f"{100 * poor.area_fraction:.2g} % of its surface are narrow bars or tubes "
            f"that conduct too little along themselves, {poor.ratio:.2g} of what is "
            f"right at {_point(poor.position)} m: give them a finer pitch"
        )
    if not is_traced(sheet.stacks):
        lines += _fold_warnings(sheet)
    return lines


def _fold_warnings(sheet: Sheet) -> list[str]:
    thickness = [row["thickness_m"] for row in _through(sheet)]
    area = sheet.grid.cells.area
    thickest = np.where(area > 0, thickness, 0).max(axis=1)
    ratio = thickest * curvature(sheet.grid)
    folds = ratio > 1
    if not folds.any():
        return []
    worst = int(ratio.argmax())
    radius = thickest[worst] / ratio[worst]
    share = 100 * area[folds].sum() / area.sum()
    return [
        f"its wall of {thickest[worst] * 1e3:.3g} mm is thicker than the radius of "
        f"curvature of {share:.2g} % of the surface, {radius * 1e3:.3g} mm at "
        f"{_point(sheet.grid.cells.position[worst])} m: there it has too much volume; "
        "make a solid of voxels of it"
    ]


def _point(position: np.ndarray) -> str:
    return f"({', '.join(f'{x:.3g}' for x in position)})"
