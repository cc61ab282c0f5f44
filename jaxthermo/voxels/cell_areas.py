"""Areas of surface cells from the mesh: what its rays miss or add nearby.

|n_a| h^2 of all crossings (see `crossings`) is a sum over the points of a lattice. On a
ball of few voxels it is off by 1 %, by how the lattice lies about it: most where the
surface turns along a ray. The mesh has the area itself. Hat functions phi_J of a coarse
lattice, which add up to 1, and the signed axes a, whose n_a^2 add up to 1, share both
out:

    A_i' = A_i sum over a and J of n_ia^2 phi_J(x_i) M_aJ / S_aJ
    M_aJ = integral of n_a^2 phi_J dA over the mesh
    S_aJ = sum over the cells i of A_i n_ia^2 phi_J(x_i)

The sum of A_i' is the mesh's area. The factor is near 1 and smooth, so that the cells
of a plane keep theirs, and both sides of a wall or an edge have one each.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..geometry.mesh import area_components


# Spacing of the coarse lattice [voxels]. With 3 the factors of a plane's cells differ
# twice as much; with more a limb's loss is far from where it is made good.
_SPACING = 4

# Longest side of a triangle whose middle stands for it [voxels]; of larger ones the
# middles of the sides do, with which hat functions on a plane along axes are exact.
_SMALL = 1.5

# Tolerance of rounding [spacings].
_TINY = 1e-9

# Largest factor, and the inverse of the smallest: rays meet a needle by chance, and few
# cells cannot stand for it.
_MAX_FACTOR = 2.0

# Pieces, and cells, that are summed at once: about what a cache holds.
_AT_ONCE = 2**15


class Patches(NamedTuple):
    """Pieces of surface, in voxels."""

    position: Float[np.ndarray, "p s 3"]
    """Points over which a piece is spread evenly, within one cell of the coarse
    lattice; most often its middle."""
    normal: Float[np.ndarray, "s 3"]
    area: Float[np.ndarray, " s"]

    def batches(self) -> Iterator["Patches"]:
        """Consecutive pieces, so few at a time that they fit a cache."""
        for start in range(0, len(self.area), _AT_ONCE):
            chunk = slice(start, start + _AT_ONCE)
            yield Patches(
                position=self.position[:, chunk],
                normal=self.normal[chunk],
                area=self.area[chunk],
            )


class SampledSurface(NamedTuple):
    """Pieces of the surface of a mesh by rays, in voxels."""

    outer: Patches
    """On the outside of the body."""
    hidden: Patches
    """Within it, or a second time on its surface."""

    @property
    def hidden_fraction(self) -> float:
        """Fraction of the area of the mesh that is no surface of the body [-]."""
        hidden = float(self.hidden.area.sum())
        total = hidden + float(self.outer.area.sum())
        return hidden / total if total else 0.0


def areas_of_mesh(
    cells: Patches,
    triangles: Float[np.ndarray, "f 3 3"],
    shape: tuple[int, int, int],
    sampled: SampledSurface | None = None,
) -> Float[np.ndarray, " s"]:
    """Areas of the cells that add up to those of the triangles, nearby [voxel faces].

    Args:
        cells: of all crossings, with those that no voxel has: these keep their share.
        triangles: of the mesh [voxels].
        shape: number of voxels of the lattice.
        sampled: samples of the surface of a mesh that lies inside the body in part:
            the cells get the area of what is outside.
    """
    nodes = _Nodes.around(cells, shape)
    mesh_area = nodes.total(_pieces(triangles, _AT_ONCE))
    if sampled is not None:
        outer_area = nodes.total(sampled.outer.batches())
        sampled_area = outer_area + nodes.total(sampled.hidden.batches())
        mesh_area *= outer_area / np.where(sampled_area > 0, sampled_area, 1)
    cell_area = nodes.total(cells.batches())
    ratio = mesh_area / np.where(cell_area > 0, cell_area, 1)
    factor = np.concatenate([nodes.means(ratio, batch) for batch in cells.batches()])
    np.clip(factor, 1 / _MAX_FACTOR, _MAX_FACTOR, out=factor)
    factor *= cells.area
    return factor


class _Nodes(NamedTuple):
    """Nodes of the coarse lattice near the cells."""

    shape: tuple[int, ...]
    slot: Int[np.ndarray, " n"]
    """First of the six sums of each node; nodes far from any cell share the last."""
    count: int

    @classmethod
    def around(cls, cells: Patches, shape: tuple[int, int, int]) -> "_Nodes":
        """Nodes whose hat functions reach a cell."""
        # One more on either side: crossings may be a little outside the lattice.
        coarse = tuple(n // _SPACING + 4 for n in shape)
        has_cell = np.zeros(np.prod(coarse), bool)
        for batch in cells.batches():
            has_cell[_places(batch.position, coarse)[0]] = True
        occupied = np.flatnonzero(has_cell)
        is_near = np.zeros_like(has_cell)
        for step in _corners(coarse):
            is_near[occupied + step] = True
        count = int(is_near.sum())
        slot = np.full(len(is_near), 6 * count)
        slot[is_near] = 6 * np.arange(count)
        return cls(coarse, slot, count + 1)

    def _hats(self, patches: Patches) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Slots of the eight nodes around patches, and means of their hat functions."""
        first, beyond = _places(patches.position, self.shape)
        steps = iter(_corners(self.shape))
        for i, j in np.ndindex(2, 2):
            across = [(x if i else 1 - x) * (y if j else 1 - y) for x, y, _ in beyond]
            above = _mean(
                [hat * z for hat, (_, _, z) in zip(across, beyond, strict=True)]
            )
            for hat in (_mean(across) - above, above):
                yield self.slot[first + next(steps)], hat

    def total(self, batches: Iterable[Patches]) -> Float[np.ndarray, "n 6"]:
        """Areas of patches, shared out to nodes and signed axes."""
        sums = np.zeros(6 * self.count)
        for patches in batches:
            normal = patches.normal.T
            area = patches.area
            shares = [(_sides(n, a), n * n * area) for a, n in enumerate(normal)]
            for slot, hat in self._hats(patches):
                for side, share in shares:
                    np.add.at(sums, slot + side, hat * share)
        return sums.reshape(-1, 6)

    def means(
        self, values: Float[np.ndarray, "n 6"], patches: Patches
    ) -> Float[np.ndarray, " s"]:
        """Values of the sums at the patches."""
        flat = values.reshape(-1)
        mean = np.zeros(len(patches.area))
        shares = [(_sides(n, a), n * n) for a, n in enumerate(patches.normal.T)]
        for slot, hat in self._hats(patches):
            node_value = sum(flat[slot + side] * weight for side, weight in shares)
            mean += hat * node_value
        return mean


def _mean(arrays: list[np.ndarray]) -> np.ndarray:
    return arrays[0] if len(arrays) == 1 else sum(arrays[1:], arrays[0]) / len(arrays)


def _sides(along: Float[np.ndarray, " s"], axis: int) -> Int[np.ndarray, " s"]:
    """Signed axis of normals by their component along an axis."""
    return np.where(along > 0, axis, axis + 3)


def _places(
    position: Float[np.ndarray, "p s 3"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, " s"], list[list[np.ndarray]]]:
    """First of the eight nodes around each patch, and how far its points are beyond."""
    first = np.zeros(position.shape[1], np.int64)
    beyond = [[] for _ in position]
    for axis, n in enumerate(shape):
        coordinates = [points[:, axis] / _SPACING + 1 for points in position]
        # Of their mean: a point may lie on the border of the cell.
        below = np.clip(np.floor(_mean(coordinates)), 0, n - 2)
        for offsets, coordinate in zip(beyond, coordinates, strict=True):
            offsets.append(coordinate - below)
        first *= n
        first += below.astype(np.int64)
    return first, beyond


def _corners(shape: tuple[int, ...]) -> list[int]:
    """From the first to each of the eight nodes around a position."""
    _, y, z = shape
    return [i * y * z + j * z + k for i, j, k in np.ndindex(2, 2, 2)]


# Corners and components of triangles come first: numpy is slow along axes of length
# three, and each component of a corner is one row.
_Corners = Float[np.ndarray, "3 3 _"]


def _pieces(triangles: Float[np.ndarray, "f 3 3"], at_once: int) -> Iterator[Patches]:
    """Pieces of triangles, in batches of about `at_once`."""
    corners = np.ascontiguousarray(np.moveaxis(triangles, 0, 2))
    longest = _longest(corners)
    area = _lengths(np.stack(area_components(*corners)))
    expected_pieces = 3 + area / 2 + 2 * longest
    chunk = (np.cumsum(expected_pieces) / at_once).astype(int)
    ends = [*(np.flatnonzero(np.diff(chunk)) + 1), len(triangles)]
    for start, stop in pairwise([0, *ends]):
        batch = corners[..., start:stop]
        is_small = longest[start:stop] <= _SMALL
        small = batch.take(np.flatnonzero(is_small), axis=2)
        yield _patches(small.sum(axis=0)[None] / 3, small)
        large = batch.take(np.flatnonzero(~is_small), axis=2)
        for axis in range(3):
            large = np.concatenate([*_cut(large, axis), large[..., :0]], axis=2)
        middle = np.empty_like(large)
        for n in range(3):
            np.add(large[n], large[n - 1], out=middle[n])
        middle /= 2
        yield _patches(middle, large)


def _patches(points: Float[np.ndarray, "p 3 s"], corners: _Corners) -> Patches:
    vector = np.stack(area_components(*corners))
    area = _lengths(vector)
    vector /= np.where(area > 0, area, 1)
    return Patches(np.moveaxis(points, 1, 2), vector.T, area)


def _cut(corners: _Corners, axis: int) -> list[_Corners]:
    """Triangles cut by the planes of coarse nodes, where hat functions have kinks."""
    done = []
    while corners.size:
        along = corners[:, axis] / _SPACING
        a, b, c = along
        low = np.minimum(np.minimum(a, b), c)
        high = np.maximum(np.maximum(a, b), c)
        first = np.floor(low + _TINY) + 1
        last = np.ceil(high - _TINY) - 1
        is_cut = first <= last
        done.append(corners.take(np.flatnonzero(~is_cut), axis=2))
        cut = np.flatnonzero(is_cut)
        plane = (first + last)[cut] // 2
        along = along[:, cut]
        a, b, c = along > plane
        # Turned so that the first corner is alone on its side of the plane.
        majority = (a & b) | (a & c) | (b & c)
        alone = (b != majority) + 2 * (c != majority)
        slots = [(alone + n) % 3 * corners[0].size + cut for n in range(3)]
        corners = _halved(corners.reshape(9, -1), slots=slots, plane=plane, axis=axis)
    return done


def _halved(
    rows: Float[np.ndarray, "9 _"],
    slots: list[Int[np.ndarray, " k"]],
    plane: Float[np.ndarray, " k"],
    axis: int,
) -> _Corners:
    """Triangles divided by a plane into three pieces each.

    `slots` has the three corners of each triangle, as indices into the rows of the
    first corner; the corner that is alone on its side of the plane comes first.
    """
    from_a, to_b, to_c = (rows[axis:].take(slot) / _SPACING for slot in slots)
    to_p = (plane - from_a) / (to_b - from_a)
    to_q = (plane - from_a) / (to_c - from_a)
    count = len(plane)
    pieces = np.empty((3, 3, 3 * count))
    for n in range(3):
        # One component of each corner.
        a, b, c = (rows[n:].take(slot) for slot in slots)
        p = a + to_p * (b - a)
        q = a + to_q * (c - a)
        for piece, points in enumerate(((a, p, q), (p, b, c), (p, c, q))):
            for corner, point in enumerate(points):
                pieces[corner, n, piece * count : (piece + 1) * count] = point
    return pieces


def _longest(corners: _Corners) -> Float[np.ndarray, " f"]:
    """Longest sides."""
    a, b, c = corners
    sides = (_lengths(b - a), _lengths(c - b), _lengths(a - c))
    return np.maximum(np.maximum(*sides[:2]), sides[2])


def _lengths(vector: Float[np.ndarray, "3 f"]) -> Float[np.ndarray, " f"]:
    x, y, z = vector
    return np.sqrt(x * x + y * y + z * z)
