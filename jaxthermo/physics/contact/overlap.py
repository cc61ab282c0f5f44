"""Overlap of bodies: where two of them occupy the same space, and how deeply.

The common part is counted in the voxels of the finer body whose centres lie in solid
voxels of the other. At a point of it the bodies overlap by the sum of its depths below
both surfaces, each the distance to the tangent plane of the nearest fragment: exact for
facing planes at any angle, whereas voxels are known to a voxel only. Bodies that touch
overlap by rounding; an overlap of up to a voxel of the coarser one counts as contact.

A sheet has no volume, only an area within the solid of another body.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from ...errors import InputError
from ...geometry.vectors import row_dot
from ...memo.stored import stored_search
from ...sheets.sheet_grid import SheetGrid
from ..together import found_between
from .rays import ContactRange, PlacedGrid, coarser_pitch


# Voxels that are compared at a time, which limits the memory.
_CHUNK = 1_000_000

# Points of the common part at which its depth is evaluated.
_MAX_POINTS = 20_000

# Relative rounding of a depth of exactly one voxel.
_ROUNDING = 1e-6

_AXIS_DIRECTIONS = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])


class Overlap(NamedTuple):
    """The common part of two bodies."""

    volume: float
    """Common volume [m^3]."""
    fraction: float
    """Common volume over that of the smaller body [-]."""
    smaller: int
    """Number of the smaller body."""
    depth: float
    """Largest sum of the depths below both surfaces [m]."""
    position: Float[np.ndarray, "3"]
    """Deepest point, world [m]."""

    def described(self, bodies: tuple[int, int]) -> str:
        """One line about the overlap of these bodies."""
        where = _place(self.position)
        return (
            f"bodies {bodies[0]} and {bodies[1]} overlap by {1e3 * self.depth:.3g} mm "
            f"around {where}: {self.volume:.3g} m3, {100 * self.fraction:.2g} % of "
            f"body {self.smaller}, has the heat capacity of both; move them apart, or "
            "join them in one mesh"
        )


class SheetOverlap(NamedTuple):
    """The part of a sheet that is in the solid of another body."""

    area: float
    """Area of one face of it [m^2]."""
    sheet: int
    """Number of the sheet."""
    depth: float
    """Largest depth below the surface of the solid [m]."""
    position: Float[np.ndarray, "3"]
    """Deepest point, world [m]."""

    def described(self, bodies: tuple[int, int]) -> str:
        """One line about the overlap of these bodies."""
        (solid,) = set(bodies) - {self.sheet}
        return (
            f"body {self.sheet}, a sheet, passes through body {solid}: {self.area:.3g} "
            f"m2 of it are in the solid, up to {1e3 * self.depth:.3g} mm deep around "
            f"{_place(self.position)}, and exchange heat as if nothing were there; "
            "move them apart, or end the sheet at the surface"
        )


def _place(position: Float[np.ndarray, "3"]) -> str:
    return f"({', '.join(f'{x:.3g}' for x in position)}) m"


AnyOverlap = Overlap | SheetOverlap


def find_overlaps(
    bodies: tuple[PlacedGrid, ...],
) -> dict[tuple[int, int], AnyOverlap]:
    """Overlaps of all pairs i < j of bodies by more than a voxel of the coarser one.

    Those of two bodies that move together are searched for once.

    Raises:
        InputError: if a body lies wholly in the solid of another one.
    """
    overlaps = {}
    for i, j in _near_pairs(bodies):
        overlap = found_between(
            (bodies[i].grid, bodies[j].grid),
            poses=(bodies[i].pose, bodies[j].pose),
            by=("overlap", i, j),
            find=partial(_overlap_in_first, bodies, i, j),
            search="overlaps of bodies",
        )
        if overlap is not None:
            position = bodies[i].pose.to_world(overlap.position)
            overlaps[i, j] = overlap._replace(position=position)
    return overlaps


def _overlap_in_first(
    bodies: tuple[PlacedGrid, ...], i: int, j: int
) -> AnyOverlap | None:
    """The overlap with its deepest point in the frame of the first body."""
    overlap = _overlap({i: bodies[i], j: bodies[j]}, i, j)
    if overlap is None:
        return None
    return overlap._replace(position=bodies[i].pose.to_body(overlap.position))


def _near_pairs(bodies: tuple[PlacedGrid, ...]) -> list[list[int]]:
    """Pairs i < j of bodies whose boxes overlap."""
    # Voxels may project beyond the mesh.
    pitch = np.array([body.pitch for body in bodies])[:, None]
    bounds = np.stack([body.world_bounds for body in bodies])
    low = bounds[:, 0] - pitch
    high = bounds[:, 1] + pitch
    is_near = (low[:, None] <= high[None]).all(axis=2)
    return np.argwhere(np.triu(is_near & is_near.T, 1)).tolist()


@stored_search("overlap", (Overlap, SheetOverlap))
def _overlap(bodies: Mapping[int, PlacedGrid], i: int, j: int) -> AnyOverlap | None:
    if bodies[i].is_sheet and bodies[j].is_sheet:
        return None
    if bodies[i].is_sheet or bodies[j].is_sheet:
        sheet, solid = (i, j) if bodies[i].is_sheet else (j, i)
        return _sheet_overlap(bodies, sheet=sheet, solid=solid)
    # The finer body's voxels are counted.
    finer, coarser = sorted((i, j), key=lambda number: bodies[number].pitch)
    a = bodies[finer]
    b = bodies[coarser]
    if not (_below(a.world_bounds[0], b) and _below(b.world_bounds[0], a)):
        return None
    chunks = [centres[b.contains(centres)] for centres in _centres_near(a, b)]
    points = np.concatenate([np.zeros((0, 3)), *chunks])
    if not len(points):
        return None
    samples = points[:: -(-len(points) // _MAX_POINTS)]
    depths = _depth_below(a, samples) + _depth_below(b, samples)
    deepest = int(depths.argmax())
    is_deep = bool(depths[deepest] > b.pitch * (1 + _ROUNDING))
    volume = len(points) * a.pitch**3
    sizes = [body.voxels.solid_count * body.pitch**3 for body in (a, b)]
    for inner, outer, size in zip(
        (finer, coarser), (coarser, finer), sizes, strict=True
    ):
        # Half of the volume, since voxels of two sizes count it differently.
        if volume > size / 2 and _is_within(bodies[inner], bodies[outer], is_deep):
            raise InputError(
                f"body {inner} lies wholly in the solid of body {outer}: move it out, "
                "give the other a cavity for it, or a region of another material"
            )
    if not is_deep:
        return None
    return Overlap(
        volume=volume,
        fraction=volume / min(sizes),
        smaller=(finer, coarser)[int(np.argmin(sizes))],
        depth=float(depths[deepest]),
        position=samples[deepest],
    )


def _sheet_overlap(
    bodies: Mapping[int, PlacedGrid], *, sheet: int, solid: int
) -> SheetOverlap | None:
    around = bodies[solid]
    grid = bodies[sheet].grid
    assert isinstance(grid, SheetGrid)
    low, high = around.world_bounds
    # Voxels may project beyond the mesh.
    corners = _box_corners(low - around.pitch, high + around.pitch)
    near = _between(grid.thirds.position, bodies[sheet].pose.to_body(corners))
    points = bodies[sheet].pose.to_world(grid.thirds.position[near])
    is_inside = around.contains(points)
    if not is_inside.any():
        return None
    inside = points[is_inside]
    depths = _depth_below(around, inside)
    deepest = int(depths.argmax())
    is_deep = bool(depths[deepest] > around.pitch * (1 + _ROUNDING))
    # By rounding a sheet that lies on a solid may be in its voxels.
    min_depth = 0.5 * around.pitch * (1 - _ROUNDING)
    is_wholly_inside = len(inside) == len(grid.thirds.area)
    if is_wholly_inside and (is_deep or (depths >= min_depth).all()):
        raise InputError(
            f"body {sheet}, a sheet, lies wholly in the solid of body {solid}: move it "
            "out, give the other a cavity for it, or a region of another material"
        )
    if not is_deep:
        return None
    return SheetOverlap(
        area=float(grid.thirds.area[near[is_inside]].sum()),
        sheet=sheet,
        depth=float(depths[deepest]),
        position=inside[deepest],
    )


def _box_corners(
    low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "8 3"]:
    return np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)


def _between(
    points: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "8 3"]
) -> Int[np.ndarray, " m"]:
    """Numbers of the points between the lowest and the highest of the corners."""
    is_near = (points >= corners.min(axis=0)) & (points <= corners.max(axis=0))
    return np.flatnonzero(is_near.all(axis=1))


def _is_within(inner: PlacedGrid, outer: PlacedGrid, is_deep: bool) -> bool:
    """True if all solid voxels of one body are in solid ones of another."""
    # A body in a cavity is in no solid voxel. Centres of a thin plate that touches may
    # be, by rounding: unless the overlap is deep, whole voxels must be below the
    # surface.
    min_depth = 0.5 * inner.pitch * (1 - _ROUNDING)
    for centres in _centres_near(inner, inner):
        if not outer.contains(centres).all():
            return False
        if not is_deep and (_depth_below(outer, centres) < min_depth).any():
            return False
    return True


def _below(corner: Float[np.ndarray, "3"], body: PlacedGrid) -> bool:
    return bool((corner < body.world_bounds[1]).all())


def _centres_near(
    body: PlacedGrid, neighbour: PlacedGrid
) -> Iterator[Float[np.ndarray, "n 3"]]:
    """Centres of a body's solid voxels near another body, in the world [m]."""
    lattice = body.grid.lattice
    solid = body.voxels.solid
    low, high = neighbour.world_bounds
    corners = _box_corners(low, high)
    cells = lattice.to_cells(body.pose.to_body(corners))
    first = np.clip(np.floor(cells.min(0)).astype(int), 0, solid.shape)
    last = np.clip(np.ceil(cells.max(0)).astype(int), 0, solid.shape)
    near = solid[tuple(map(slice, first, last))]
    step = max(1, _CHUNK // max(1, int(np.prod(near.shape[1:]))))
    for start in range(0, len(near), step):
        voxels = np.argwhere(near[start : start + step]) + first
        voxels[:, 0] += start
        yield body.pose.to_world(lattice.centres(voxels))


def _depth_below(
    body: PlacedGrid, points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Distance of points to the tangent plane of a body's nearest fragment [m]."""
    nearest = KDTree(body.world_fragments).query(points)[1]
    normal = body.pose.rotate(body.grid.fragment_normal[nearest])
    return row_dot(body.world_fragments[nearest] - points, normal)


def _depth_in(body: PlacedGrid, target: PlacedGrid) -> float:
    """Depth of a body's fragments in another one [m]; 0 if all are outside."""
    # The shortest way out of its voxels along the axes of its lattice, to half a voxel.
    if target.is_sheet:
        return 0.0
    solid = np.pad(target.voxels.solid, 1)
    points = body.world_fragments
    points = target.pose.to_body(points[target.contains(points)])
    if not len(points):
        return 0.0
    cells = np.floor(target.grid.lattice.to_cells(points)).astype(np.int64)
    # Padded on all sides, so that every way out ends.
    cells = np.unique(cells + 1, axis=0)
    steps = 0
    while len(cells):
        steps += 1
        ahead = np.clip(
            cells[:, None] + steps * _AXIS_DIRECTIONS, 0, np.array(solid.shape) - 1
        )
        cells = cells[solid[tuple(np.moveaxis(ahead, 2, 0))].all(1)]
    return (steps - 0.5) * target.pitch


def _fraction_inside(body: PlacedGrid, target: PlacedGrid) -> float:
    """Fraction of a body's fragments with a voxel centre inside another body."""
    # A sheet has none: by rounding it may be inside the solid on which it lies.
    if body.is_sheet:
        return 0.0
    voxels = body.grid.fragment_centre
    return float(target.contains(body.pose.to_world(voxels)).mean())


def require_shallow(a: PlacedGrid, b: PlacedGrid, threshold: float) -> None:
    """Raise an error for bodies that overlap too deeply to be in contact.

    `threshold` is the largest gap that counts as contact [m].

    Raises:
        InputError: naming both bodies and the depth.
    """
    depth = max(_depth_in(a, b), _depth_in(b, a))
    # The depth is known to half a voxel.
    limit = ContactRange.between(a, b, threshold).max_overlap
    limit += 0.5 * coarser_pitch(a, b)
    # Thin bodies can be inside each other entirely at a small depth.
    if depth > limit or max(_fraction_inside(a, b), _fraction_inside(b, a)) > 0.5:
        raise InputError(
            f"{a.name} and {b.name} overlap by about {depth:.3g} m: move them apart "
            "until they touch, or join them in one mesh"
        )
