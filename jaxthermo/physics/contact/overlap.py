"""Overlap of bodies: where two of them occupy the same space, and how deeply.

The common part is counted in the voxels of the finer body whose centres lie in solid
voxels of the other. At a point of it the bodies overlap by the sum of its depths below
both surfaces, each the distance to the tangent plane of the nearest fragment: exact for
facing planes at any angle, whereas voxels are known to a voxel only. Bodies that touch
overlap by rounding; an overlap of up to a voxel of the coarser one counts as contact.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from ...errors import InputError
from ...geometry.vectors import row_dot
from ...memo.stored import stored_search
from ...voxels.grid import VoxelGrid
from .rays import PlacedGrid


# Voxels that are compared at a time, which limits the memory.
_CHUNK = 1_000_000

# Points of the common part at which its depth is evaluated.
_MAX_POINTS = 20_000

# Relative rounding of a depth of exactly one voxel.
_ROUNDING = 1e-6


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
        where = ", ".join(f"{x:.3g}" for x in self.position)
        return (
            f"bodies {bodies[0]} and {bodies[1]} overlap by {1e3 * self.depth:.3g} mm "
            f"around ({where}) m: {self.volume:.3g} m3, {100 * self.fraction:.2g} % of "
            f"body {self.smaller}, has the heat capacity of both; move them apart, or "
            "join them in one mesh"
        )


def find_overlaps(
    bodies: tuple[PlacedGrid, ...], cache: dict | None = None
) -> dict[tuple[int, int], Overlap]:
    """Overlaps of all pairs i < j of bodies by more than a voxel of the coarser one.

    Args:
        bodies: at their poses.
        cache: results by pair and poses, which are read and added to.

    Raises:
        InputError: if a body lies wholly in the solid of another one.
    """
    cache = {} if cache is None else cache
    overlaps = {}
    for i, j in combinations(range(len(bodies)), 2):
        poses = (bodies[i].pose, bodies[j].pose)
        key = (i, j, *(pose.key for pose in poses))
        if key not in cache:
            cache[key] = _overlap(bodies, i, j)
        if cache[key] is not None:
            overlaps[i, j] = cache[key]
    return overlaps


@stored_search("overlap", (Overlap,))
def _overlap(bodies: tuple[PlacedGrid, ...], i: int, j: int) -> Overlap | None:
    # A sheet has no volume.
    if not all(isinstance(bodies[n].grid, VoxelGrid) for n in (i, j)):
        return None
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
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
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
