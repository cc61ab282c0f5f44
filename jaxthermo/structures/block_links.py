"""Links between groups of voxels: shared faces counted, distances to them chosen.

Two groups may share faces on several sides: all three axes, both directions. Each side
conducts k A / (d_src + d_dst); they are parallel, and the one link of the pair gets the
area and the distances that give the sum.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .structure import Links


LEAST_DISTANCE = 0.25
"""Between a centre and a face, in voxels; a centre may lie beyond a bent group's."""


class _Sides(NamedTuple):
    """What each pair shares on each of its sides, sorted by pair."""

    pair: Int[np.ndarray, " c"]
    axis: Int[np.ndarray, " c"]
    sign: Int[np.ndarray, " c"]
    """1 if `dst` is the upper one along the axis, else -1."""
    faces: Int[np.ndarray, " c"]
    plane: Float[np.ndarray, " c"]
    """Mean place of the faces along the axis, in voxels."""


def side_distances(
    to_face: Float[np.ndarray, " c"], from_face: Float[np.ndarray, " c"]
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Distances that the heat travels from centre to shared face to centre, in voxels.

    Along the face's normal: exact between boxes of any two sizes, where the straight
    line between the centres is too long.

    Args:
        to_face: from the centre of `src` to the faces along their normal, in voxels.
        from_face: from there to the centre of `dst`.
    """
    return np.maximum(to_face, LEAST_DISTANCE), np.maximum(from_face, LEAST_DISTANCE)


def block_links(
    labels: Int[np.ndarray, "x y z"], centre: Float[np.ndarray, "n 3"], pitch: float
) -> Links:
    """One link for each pair of groups that share voxel faces.

    Args:
        labels: group of each voxel, -1 for none.
        centre: of each group, in voxels from the corner of the lattice.
        pitch: edge of a voxel [m].
    """
    sides = _shared_sides(labels, len(centre))
    src, dst = np.divmod(sides.pair, max(len(centre), 1))
    to_src, to_dst = side_distances(
        sides.sign * (sides.plane - centre[src, sides.axis]),
        sides.sign * (centre[dst, sides.axis] - sides.plane),
    )
    conductance = sides.faces / (to_src + to_dst)
    start = _starts(sides.pair)
    total = np.add.reduceat(conductance, start)
    area = np.add.reduceat(sides.faces, start)
    # Of the temperature drop, the mean share on the side of `src`.
    share = np.add.reduceat(conductance * to_src / (to_src + to_dst), start) / total
    distance = area / total * pitch
    return Links(
        src=src[start].astype(np.int32),
        dst=dst[start].astype(np.int32),
        area=area * pitch**2,
        distance_src=distance * share,
        distance_dst=distance * (1 - share),
    )


def _shared_sides(labels: Int[np.ndarray, "x y z"], count: int) -> _Sides:
    """The sides of all pairs of different groups."""
    found = [_faces(labels, axis, count) for axis in range(3)]
    key = np.concatenate([key for key, _ in found])
    plane = np.concatenate([plane for _, plane in found])
    # The lists are nearly sorted where groups are small: a stable sort merges them.
    order = np.argsort(key, kind="stable")
    key = key[order]
    start = _starts(key)
    faces = np.diff(start, append=len(key))
    pair, side = np.divmod(key[start], 6)
    mean_plane = np.add.reduceat(plane[order], start, dtype=float) / faces
    return _Sides(pair, side // 2, side % 2 * 2 - 1, faces, mean_plane)


def _faces(
    labels: Int[np.ndarray, "x y z"], axis: int, count: int
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Pair and side of every shared face across one axis, as one number; its place."""
    below, above = np.delete(labels, -1, axis), np.delete(labels, 0, axis)
    shared = (below != above) & (below >= 0) & (above >= 0)
    ranks = np.arange(1, labels.shape[axis], dtype=np.int32)
    ranks = ranks.reshape([-1 if i == axis else 1 for i in range(3)])
    plane = np.broadcast_to(ranks, shared.shape)[shared]
    below, above = below[shared], above[shared]
    src = np.minimum(below, above).astype(np.int64)
    pair = src * count + np.maximum(below, above)
    return pair * 6 + 2 * axis + (below < above), plane


def _starts(ordered: Int[np.ndarray, " k"]) -> Int[np.ndarray, " u"]:
    """Where each run of equal numbers begins."""
    changes = np.ones(len(ordered), bool)
    changes[1:] = ordered[1:] != ordered[:-1]
    return np.flatnonzero(changes)
