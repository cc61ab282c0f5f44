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

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


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

# Least number of pieces that are made at once.
_MIN_PIECES = 2**14


class Patches(NamedTuple):
    """Pieces of surface, in voxels."""

    position: Float[np.ndarray, "s 3"]
    """Middle."""
    normal: Float[np.ndarray, "s 3"]
    area: Float[np.ndarray, " s"]


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
    true, at_once = np.zeros(nodes.sums), max(len(cells.area) // 4, _MIN_PIECES)
    for pieces in _pieces(triangles, at_once):
        true += nodes.shared_out(pieces)
    found = nodes.shared_out(cells)
    ratio = true / np.where(found > 0, found, 1)
    factor = np.zeros(len(cells.area))
    for index, weight in nodes.shares(cells):
        factor += weight * ratio[index]
    return cells.area * np.clip(factor, 1 / _MAX_FACTOR, _MAX_FACTOR)


class _Nodes(NamedTuple):
    """Nodes of the coarse lattice near the cells; the last slot is that of others."""

    shape: tuple[int, ...]
    slot: Int[np.ndarray, " n"]
    count: int

    @classmethod
    def around(
        cls, position: Float[np.ndarray, "s 3"], shape: tuple[int, int, int]
    ) -> "_Nodes":
        """Those whose hats reach one of some positions."""
        # One more on either side: crossings may be a little outside the lattice.
        coarse = tuple(n // _SPACING + 4 for n in shape)
        is_near = np.zeros(np.prod(coarse), bool)
        for node, _ in _hats(position, coarse):
            is_near[node] = True
        count = int(is_near.sum())
        slot = np.where(is_near, np.cumsum(is_near, dtype=np.int32) - 1, count)
        return cls(coarse, slot.astype(np.int32), count + 1)

    @property
    def sums(self) -> int:
        """Number of sums: six, of the signed axes, for each node."""
        return 6 * self.count

    def shares(self, patches: Patches) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Sums that patches have part in, and how much of their areas."""
        axes = [np.ascontiguousarray(along) for along in patches.normal.T]
        sides = [(2 * a + (along > 0)) * self.count for a, along in enumerate(axes)]
        squares = [np.square(along) for along in axes]
        for node, hat in _hats(patches.position, self.shape):
            slot = self.slot[node]
            for side, square in zip(sides, squares, strict=True):
                yield side + slot, hat * square

    def shared_out(self, patches: Patches) -> Float[np.ndarray, " n"]:
        """Sums of areas."""
        total = np.zeros(self.sums)
        for index, weight in self.shares(patches):
            total += np.bincount(index, weight * patches.area, self.sums)
        return total


def _hats(
    position: Float[np.ndarray, "s 3"], shape: tuple[int, ...]
) -> Iterator[tuple[Int[np.ndarray, " s"], Float[np.ndarray, " s"]]]:
    """Eight nodes around each position, and their hat functions there."""
    place = [along / _SPACING + 1 for along in position.T]
    first = [
        np.clip(np.floor(p).astype(np.int64), 0, n - 2)
        for p, n in zip(place, shape, strict=True)
    ]
    upper = [p - f for p, f in zip(place, first, strict=True)]
    x, y, z = ((1 - part, part) for part in upper)
    node = np.asarray(np.ravel_multi_index(tuple(first), shape))
    for i, j, k in np.ndindex(2, 2, 2):
        yield node + np.ravel_multi_index((i, j, k), shape), x[i] * y[j] * z[k]


def _pieces(triangles: Float[np.ndarray, "f 3 3"], at_once: int) -> Iterator[Patches]:
    """Pieces of triangles, about as many as asked for at once."""
    size = np.linalg.norm(_area_vectors(triangles), axis=1)
    many = 3 + size / 2 + 2 * _longest(triangles)
    chunk = (np.cumsum(many) / at_once).astype(int)
    start = np.flatnonzero(np.diff(chunk)) + 1
    for own in np.split(triangles, start):
        is_small = _longest(own) <= _SMALL
        vector = _area_vectors(own[is_small])
        yield _patches(own[is_small].mean(axis=1), vector)
        large = own[~is_small]
        for axis in range(3):
            large = np.concatenate([*_cut(large, axis), large[:0]])
        middles = (large + np.roll(large, -1, axis=1)).reshape(-1, 3) / 2
        yield _patches(middles, np.repeat(_area_vectors(large) / 3, 3, axis=0))


def _patches(
    position: Float[np.ndarray, "s 3"], vector: Float[np.ndarray, "s 3"]
) -> Patches:
    area = np.linalg.norm(vector, axis=1)
    return Patches(position, vector / np.where(area > 0, area, 1)[:, None], area)


def _cut(triangles: Float[np.ndarray, "f 3 3"], axis: int) -> list[np.ndarray]:
    """Triangles cut by the planes of coarse nodes, where hat functions have kinks."""
    done = []
    while len(triangles):
        along = triangles[..., axis] / _SPACING
        first = np.floor(along.min(axis=1) + _TINY) + 1
        last = np.ceil(along.max(axis=1) - _TINY) - 1
        is_cut = first <= last
        done.append(triangles[~is_cut])
        rest, along = triangles[is_cut], along[is_cut]
        plane = ((first + last)[is_cut] // 2)[:, None]
        above = along > plane
        # Turned so that the first corner is alone on its side of the plane.
        alone = np.where(above.sum(axis=1) == 1, above.argmax(1), above.argmin(1))
        order = (alone[:, None] + np.arange(3)) % 3
        rest, along = (v[np.arange(len(v))[:, None], order] for v in (rest, along))
        part = (plane - along[:, :1]) / (along[:, 1:] - along[:, :1])
        a, b, c = np.moveaxis(rest, 1, 0)
        p, q = a + part[:, :1] * (b - a), a + part[:, 1:] * (c - a)
        corners = (a, p, q), (p, b, c), (p, c, q)
        triangles = np.concatenate([np.stack(each, axis=1) for each in corners])
    return done


def _longest(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, " f"]:
    """Longest sides."""
    side = np.roll(triangles, -1, axis=1) - triangles
    return np.linalg.norm(side, axis=2).max(axis=1, initial=0)


def _area_vectors(triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a) / 2
