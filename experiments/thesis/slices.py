"""Slices through structures: each node as a square, and paths over them."""

import numpy as np
from jaxtyping import Int, UInt8
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.report.sheet import Legend
from jaxthermo.structures.structure import AbstractStructure


_EMPTY = (246, 247, 249)
_LINE = (90, 96, 108)
_PATH = (214, 32, 44)
# sRGB of levels from the surface inwards, told apart without any kind of cone.
_LEVELS = (
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (230, 159, 0),
    (204, 121, 167),
    (0, 114, 178),
    (213, 94, 0),
    (150, 150, 150),
)


class Slice:
    """A picture of the nodes that a plane across an axis of the lattice cuts."""

    def __init__(
        self, structure: AbstractStructure, *, axis: int, plane: float, edge: int = 8
    ):
        """Draw the nodes.

        Args:
            structure: whose nodes are drawn, single voxels or nested cells.
            axis: across the plane.
            plane: where it lies [voxels from the lowest corner].
            edge: of a voxel [px].
        """
        grid = structure.grid
        self.axis = axis
        self.edge = edge
        self.across, self.up = (a for a in range(3) if a != axis)
        self.shape = grid.lattice.shape
        width, height = self.shape[self.across], self.shape[self.up]
        self.image = Image.new("RGB", (edge * width + 1, edge * height + 1), _EMPTY)
        self.lattice = grid.lattice
        self.levels = 0
        nodes = structure.nodes()
        is_nested = isinstance(structure, jt.IrregularMultiLevel)
        cell_width = 1 << nodes.level if is_nested else np.ones_like(nodes.level)
        self._draw(nodes.centre, width=cell_width, level=nodes.level, plane=plane)

    def _draw(
        self, centre: np.ndarray, width: np.ndarray, level: np.ndarray, plane: float
    ) -> None:
        low = self.lattice.to_cells(centre) - width[:, None] / 2
        cut = np.flatnonzero((low <= plane).T[self.axis])
        cut = cut[low[cut, self.axis] + width[cut] > plane]
        # Large ones first, so that overlaps show the smaller cell.
        cut = cut[np.argsort(-level[cut], kind="stable")]
        draw = ImageDraw.Draw(self.image)
        for node in cut:
            colour = _LEVELS[level[node] % len(_LEVELS)]
            corners = self._box(
                left=low[node, self.across],
                bottom=low[node, self.up],
                width=float(width[node]),
            )
            draw.rectangle(corners, fill=colour, outline=_LINE)
        self.levels = int(level[cut].max(initial=-1)) + 1

    def _box(self, left: float, bottom: float, width: float) -> tuple[int, ...]:
        top = self.shape[self.up] - bottom - width
        corner = np.array([left, top, left + width, top + width]) * self.edge
        return tuple(np.rint(corner).astype(int).tolist())

    def draw_path(self, points: np.ndarray) -> None:
        """Draw a path over positions in the body's frame [m], in red."""
        cells = self.lattice.to_cells(points)
        across = cells[:, self.across] * self.edge
        down = (self.shape[self.up] - cells[:, self.up]) * self.edge
        line = np.column_stack([across, down]).ravel().tolist()
        draw = ImageDraw.Draw(self.image)
        draw.line(line, fill=_PATH, width=max(2, self.edge // 2))

    @property
    def pixels(self) -> UInt8[np.ndarray, "h w 3"]:
        """The picture as an array."""
        return np.asarray(self.image)


def level_legend(count: int, *, has_path: bool = False) -> Legend:
    """Colours of the levels, and of the path."""
    words = ["level 0, the surface", *(f"level {k}" for k in range(1, count))]
    entries = list(zip(words, _LEVELS[:count], strict=True))
    if has_path:
        entries.append(("shortest path", _PATH))
    return Legend(tuple(entries))


def cover_picture(
    count: Int[np.ndarray, "a b"], solid: np.ndarray, edge: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Slice coloured by the number of cells that cover each voxel.

    Args:
        count: of covering cells, along the picture's width and height upwards.
        solid: flags of the body's voxels in that slice.
        edge: of a voxel [px].
    """
    colour = np.empty((*count.shape, 3), np.uint8)
    colour[:] = _EMPTY
    states = {
        "one cell": solid & (count == 1),
        "crack: no cell": solid & (count == 0),
        "overlap: two or more": solid & (count > 1),
        "outside the body": ~solid & (count > 0),
    }
    for name, is_in_state in states.items():
        colour[is_in_state] = _COVER[name]
    upright = colour.transpose(1, 0, 2)[::-1]
    return upright.repeat(edge, axis=0).repeat(edge, axis=1)


_COVER = {
    "one cell": (214, 220, 228),
    "crack: no cell": (34, 40, 52),
    "overlap: two or more": (226, 120, 40),
    "outside the body": (120, 170, 220),
}


def cover_legend() -> Legend:
    """Colours of `cover_picture`."""
    return Legend(tuple(_COVER.items()))


def with_frame(
    image: UInt8[np.ndarray, "h w 3"], box: tuple[int, int, int, int]
) -> UInt8[np.ndarray, "h w 3"]:
    """A picture with a red frame from left and top to right and bottom [px]."""
    framed = Image.fromarray(image)
    ImageDraw.Draw(framed).rectangle(box, outline=_PATH, width=3)
    return np.asarray(framed)
