"""Shells (thesis 4.2, 4.3): surface voxels, and nested shells of larger cells."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ...arrays import flat_index
from ...choices import ShellCapacity
from ...errors import InputError, whole_number
from ...voxels.grid import VoxelGrid
from ...voxels.surface import surface_links
from ..cache import built_once
from ..partition.assignment import (
    Assignment,
    LevelCells,
    assign_voxels,
    nested_cells,
    voxel_depth,
)
from ..partition.blocks import shell_voxels
from ..structure import (
    AbstractBuiltStructure,
    Built,
    Links,
    Nodes,
)


class SingleShell(AbstractBuiltStructure):
    """Surface voxels, linked over faces, edges and corners (thesis 4.2).

    Each of the up to 26 links has the area pitch^2, so a flat sheet conducts
    1 + sqrt(2) times as well along itself as its material; `weights` can correct that.

    Raises:
        InputError: if the capacity is neither "body" nor "own".
    """

    capacity: ShellCapacity = eqx.field(static=True, default="body")
    """Volume of the nodes: "body" distributes that of the whole body evenly; "own" is
    one voxel each: a hollow body."""

    def __post_init__(self):
        if self.capacity not in ("body", "own"):
            raise InputError(
                f'SingleShell(capacity={self.capacity!r}): give "body" or "own"'
            )
        options = {"capacity": self.capacity}
        self.built = built_once(
            "single_shell", grid=self.grid, options=options, build=_build_shell
        )


def _build_shell(grid: VoxelGrid, capacity: str) -> Built:
    voxels = shell_voxels(grid)
    count = len(voxels)
    volume = grid.volume_at(voxels)
    if capacity == "body":
        volume = np.full(count, grid.voxel_volume * (grid.size / max(count, 1)))
    centre = grid.lattice.centres(voxels)
    node = np.full(grid.solid.shape, -1, np.int32)
    node[tuple(voxels.T)] = np.arange(count)
    level = np.zeros(count, np.int32)
    return Built(
        nodes=Nodes(centre=centre, volume=volume, level=level, location=centre),
        links=_shell_links(grid, voxels),
        fragment_node=node[tuple(grid.fragment_voxel.T)],
        voxel_node=node[grid.solid],
    )


def _shell_links(grid: VoxelGrid, voxels: Int[np.ndarray, "m 3"]) -> Links:
    """Links of touching voxels at 1, sqrt(2) or sqrt(3) times the pitch."""
    pairs = surface_links(voxels, grid.lattice.shape)
    # Stable, since the pairs are 13 sorted runs, one for each direction.
    src, dst = pairs[np.argsort(pairs[:, 0], kind="stable")].T
    steps = np.abs(voxels[dst] - voxels[src]).sum(1)
    half = 0.5 * grid.pitch * np.sqrt(np.arange(4))[steps]
    return Links(
        src=np.ascontiguousarray(src),
        dst=np.ascontiguousarray(dst),
        area=np.full(len(src), grid.pitch**2),
        distance_src=half,
        distance_dst=half,
    )


class _Coverage(NamedTuple):
    """Volumes relative to the body: cells have 1 + overlap - crack + outside."""

    overlap: float
    """Volume that cells cover more than once, with its multiplicity less one [-]."""
    crack: float
    """Volume that no cell covers [-]."""
    outside: float
    """Volume of cells outside the body [-]."""


class IrregularMultiLevel(AbstractBuiltStructure):
    """The shell, and inside it nested shells of half the resolution each (thesis 4.3).

    Cells of level l are cubes of 2^l voxels on a separate lattice, so they overlap or
    leave cracks (see `coverage`). A node's capacity is that of its whole cube, as in
    the thesis; the total is `capacity_ratio` of the body's. Material in cracks conducts
    but stores no heat.

    Raises:
        InputError: unless `levels` is a whole number of at least 1.
    """

    levels: int | None = eqx.field(static=True, default=None)
    """Maximal number of levels, None for as many as fit; empty deeper inside."""
    keep_capacity: bool = eqx.field(static=True, default=False)
    """Scale all capacities by one factor, so that the total is the body's."""

    def __post_init__(self):
        if self.levels is not None:
            self.levels = whole_number(self.levels, "IrregularMultiLevel(levels=)")
        self.keep_capacity = bool(self.keep_capacity)
        options = {"levels": self.levels, "keep_capacity": self.keep_capacity}
        self.built = built_once(
            "irregular_multi_level",
            grid=self.grid,
            options=options,
            build=_build_nested,
        )

    @property
    def level_count(self) -> int:
        """Number of levels."""
        return int(self.built.nodes.level.max(initial=-1)) + 1

    def cover_count(self) -> Int[np.ndarray, "x y z"]:
        """Number of nodes that cover each voxel of the lattice."""
        nodes = self.built.nodes
        centre = self.grid.lattice.to_cells(nodes.centre)
        return cover_count(centre, level=nodes.level, shape=self.grid.solid.shape)

    def coverage(self) -> _Coverage:
        """Overlap, cracks and outside parts relative to the body."""
        count = self.cover_count()
        inside = count[self.grid.solid]
        total = int(count.sum(dtype=np.int64))
        solid = max(len(inside), 1)
        covered = int(np.count_nonzero(inside))
        within = int(inside.sum(dtype=np.int64))
        return _Coverage(
            overlap=(within - covered) / solid,
            crack=(len(inside) - covered) / solid,
            outside=(total - within) / solid,
        )


def cover_count(
    centre: Float[np.ndarray, "n 3"],
    level: Int[np.ndarray, " n"],
    shape: tuple[int, ...],
) -> Int[np.ndarray, "x y z"]:
    """Number of cubes that cover each voxel of a lattice, out of which they may stick.

    Args:
        centre: of cubes of 2^level voxels an edge [voxels from the lowest corner].
        level: of each cube.
        shape: of the lattice [voxels].
    """
    # Each cube adds +-1 at its eight corners, with alternating sign; running sums
    # along x, y and z then fill the cubes, whatever their size.
    change = np.zeros(np.array(shape) + 1, np.int16)
    size = 1 << level
    low = np.rint(centre - size[:, None] / 2).astype(int)
    for far in np.ndindex(2, 2, 2):
        end = np.clip(low + np.array(far) * size[:, None], 0, shape)
        np.add.at(change, tuple(end.T), np.int16((-1) ** sum(far)))
    for axis in range(3):
        np.cumsum(change, axis=axis, out=change)
    return change[:-1, :-1, :-1]


def _build_nested(grid: VoxelGrid, levels: int | None, keep_capacity: bool) -> Built:
    depth = voxel_depth(grid)
    cells = nested_cells(depth)
    body = depth > 0
    if levels is not None and levels < len(cells):
        cells = cells[:levels]
        # Below the last level the body is empty and must not conduct.
        body &= depth <= 1 << levels
    assignment, cells = assign_voxels(body, cells)
    x, y, z = grid.solid.shape
    # The division has one empty voxel before the grid's first.
    owner = assignment.owner[1 : x + 1, 1 : y + 1, 1 : z + 1]
    return Built(
        nodes=_nodes(grid, cells, keep_capacity),
        links=_nested_links(cells, assignment, grid.pitch),
        # Voxels with a fragment are in the shell, whose cells own them.
        fragment_node=owner[tuple(grid.fragment_voxel.T)],
        voxel_node=owner[grid.solid],
    )


def _nodes(grid: VoxelGrid, levels: LevelCells, keep_capacity: bool) -> Nodes:
    counts = [len(cells) for cells in levels]
    level = np.repeat(np.arange(len(levels), dtype=np.int32), counts)
    size = (1 << level)[:, None]
    # The lattice of the cells begins one voxel before the grid's.
    middle = (np.concatenate(levels) + 0.5) * size - 1
    volume = size[:, 0] ** 3 * grid.voxel_volume
    volume[: counts[0]] = grid.volume_at(levels[0] - 1)
    if keep_capacity:
        volume *= grid.body_volume / volume.sum()
    centre = grid.origin + middle * grid.pitch
    return Nodes(centre=centre, volume=volume, level=level, location=centre)


class _Pairs(NamedTuple):
    """Pairs of cells, src < dst, each once, sorted; lengths [voxels]."""

    key: Int[np.ndarray, " k"]
    """src * number of cells + dst."""
    area: Float[np.ndarray, " k"]
    distance_src: Float[np.ndarray, " k"]
    distance_dst: Float[np.ndarray, " k"]


def _nested_links(levels: LevelCells, assignment: Assignment, pitch: float) -> Links:
    """Links of cells that touch, sorted.

    Two cells of level l that share a face of their lattice have the area (2^l h)^2 and
    half a cell on either side, with the pitch h [m]. All others that touch in the
    division of the body have the area of the voxel faces between them, and on either
    side half a cell plus the mean gap that the division bridged.
    """
    counts = [len(cells) for cells in levels]
    half = np.repeat(0.5 * (1 << np.arange(len(levels))), counts)
    lattice = _lattice_pairs(levels, half)
    contact = _contacts(assignment, half)
    # Contacts over a lattice face are already links.
    new = ~np.isin(contact.key, lattice.key, assume_unique=True)
    columns = zip(lattice, contact, strict=True)
    pairs = _Pairs(*(np.concatenate([first, second[new]]) for first, second in columns))
    order = np.argsort(pairs.key)
    src, dst = np.divmod(pairs.key[order], max(len(half), 1))
    return Links(
        src=src.astype(np.int32),
        dst=dst.astype(np.int32),
        area=pairs.area[order] * pitch**2,
        distance_src=pairs.distance_src[order] * pitch,
        distance_dst=pairs.distance_dst[order] * pitch,
    )


def _lattice_pairs(levels: LevelCells, half: Float[np.ndarray, " n"]) -> _Pairs:
    pairs = [np.zeros((2, 0), np.int64)]
    first = 0
    for cells in levels:
        shape = cells.max(axis=0, initial=0) + 2
        key = flat_index(cells, tuple(shape.tolist()))
        for stride in (shape[1] * shape[2], shape[2], 1):
            # Keys are sorted and have a rim, so no stride wraps around.
            index = np.searchsorted(key, key + stride)
            linked = np.flatnonzero(np.append(key, -1)[index] == key + stride)
            pairs.append(first + np.stack([linked, index[linked]]))
        first += len(cells)
    src, dst = np.concatenate(pairs, axis=1)
    return _Pairs(
        key=src * len(half) + dst,
        area=4 * half[src] ** 2,
        distance_src=half[src],
        distance_dst=half[dst],
    )


def _contacts(assignment: Assignment, half: Float[np.ndarray, " n"]) -> _Pairs:
    faces = []
    for axis in range(3):
        owner = np.moveaxis(assignment.owner, axis, 0)
        gap = np.moveaxis(assignment.gap, axis, 0)
        below = owner[:-1]
        above = owner[1:]
        between = (below != above) & (below >= 0) & (above >= 0)
        arrays = (below, above, gap[:-1], gap[1:])
        faces.append(np.stack([array[between].astype(np.int32) for array in arrays]))
    sides = np.concatenate(faces, axis=1)
    owners = sides[:2].astype(np.int64)
    gaps = sides[2:]
    key = owners.min(axis=0) * len(half) + owners.max(axis=0)
    key, which, area = np.unique(key, return_inverse=True, return_counts=True)
    ascending = owners[0] < owners[1]
    gap_src = np.bincount(which, np.where(ascending, *gaps), len(key)) / area
    gap_dst = np.bincount(which, np.where(ascending, *gaps[::-1]), len(key)) / area
    src, dst = np.divmod(key, max(len(half), 1))
    return _Pairs(
        key=key,
        area=area.astype(float),
        distance_src=half[src] + gap_src,
        distance_dst=half[dst] + gap_dst,
    )
