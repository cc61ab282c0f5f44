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
from scipy.sparse import csr_array


# Spacing of the coarse lattice [voxels]. With 3 the factors of a plane's cells differ
# twice as much; with more a limb's loss is far from where it is made good.
_SPACING = 4

# Longest side of a triangle whose middle stands for it [voxels]; of larger ones the
# middles of the sides do, with which hat functions on a plane along axes are exact.
_SMALL = 1.5

# Parts of the spacing that are none.
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

    def chosen(self, which: slice) -> "Patches":
        """Some of them."""
        return Patches(self.position[:, which], self.normal[which], self.area[which])


def areas_of_mesh(
    cells: Patches, triangles: Float[np.ndarray, "f 3 3"], shape: tuple[int, int, int]
) -> Float[np.ndarray, " s"]:
    """Areas of the cells that add up to those of the triangles, nearby [voxel faces].

    Args:
        cells: of all crossings: those that are left out later take their part away.
        triangles: of the mesh [voxels].
        shape: number of voxels of the lattice.
    """
    nodes = _Nodes.around(cells.position, shape)
    true = nodes.total(_pieces(triangles, _AT_ONCE))
    parts = [
        cells.chosen(slice(start, start + _AT_ONCE))
        for start in range(0, len(cells.area), _AT_ONCE)
    ]
    found = nodes.total(parts)
    ratio = true / np.where(found > 0, found, 1)
    factor = np.concatenate([nodes.means(ratio, part) for part in parts])
    return cells.area * np.clip(factor, 1 / _MAX_FACTOR, _MAX_FACTOR)


class _Nodes(NamedTuple):
    """Nodes of the coarse lattice near the cells; the last slot is that of others."""

    shape: tuple[int, ...]
    slot: Int[np.ndarray, " n"]
    count: int

    @classmethod
    def around(
        cls, position: Float[np.ndarray, "p s 3"], shape: tuple[int, int, int]
    ) -> "_Nodes":
        """Those whose hats reach one of some positions."""
        # One more on either side: crossings may be a little outside the lattice.
        coarse = tuple(n // _SPACING + 4 for n in shape)
        first, _ = _places(position, coarse)
        has_cell = np.zeros(np.prod(coarse), bool)
        has_cell[first] = True
        found = np.flatnonzero(has_cell)
        is_near = np.zeros_like(has_cell)
        for step in _corners(coarse):
            is_near[found + step] = True
        count = int(is_near.sum())
        slot = np.where(is_near, np.cumsum(is_near, dtype=np.int32) - 1, count)
        return cls(coarse, slot.astype(np.int32), count + 1)

    def _hats(self, patches: Patches) -> csr_array:
        """Means of the hat functions over patches: a row each, a column a node."""
        first, beyond = _places(patches.position, self.shape)
        node = np.empty((len(first), 8), np.int32)
        hat = np.zeros((len(first), 8))
        for n, step in enumerate(_corners(self.shape)):
            node[:, n] = self.slot[first + step]
        for x, y, z in beyond:
            for i, j in np.ndindex(2, 2):
                both = (x if i else 1 - x) * (y if j else 1 - y)
                above = both * z
                hat[:, 4 * i + 2 * j] += both - above
                hat[:, 4 * i + 2 * j + 1] += above
        hat /= len(beyond)
        ends = np.arange(0, 8 * len(first) + 1, 8, dtype=np.int32)
        shape = len(first), self.count
        return csr_array((hat.reshape(-1), node.reshape(-1), ends), shape)

    def total(self, parts: Iterable[Patches]) -> Float[np.ndarray, "n 6"]:
        """Areas of patches, shared out to nodes and signed axes."""
        sums = np.zeros((self.count, 6))
        for patches in parts:
            areas = np.square(patches.normal) * patches.area[:, None]
            sums += self._hats(patches).T @ _on_sides(areas, patches.normal)
        return sums

    def means(
        self, values: Float[np.ndarray, "n 6"], patches: Patches
    ) -> Float[np.ndarray, " s"]:
        """Values of the sums at the patches."""
        weight = _on_sides(np.square(patches.normal), patches.normal)
        return np.einsum("sa,sa->s", self._hats(patches) @ values, weight)


def _on_sides(
    values: Float[np.ndarray, "s 3"], normal: Float[np.ndarray, "s 3"]
) -> Float[np.ndarray, "s 6"]:
    """Values of the axes on the side that a normal points to, 0 on the other one."""
    is_above = normal > 0
    return np.hstack([np.where(is_above, values, 0), np.where(is_above, 0, values)])


def _places(
    position: Float[np.ndarray, "p s 3"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, " s"], list[list[np.ndarray]]]:
    """First of the eight nodes around each patch, and how far its points are beyond."""
    first, beyond = np.zeros(position.shape[1], np.int64), [[] for _ in position]
    for axis, n in enumerate(shape):
        places = [points[:, axis] / _SPACING + 1 for points in position]
        # Of their mean: a point may lie on the border of the cell.
        middle = places[0] if len(places) == 1 else sum(places) / len(places)
        below = np.clip(np.floor(middle), 0, n - 2)
        for own, place in zip(beyond, places, strict=True):
            own.append(place - below)
        first *= n
        first += below.astype(np.int64)
    return first, beyond


def _corners(shape: tuple[int, ...]) -> list[int]:
    """From the first to each of the eight nodes around a position."""
    _, y, z = shape
    return [i * y * z + j * z + k for i, j, k in np.ndindex(2, 2, 2)]


def _pieces(triangles: Float[np.ndarray, "f 3 3"], at_once: int) -> Iterator[Patches]:
    """Pieces of triangles, about as many as asked for at once."""
    vector, longest = _area_vectors(triangles), _longest(triangles)
    many = 3 + _lengths(vector) / 2 + 2 * longest
    chunk = (np.cumsum(many) / at_once).astype(int)
    ends = [*(np.flatnonzero(np.diff(chunk)) + 1), len(triangles)]
    for start, stop in pairwise([0, *ends]):
        is_small = longest[start:stop] <= _SMALL
        own = triangles[start:stop]
        yield _patches([own[is_small].mean(axis=1)], vector[start:stop][is_small])
        large = own[~is_small]
        for axis in range(3):
            large = np.concatenate([*_cut(large, axis), large[:0]])
        middles = [(large[:, n] + large[:, n - 1]) / 2 for n in range(3)]
        yield _patches(middles, _area_vectors(large))


def _patches(
    points: list[Float[np.ndarray, "s 3"]], vector: Float[np.ndarray, "s 3"]
) -> Patches:
    area = _lengths(vector)
    normal = vector / np.where(area > 0, area, 1)[:, None]
    return Patches(np.stack(points), normal, area)


def _cut(triangles: Float[np.ndarray, "f 3 3"], axis: int) -> list[np.ndarray]:
    """Triangles cut by the planes of coarse nodes, where hat functions have kinks."""
    done = []
    while len(triangles):
        zero, one, two = along = triangles[..., axis].T / _SPACING
        # Corner by corner: numpy is slow along an axis of length three.
        low, high = (f(f(zero, one), two) for f in (np.minimum, np.maximum))
        first, last = np.floor(low + _TINY) + 1, np.ceil(high - _TINY) - 1
        is_cut = first <= last
        done.append(triangles.take(np.flatnonzero(~is_cut), axis=0))
        cut = np.flatnonzero(is_cut)
        plane, along = (first + last)[cut] // 2, along[:, cut]
        zero, one, two = along > plane
        # Turned so that the first corner is alone on its side of the plane.
        most = (zero & one) | (zero & two) | (one & two)
        alone = (one != most) + 2 * (two != most)
        corner = [(alone + n) % 3 for n in range(3)]
        points = triangles.reshape(-1, 3)
        a, b, c = (points.take(3 * cut + own, axis=0) for own in corner)
        at, to_b, to_c = (along[own, np.arange(len(cut))] for own in corner)
        p = a + ((plane - at) / (to_b - at))[:, None] * (b - a)
        q = a + ((plane - at) / (to_c - at))[:, None] * (c - a)
        pieces = (a, p, q), (p, b, c), (p, c, q)
        triangles = np.empty((3, len(cut), 3, 3))
        for own, corners in zip(triangles, pieces, strict=True):
            own[:, 0], own[:, 1], own[:, 2] = corners
        triangles = triangles.reshape(-1, 3, 3)
    return done


def _longest(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, " f"]:
    """Longest sides."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    sides = (_lengths(b - a), _lengths(c - b), _lengths(a - c))
    return np.maximum(np.maximum(*sides[:2]), sides[2])


def _lengths(vector: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    x, y, z = vector.T
    return np.sqrt(x * x + y * y + z * z)


def _area_vectors(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a) / 2
