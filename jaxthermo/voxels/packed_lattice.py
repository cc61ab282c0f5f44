"""Packed lattice: sections of a body side by side, in a box with fewer empty cells.

A statue fills a quarter of its box, and a stencil visits the whole box. Cut across one
axis into sections of equal thickness, each in a box of its own, and with these boxes
beside each other, one empty cell apart, the body fills nearly half of a smaller
lattice. Voxels on both sides of a cut are neighbours no more: they are listed.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Int, Shaped


_COUNTS = (2, 3, 4, 6, 8, 10, 12, 14, 16, 20)
"""Numbers of sections that are tried along each axis."""
_WIDTHS = 24
"""Number of widths that are tried for each of them."""

# Costs in units of a cell of a stencil: a pair of voxels across a cut is read and
# written through indices, and every cut adds operations.
_PAIR_COST = 6.0
_CUT_COST = 2e4

_OTHERS = (1, 2), (0, 2), (0, 1)
"""The two other axes of each axis."""

_MAX_COST = 0.8
"""Cost relative to the whole box up to which a body is packed."""


class PackedLattice(NamedTuple):
    """Places of the voxels of a body in a smaller lattice."""

    axes: tuple[int, int, int]
    """Axis of the body along each axis of the lattice; the first is cut across."""
    thickness: int
    """Thickness of a section [voxels]; the last may be thinner."""
    low: Int[np.ndarray, "n 2"]
    """Lowest voxel of each section along the two other axes."""
    high: Int[np.ndarray, "n 2"]
    """One past its highest voxel."""
    corner: Int[np.ndarray, "n 2"]
    """Cell of its lowest voxel along them."""
    shape: tuple[int, int, int]
    """Shape of the lattice [cells]."""

    def cells(self, voxel: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 3"]:
        """Cells of solid voxels."""
        along = voxel[:, self.axes[0]]
        section, depth = np.divmod(along, self.thickness)
        across = voxel[:, self.axes[1:]]
        moved = across + (self.corner - self.low)[section]
        return np.column_stack([depth, moved]).astype(voxel.dtype)

    def packed(
        self, values: Shaped[np.ndarray, "x y z"]
    ) -> Shaped[np.ndarray, "a b c"]:
        """Values of all voxels in the lattice, 0 between the sections."""
        lattice_values = np.zeros(self.shape, values.dtype)
        for source, target in self._boxes():
            section = values.transpose(self.axes)[source]
            lattice_values[target][: len(section)] = section
        return lattice_values

    def _boxes(self) -> Iterator[tuple[tuple[slice, ...], tuple[slice, ...]]]:
        """Box of each section in the body (axes in our order) and in the lattice."""
        sizes = self.high - self.low
        for n, (low, size, corner) in enumerate(
            zip(self.low, sizes, self.corner, strict=True)
        ):
            first = n * self.thickness
            inside = slice(first, first + self.thickness)
            source = (slice(a, a + s) for a, s in zip(low, size, strict=True))
            target = (slice(a, a + s) for a, s in zip(corner, size, strict=True))
            yield (inside, *source), (slice(None), *target)

    def cut_pairs(
        self, solid: Bool[np.ndarray, "x y z"]
    ) -> tuple[Int[np.ndarray, "p 3"], Int[np.ndarray, "p 3"]]:
        """Solid voxels before and behind each cut that are neighbours across it."""
        body = np.moveaxis(solid, self.axes[0], 0)
        step = self.thickness
        ends = np.arange(step, len(body), step)
        seam = np.argwhere(body[ends - 1] & body[ends])
        front = np.empty((len(seam), 3), np.int32)
        front[:, self.axes[0]] = ends[seam[:, 0]] - 1
        front[:, self.axes[1:]] = seam[:, 1:]
        behind = front.copy()
        behind[:, self.axes[0]] += 1
        return front, behind


def packed_lattice(solid: Bool[np.ndarray, "x y z"]) -> PackedLattice | None:
    """The cheapest packed lattice of a body; None where its box is as good."""
    limit = _MAX_COST * solid.size
    best = None
    for axis in range(3):
        body = np.moveaxis(solid, axis, 0)
        # Occupied lines of each plane across the axis, along the two others.
        lines = np.asarray(body.any(axis=2)), np.asarray(body.any(axis=1))
        for count in _COUNTS:
            thickness = -(-len(body) // count)
            if thickness < 2 or count > len(body):
                continue
            low, high = _section_boxes(lines, thickness)
            cuts = np.arange(thickness, len(body), thickness)
            seams = _PAIR_COST * np.count_nonzero(
                body[cuts - 1] & body[cuts]
            ) + _CUT_COST * len(cuts)
            room = (limit - seams) / (thickness + 2)
            placed = _placed(high - low, room)
            if placed is None:
                continue
            corner, area = placed
            limit = (thickness + 2) * (area[0] + 2) * (area[1] + 2) + seams
            axes = axis, *_OTHERS[axis]
            best = PackedLattice(
                axes=axes,
                thickness=thickness,
                low=low,
                high=high,
                corner=corner,
                shape=(thickness, *area),
            )
    return best


def _section_boxes(
    lines: tuple[Bool[np.ndarray, "p b"], Bool[np.ndarray, "p c"]], thickness: int
) -> tuple[Int[np.ndarray, "n 2"], Int[np.ndarray, "n 2"]]:
    """Lowest and one past the highest voxel of the planes of each section."""
    starts = np.arange(0, len(lines[0]), thickness)
    low = []
    high = []
    for line in lines:
        occupied = np.logical_or.reduceat(line, starts, axis=0)
        low.append(occupied.argmax(axis=1))
        past = occupied.shape[1] - occupied[:, ::-1].argmax(axis=1)
        high.append(np.where(occupied.any(axis=1), past, low[-1]))
    return np.stack(low, axis=1), np.stack(high, axis=1)


def _placed(
    sizes: Int[np.ndarray, "n 2"], room: float
) -> tuple[Int[np.ndarray, "n 2"], tuple[int, int]] | None:
    """Corners of rectangles beside each other, and the sides of the area they take.

    None if it and its rim take as many cells as `room`.
    """
    # One empty cell between two; the rim of the lattice is beside the others.
    sizes = sizes + 1
    best = None
    if sizes.prod(axis=1).sum() >= room:
        return None
    widest = int(sizes[:, 1].max())
    longest = int(sizes[:, 1].sum())
    for width in np.unique(np.linspace(widest, longest, _WIDTHS).astype(int)):
        corner = _lowest_places(sizes, int(width))
        height, used = ((corner + sizes).max(axis=0) - 1).tolist()
        if (height + 2) * (used + 2) < room:
            room = (height + 2) * (used + 2)
            best = (corner, (height, used))
    return best


def _lowest_places(sizes: Int[np.ndarray, "n 2"], width: int) -> Int[np.ndarray, "n 2"]:
    """Corners of rectangles in a strip, each as low as it fits, the tallest first."""
    top = np.zeros(width, np.int64)
    corner = np.zeros_like(sizes)
    for n in np.lexsort((-sizes[:, 1], -sizes[:, 0])):
        height, across = sizes[n]
        # Of the windows to the right of each place.
        under = scipy.ndimage.maximum_filter1d(top, across, origin=-(across // 2))
        left = int(under[: width - across + 1].argmin())
        corner[n] = under[left], left
        top[left : left + across] = under[left] + height
    return corner
