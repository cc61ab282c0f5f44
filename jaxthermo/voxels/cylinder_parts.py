"""Cylinders found in a body's voxels: connected parts of slices across its axis.

The body is cut into slabs across its longest axis. What hangs together inside a slab is
a piece, with the diameter of the circle of its mean cross-section. Pieces that touch
from slab to slab become one part, those most alike in diameter first, as long as they
differ by less than 1.7 times and no part has two pieces in one slab: a leg ends where
the trunk begins. A part that is longer than wide lies along its own longest axis,
any other along the body's. Its diameter is that of the cylinder of its length and
volume, 2 sqrt(V / (pi L)), whatever the wind.
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float, Int
from skimage import measure

from .cylinders import Cylinder, CylinderParts, nearest_parts
from .grid import VoxelGrid


SLABS = 48
"""Along the axis, at most; none is thinner than two blocks of voxels."""

BLOCKS = 96
"""Along the longest edge of the lattice, at most: finer voxels are taken together."""

ALIKE = 1.7
"""Ratio of diameters below which pieces may become one part."""

STUB_VOLUME = 0.05
"""Of the body: a part shorter than half its diameter with less is no part."""

LEAST_VOLUME = 0.002
"""Of the body, of any part."""

LONG = 2.0
"""Ratio of second moments from which a part has an axis of its own: L > 1.22 D."""

NEARLY_EQUAL = 0.9
"""Principal axes with this much of the longest one's second moment may stand for it."""

UPRIGHT = np.cos(np.radians(15.0))
"""A body this close to an axis of its own frame is cut across that one."""


@dataclass(frozen=True)
class _Blocks:
    """Cubes of voxels that hold something solid."""

    occupied: Bool[np.ndarray, "x y z"]
    centre: Float[np.ndarray, "n 3"]
    """Of the occupied ones [m]."""
    volume: Float[np.ndarray, " n"]
    """Solid in each [m^3]."""
    edge: float
    """[m]"""
    factor: int
    """Voxels along an edge."""


def _blocks(grid: VoxelGrid) -> _Blocks:
    factor = -(-max(grid.solid.shape) // BLOCKS)
    shape = np.array([-(-n // factor) for n in grid.solid.shape])
    padded = np.pad(
        grid.solid,
        [(0, b * factor - n) for b, n in zip(shape, grid.solid.shape, strict=True)],
    )
    split = padded.reshape(np.stack([shape, np.full(3, factor)], 1).reshape(-1))
    count = split.sum((1, 3, 5))
    cells = np.argwhere(count > 0)
    edge = factor * grid.pitch
    return _Blocks(
        occupied=count > 0,
        centre=grid.origin + (cells + 0.5) * edge,
        volume=count[count > 0] * grid.voxel_volume,
        edge=edge,
        factor=factor,
    )


def principal_axis(
    points: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """The axis that a body lies along, and by how much its second moment is largest.

    The longest principal axis; of a disc, whose two longest are alike, the short one;
    of a ball or a cube the one closest to vertical.
    """
    centred = points - np.average(points, axis=0, weights=weight)
    moments, axes = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    alike = moments >= NEARLY_EQUAL * moments[-1]
    axis = axes[:, 0] if alike.tolist() == [False, True, True] else axes[:, -1]
    axis = axes @ axes[2] if alike.all() else axis
    ratio = moments[-1] / max(moments[-2], np.finfo(float).tiny)
    return axis * np.sign(axis[np.abs(axis).argmax()]), float(ratio)


_FOUND: WeakKeyDictionary[VoxelGrid, CylinderParts] = WeakKeyDictionary()
"""A body that moves is asked for its parts again and again, and they are the same."""


def cylinder_parts(grid: VoxelGrid) -> CylinderParts:
    """The cylinders of a body, and the part of every surface fragment."""
    if grid not in _FOUND:
        _FOUND[grid] = _find_parts(grid)
    return _FOUND[grid]


def _find_parts(grid: VoxelGrid) -> CylinderParts:
    blocks = _blocks(grid)
    axis = _snapped(principal_axis(blocks.centre, blocks.volume)[0])
    slab = _slabs(blocks, axis)
    piece, touching = _pieces(blocks, slab)
    part = _join(piece, slab, blocks.volume, touching)[piece]
    cylinders = [_fitted(blocks, part == p, axis) for p in range(part.max() + 1)]
    kept = _kept(cylinders, np.bincount(part, blocks.volume))
    chosen = [cylinders[p] for p in kept]
    number = np.full(len(cylinders), -1)
    number[kept] = np.arange(len(kept))
    lattice = np.full(blocks.occupied.shape, -1)
    lattice[blocks.occupied] = number[part]
    own = lattice[tuple((grid.fragment_voxel // blocks.factor).T)]
    nearest = nearest_parts(chosen, grid.fragment_position).fragment
    return CylinderParts(tuple(chosen), np.where(own >= 0, own, nearest))


def parts_of(grid: VoxelGrid, given: tuple[Cylinder, ...], body: int) -> CylinderParts:
    """The cylinders given for a body, or those found in it.

    Raises:
        InputError: if those given are nowhere near it.
    """
    mine = [cylinder for cylinder in given if cylinder.body == body]
    if mine:
        return nearest_parts(mine, grid.fragment_position)
    return cylinder_parts(grid)


def _snapped(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Slabs a little askew would cut slivers off a flat base."""
    main = np.abs(axis).argmax()
    return np.eye(3)[main] if np.abs(axis[main]) >= UPRIGHT else axis


def _extent(
    blocks: _Blocks, chosen: Bool[np.ndarray, " n"], axis: Float[np.ndarray, "3"]
) -> tuple[float, float]:
    """Lower end and length of some blocks along an axis [m]."""
    along = blocks.centre[chosen] @ axis
    support = blocks.edge * np.abs(axis).max()
    return float(along.min() - support / 2), float(np.ptp(along) + support)


def _slabs(blocks: _Blocks, axis: Float[np.ndarray, "3"]) -> Int[np.ndarray, " n"]:
    low, length = _extent(blocks, np.ones(len(blocks.volume), bool), axis)
    count = max(1, min(SLABS, int(length / (2 * blocks.edge) + 1e-6)))
    share = (blocks.centre @ axis - low) / length
    return np.clip((share * count + 1e-9).astype(np.int64), 0, count - 1)


def _pieces(
    blocks: _Blocks, slab: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, "t 2"]]:
    """The piece of each block, from 0, and which pieces touch."""
    lattice = np.zeros(blocks.occupied.shape, np.int64)
    lattice[blocks.occupied] = slab + 1
    label = np.asarray(measure.label(lattice, background=0, connectivity=3))
    pairs = []
    for axis in range(3):
        here, there = np.moveaxis(label, axis, 0)[:-1], np.moveaxis(label, axis, 0)[1:]
        apart = (here > 0) & (there > 0) & (here != there)
        pairs.append(np.stack([here[apart], there[apart]], axis=1))
    touching = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    return label[blocks.occupied] - 1, touching - 1


def _join(
    piece: Int[np.ndarray, " n"],
    slab: Int[np.ndarray, " n"],
    volume: Float[np.ndarray, " n"],
    touching: Int[np.ndarray, "t 2"],
) -> Int[np.ndarray, " p"]:
    """The part of each piece, the most alike joined first."""
    _, first = np.unique(piece, return_index=True)
    # What a part has: its volume, and a bit for each of its slabs.
    have = np.bincount(piece, volume)
    slabs = [1 << int(s) for s in slab[first]]
    near = [set() for _ in first]
    for a, b in touching.tolist():
        near[a].add(b)
        near[b].add(a)
    part = np.arange(len(first))

    def unlike(pair):
        a, b = pair
        sections = [have[p] / slabs[p].bit_count() for p in pair]
        return np.inf if slabs[a] & slabs[b] else max(sections) / min(sections)

    pairs = {(a, b): unlike((a, b)) for a in range(len(near)) for b in near[a] if a < b}
    while pairs and min(pairs.values()) <= ALIKE**2:
        a, b = min(pairs, key=lambda pair: pairs[pair])
        have[a] += have[b]
        slabs[a] |= slabs[b]
        part[part == b] = a
        near[a] = (near[a] | near[b]) - {a, b}
        pairs = {pair: v for pair, v in pairs.items() if not {a, b} & set(pair)}
        for other in near[a]:
            near[other] = (near[other] - {b}) | {a}
            pair = (min(a, other), max(a, other))
            pairs[pair] = unlike(pair)
    return np.unique(part, return_inverse=True)[1].reshape(-1)


def _fitted(
    blocks: _Blocks, chosen: Bool[np.ndarray, " n"], axis: Float[np.ndarray, "3"]
) -> Cylinder:
    """The cylinder of a part's length and volume."""
    centre, volume = blocks.centre[chosen], blocks.volume[chosen]
    own, ratio = principal_axis(centre, volume)
    axis = own if ratio >= LONG else axis
    low, length = _extent(blocks, chosen, axis)
    middle = np.average(centre, axis=0, weights=volume)
    middle = middle + (low + length / 2 - middle @ axis) * axis
    diameter = 2 * np.sqrt(volume.sum() / (np.pi * length))
    triple = lambda v: (float(v[0]), float(v[1]), float(v[2]))
    return Cylinder(triple(middle), triple(axis), float(diameter), length)


def _kept(cylinders: list[Cylinder], volume: Float[np.ndarray, " p"]) -> list[int]:
    """The parts worth keeping, the largest first."""
    share = volume / volume.sum()
    stub = [c.length is not None and c.length < c.diameter / 2 for c in cylinders]
    least = np.where(stub, STUB_VOLUME, LEAST_VOLUME)
    order = np.argsort(-share, kind="stable")
    # The largest stays whatever its shape.
    return [int(p) for p in order if share[p] >= least[p] or p == order[0]]
