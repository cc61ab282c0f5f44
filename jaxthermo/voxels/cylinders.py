"""Cylinders that approximate a body for its convection (thesis ch. 3).

To decompose a body, it is cut into slabs across its longest axis. A connected piece of
a slab has the diameter of the circle of its mean cross-section. Pieces that touch from
slab to slab are merged into parts, the most similar diameters first, as long as they
differ by less than 1.7 times and no part has two pieces in one slab: a leg ends where
the trunk begins. The axis of an elongated part is its longest principal axis, that of
any other the body's. Its diameter is that of the cylinder of its length and volume,
2 sqrt(V / (pi L)).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from skimage import measure

from ..arrays import Number, Vector
from ..errors import InputError
from ..geometry.vectors import unit_vector
from ..memo.found import found
from ..memo.stored import stored_search
from .abstract_grid import AbstractGrid
from .grid import VoxelGrid


@dataclass(frozen=True)
class Cylinder:
    """Circular cylinder in the body's frame.

    Raises:
        InputError: if the axis has no direction, or a size is not positive.
    """

    axis_point: Vector
    """Middle of the axis: three numbers [m]."""
    axis: Vector
    """Direction of the axis: three numbers [-]."""
    diameter: Number
    """Diameter [m]."""
    length: Number | None = None
    """Length [m]; None for an infinite cylinder."""
    body: int | str = 0
    """Number of the body in the scene, or its name."""

    def __post_init__(self):
        try:
            point = np.asarray(self.axis_point, float)
        except (TypeError, ValueError):
            point = np.zeros(0)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise InputError(
                f"Cylinder(axis_point={self.axis_point!r}): give three finite numbers"
            )
        unit_vector(self.axis, "Cylinder(axis=)")
        for name in ("axis_point", "axis"):
            # Tuples can be compared and hashed, arrays cannot.
            plain = tuple(float(x) for x in getattr(self, name))
            object.__setattr__(self, name, plain)
        for name in ("diameter", "length"):
            size = getattr(self, name)
            if name == "length" and size is None:
                continue
            if not isinstance(size, int | float) or not 0 < size < np.inf:
                raise InputError(f"Cylinder({name}={size!r}): give a length in metres")

    @property
    def direction(self) -> Float[np.ndarray, "3"]:
        """Unit vector along the axis."""
        return unit_vector(self.axis)

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Signed distance of points from its surface, negative inside [m]."""
        offset = points - np.asarray(self.axis_point, float)
        along = offset @ self.direction
        across = np.linalg.norm(offset - along[:, None] * self.direction, axis=1)
        half_length = np.inf if self.length is None else self.length / 2
        radial = across - self.diameter / 2
        beyond = np.abs(along) - half_length
        outside = np.hypot(np.maximum(radial, 0), np.maximum(beyond, 0))
        inside = np.minimum(np.maximum(radial, beyond), 0)
        return outside + inside


class CylinderParts(NamedTuple):
    """Cylinders, and the index of the one that each surface fragment belongs to."""

    cylinders: tuple[Cylinder, ...]
    fragment: Int[np.ndarray, " s"]

    def rows(self) -> list[dict[str, Any]]:
        """Table of the cylinders in plain types."""
        counts = np.bincount(self.fragment, minlength=len(self.cylinders))
        return [
            {
                "part": number,
                "axis_point_m": [float(x) for x in cylinder.axis_point],
                "axis": [float(x) for x in cylinder.direction],
                "diameter_m": float(cylinder.diameter),
                "length_m": None if cylinder.length is None else float(cylinder.length),
                "fragments": int(counts[number]),
            }
            for number, cylinder in enumerate(self.cylinders)
        ]


def _nearest_parts(
    cylinders: Sequence[Cylinder], points: Float[np.ndarray, "s 3"]
) -> CylinderParts:
    """Assign each point to the cylinder with the smallest signed distance.

    Raises:
        InputError: if no point is within a diameter of any of them.
    """
    distance = np.stack([cylinder.distance(points) for cylinder in cylinders])
    diameter = np.array([cylinder.diameter for cylinder in cylinders])
    gap = distance.min(1)
    if (gap > diameter).all():
        raise InputError(
            f"cylinders: none is near the surface of body {cylinders[0].body}; the "
            f"nearest is {gap.min():.3g} m away: give axis_point in metres, in the "
            "body's own frame"
        )
    return CylinderParts(tuple(cylinders), distance.argmin(0))


def given_cylinders(argument: Any) -> tuple[Cylinder, ...]:
    """Validate a user's argument `cylinders`; empty for None.

    Raises:
        InputError: unless it is a list of `Cylinder` or None.
    """
    try:
        values = list(argument or ())
    except (TypeError, ValueError):
        values = [argument]
    cylinders = tuple(item for item in values if isinstance(item, Cylinder))
    if len(cylinders) < len(values):
        raise InputError(f"cylinders={argument!r}: give a list of Cylinder, or None")
    return cylinders


# Slabs along the axis; none is thinner than two blocks of voxels.
_MAX_SLABS = 48

# Blocks along the longest edge of the lattice; finer voxels are grouped.
_MAX_BLOCKS = 96

MAX_DIAMETER_RATIO = 1.7
"""Ratio of diameters up to which pieces are merged into one part [-]."""

# Smallest parts, relative to the volume of the body: of any part, and of one that is
# shorter than half its diameter.
_MIN_VOLUME = 0.002
_MIN_STUB_VOLUME = 0.05

# Ratio of second moments from which a part uses its own axis: L > 1.22 D.
_MIN_ELONGATION = 2.0

# Principal axes with this fraction of the largest second moment are equivalent to it.
_EQUAL_MOMENTS = 0.9

# Cosine to an axis of the frame from which the body is cut across that axis.
_ALIGNED = np.cos(np.radians(15.0))


@dataclass(frozen=True)
class _Blocks:
    """Cubes of voxels with any solid voxel."""

    occupied: Bool[np.ndarray, "x y z"]
    centre: Float[np.ndarray, "n 3"]
    """Centre of each occupied block [m]."""
    volume: Float[np.ndarray, " n"]
    """Solid volume of each [m^3]."""
    edge: float
    """Edge of a block [m]."""
    factor: int
    """Voxels along an edge."""


def _blocks(grid: VoxelGrid) -> _Blocks:
    factor = -(-max(grid.solid.shape) // _MAX_BLOCKS)
    shape = np.array([-(-n // factor) for n in grid.solid.shape])
    missing = shape * factor - np.array(grid.solid.shape)
    padded = np.pad(grid.solid, [(0, int(n)) for n in missing])
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


def _main_axis(
    points: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], float]:
    """Main axis of a body, and the ratio of its two largest second moments.

    The longest principal axis; for a disc, with two equal longest axes, the short one;
    for a ball or a cube the one closest to vertical.
    """
    centred = points - np.average(points, axis=0, weights=weight)
    moments, axes = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    equal = moments >= _EQUAL_MOMENTS * moments[-1]
    axis = axes[:, 0] if equal.tolist() == [False, True, True] else axes[:, -1]
    axis = axes @ axes[2] if equal.all() else axis
    second_moment = max(moments[-2], np.finfo(float).tiny)
    ratio = moments[-1] / second_moment
    largest_component = axis[np.abs(axis).argmax()]
    return axis * np.sign(largest_component), float(ratio)


def cylinder_parts(grid: VoxelGrid) -> CylinderParts:
    """Decompose a body into cylinders; assign every surface fragment to one."""
    # Every snapshot of a moving body needs its parts, which do not change.
    return found((grid,), "cylinder parts", lambda: _decomposed(grid))


@stored_search("cylinders", (CylinderParts, Cylinder))
def _decomposed(grid: VoxelGrid) -> CylinderParts:
    blocks = _blocks(grid)
    axis, _ = _main_axis(blocks.centre, blocks.volume)
    main = np.abs(axis).argmax()
    # Slabs slightly askew would cut thin wedges off a flat base.
    axis = np.eye(3)[main] if np.abs(axis[main]) >= _ALIGNED else axis
    slab = _slabs(blocks, axis)
    piece, touching = _pieces(blocks, slab)
    part_of_piece = _join(piece, slab=slab, volume=blocks.volume, touching=touching)
    part_number = part_of_piece[piece]
    part_count = part_number.max() + 1
    fitted = [
        _fitted(blocks, selected=part_number == number, axis=axis)
        for number in range(part_count)
    ]
    volume = np.bincount(part_number, weights=blocks.volume)
    significant = _significant(fitted, volume)
    cylinders = [fitted[p] for p in significant]
    number = np.full(len(fitted), -1)
    number[significant] = np.arange(len(significant))
    lattice = np.full(blocks.occupied.shape, -1)
    lattice[blocks.occupied] = number[part_number]
    block_part = lattice[tuple((grid.fragment_voxel // blocks.factor).T)]
    nearest = _nearest_parts(cylinders, grid.fragment_position).fragment
    fragment = np.where(block_part >= 0, block_part, nearest)
    return CylinderParts(tuple(cylinders), fragment)


def whole_body(grid: VoxelGrid) -> CylinderParts:
    """A body as one part that has all its fragments."""
    blocks = _blocks(grid)
    axis, _ = _main_axis(blocks.centre, blocks.volume)
    whole = _fitted(blocks, selected=np.ones(len(blocks.volume), bool), axis=axis)
    return CylinderParts((whole,), np.zeros(len(grid.fragment_area), np.int64))


def parts_of(
    grid: AbstractGrid, cylinders: tuple[Cylinder, ...], body: int
) -> CylinderParts:
    """The user's cylinders for a body, or else those of its decomposition.

    Raises:
        InputError: if the user's cylinders are far from the body.
    """
    selected = [cylinder for cylinder in cylinders if cylinder.body == body]
    if selected:
        return _nearest_parts(selected, grid.fragment_position)
    # A sheet without cylinders has plates.
    assert isinstance(grid, VoxelGrid)
    return cylinder_parts(grid)


def _extent(
    blocks: _Blocks, selected: Bool[np.ndarray, " n"], axis: Float[np.ndarray, "3"]
) -> tuple[float, float]:
    """Lower end and length of the selected blocks along an axis [m]."""
    along = blocks.centre[selected] @ axis
    # From the centres of the outermost blocks on to their outer faces.
    support = blocks.edge * np.abs(axis).max()
    return float(along.min() - support / 2), float(np.ptp(along) + support)


def _slabs(blocks: _Blocks, axis: Float[np.ndarray, "3"]) -> Int[np.ndarray, " n"]:
    low, length = _extent(blocks, np.ones(len(blocks.volume), bool), axis)
    thinnest_slabs = int(length / (2 * blocks.edge) + 1e-6)
    count = max(1, min(_MAX_SLABS, thinnest_slabs))
    fraction = (blocks.centre @ axis - low) / length
    slab = (fraction * count + 1e-9).astype(np.int64)
    return np.clip(slab, 0, count - 1)


def _pieces(
    blocks: _Blocks, slab: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, "t 2"]]:
    """Number of the piece of each block, and the pairs of pieces that touch."""
    lattice = np.zeros(blocks.occupied.shape, np.int64)
    lattice[blocks.occupied] = slab + 1
    label = np.asarray(measure.label(lattice, background=0, connectivity=3))
    pairs = []
    for axis in range(3):
        layered = np.moveaxis(label, axis, 0)
        below = layered[:-1]
        above = layered[1:]
        differ = (below > 0) & (above > 0) & (below != above)
        pairs.append(np.stack([below[differ], above[differ]], axis=1))
    ordered_pairs = np.sort(np.concatenate(pairs), axis=1)
    touching = np.unique(ordered_pairs, axis=0)
    piece = label[blocks.occupied] - 1
    return piece, touching - 1


def _join(
    piece: Int[np.ndarray, " n"],
    slab: Int[np.ndarray, " n"],
    volume: Float[np.ndarray, " n"],
    touching: Int[np.ndarray, "t 2"],
) -> Int[np.ndarray, " p"]:
    """Number of the part of each piece, by merging the most similar ones first."""
    _, first = np.unique(piece, return_index=True)
    # Volume of each part, and its slabs as a bit mask.
    volumes = np.bincount(piece, volume)
    slabs = [1 << int(s) for s in slab[first]]
    neighbours = [set() for _ in first]
    for a, b in touching.tolist():
        neighbours[a].add(b)
        neighbours[b].add(a)
    part_of_piece = np.arange(len(first))

    def dissimilarity(pair):
        a, b = pair
        # Volumes per slab go with the squares of the diameters.
        sections = [volumes[p] / slabs[p].bit_count() for p in pair]
        return np.inf if slabs[a] & slabs[b] else max(sections) / min(sections)

    pairs = {
        (a, b): dissimilarity((a, b))
        for a in range(len(neighbours))
        for b in neighbours[a]
        if a < b
    }
    while pairs and min(pairs.values()) <= MAX_DIAMETER_RATIO**2:
        a, b = min(pairs, key=lambda pair: pairs[pair])
        volumes[a] += volumes[b]
        slabs[a] |= slabs[b]
        part_of_piece[part_of_piece == b] = a
        neighbours[a] = (neighbours[a] | neighbours[b]) - {a, b}
        pairs = {pair: v for pair, v in pairs.items() if not {a, b} & set(pair)}
        for neighbour in neighbours[a]:
            neighbours[neighbour] = (neighbours[neighbour] - {b}) | {a}
            pair = (min(a, neighbour), max(a, neighbour))
            pairs[pair] = dissimilarity(pair)
    _, part_number = np.unique(part_of_piece, return_inverse=True)
    return part_number.reshape(-1)


def _fitted(
    blocks: _Blocks, selected: Bool[np.ndarray, " n"], axis: Float[np.ndarray, "3"]
) -> Cylinder:
    centre = blocks.centre[selected]
    volume = blocks.volume[selected]
    main, ratio = _main_axis(centre, volume)
    axis = main if ratio >= _MIN_ELONGATION else axis
    low, length = _extent(blocks, selected, axis)
    middle = np.average(centre, axis=0, weights=volume)
    middle = middle + (low + length / 2 - middle @ axis) * axis
    diameter = 2 * np.sqrt(volume.sum() / (np.pi * length))
    return Cylinder(
        axis_point=middle,
        axis=axis,
        diameter=float(diameter),
        length=length,
    )


def _significant(
    cylinders: list[Cylinder], volume: Float[np.ndarray, " p"]
) -> list[int]:
    """Numbers of the cylinders that are not too small, the largest first."""
    fraction = volume / volume.sum()
    stub = [c.length is not None and bool(c.length < c.diameter / 2) for c in cylinders]
    minimum = np.where(stub, _MIN_STUB_VOLUME, _MIN_VOLUME)
    order = np.argsort(-fraction, kind="stable")
    # The largest always remains, whatever its shape.
    return [int(p) for p in order if fraction[p] >= minimum[p] or p == order[0]]
