"""Links between groups of voxels: the shared face's area and the way across it.

The voxel faces that two groups share are taken for one flat face. On axis i they cover
A_i; the face has the area A = |(A_x, A_y, A_z)|, which does not grow with the steps of
a staircase, and lies the distance sum_i A_i d_i / A along its normal from each centre.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..structure import AbstractStructure, Links


LEAST_DISTANCE = 0.25
"""Between a centre and a face, in voxels; a bent group's centre may lie beyond it."""

STRETCH = 1_000_000
"""Faces taken at a time: temporaries stay small."""


def link_distance(
    normal: Float[np.ndarray, " e"], straight: Float[np.ndarray, " e"]
) -> Float[np.ndarray, " e"]:
    """Way of the heat from centre to centre: half way between two measures of it.

    Along the face's normal is exact where heat flows along it; but where coarse meets
    fine, centres are also apart sideways, which conducts too well along the face. The
    straight line errs the other way. The mean had the smallest largest error on a
    statue heated from three sides, in octrees, over cores and between random cells.

    Args:
        normal: distance along the normal of the shared face.
        straight: distance between the centres, which may be nothing for bent groups.
    """
    return (normal + np.maximum(straight, normal)) / 2


def block_links(
    labels: Int[np.ndarray, "x y z"], centre: Float[np.ndarray, "n 3"], pitch: float
) -> Links:
    """One link for each pair of groups that share voxel faces.

    Args:
        labels: group of each voxel, -1 for none.
        centre: of each group, in voxels from the corner of the lattice.
        pitch: edge of a voxel [m].
    """
    side, plane = _shared_faces(labels, len(centre))
    # A pair's faces stay in one stretch.
    begin = np.searchsorted(side, side[::STRETCH] // 6 * 6)
    begin = np.union1d(0, begin)
    end = np.append(begin[1:], len(side))
    parts = [
        _links(side[i:j], plane[i:j], centre) for i, j in zip(begin, end, strict=True)
    ]
    links = Links(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    return links._replace(
        area=links.area * pitch**2,
        distance_src=links.distance_src * pitch,
        distance_dst=links.distance_dst * pitch,
    )


def _shared_faces(
    labels: Int[np.ndarray, "x y z"], count: int
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """All faces between different groups, sorted: their sides, and places along it.

    A side is one number: 6 (src n + dst) + 2 axis + (1 if dst is the upper one).
    """
    sides, planes = [], []
    for axis in range(3):
        line = np.moveaxis(labels, axis, -1)
        below, above = line[..., :-1], line[..., 1:]
        shared = (below != above) & (below >= 0) & (above >= 0)
        place = np.arange(1, line.shape[-1], dtype=np.int32)
        planes.append(np.broadcast_to(place, shared.shape)[shared])
        below, above = below[shared], above[shared]
        side = np.minimum(below, above).astype(np.int64)
        side *= count
        side += np.maximum(below, above)
        side *= 6
        side += 2 * axis + (below < above)
        sides.append(side)
    side = np.concatenate(sides)
    # Nearly sorted where groups are small: a stable sort merges the runs.
    order = np.argsort(side, kind="stable")
    return side[order], np.concatenate(planes)[order]


def _links(
    side: Int[np.ndarray, " k"],
    plane: Int[np.ndarray, " k"],
    centre: Float[np.ndarray, "n 3"],
) -> Links:
    """Links of sorted faces, in voxels."""
    start = _starts(side)
    faces = np.diff(start, append=len(side))
    place = np.add.reduceat(plane, start, dtype=float) / faces
    side = side[start]
    pair, face = np.divmod(side, 6)
    src, dst = np.divmod(pair, len(centre))
    axis, sign = face // 2, face % 2 * 2 - 1
    to_src = np.maximum(sign * (place - centre[src, axis]), LEAST_DISTANCE)
    to_dst = np.maximum(sign * (centre[dst, axis] - place), LEAST_DISTANCE)

    on_axis = _starts(side // 2)
    squares = np.add.reduceat(faces, on_axis) ** 2.0
    area = np.sqrt(np.add.reduceat(squares, _starts(pair[on_axis])))
    start = _starts(pair)
    src, dst = src[start], dst[start]
    to_src = np.add.reduceat(faces * to_src, start) / area
    to_dst = np.add.reduceat(faces * to_dst, start) / area
    normal = to_src + to_dst
    straight = np.linalg.norm(centre[dst] - centre[src], axis=1)
    longer = link_distance(normal, straight) / normal
    return Links(
        src=src.astype(np.int32),
        dst=dst.astype(np.int32),
        area=area,
        distance_src=to_src * longer,
        distance_dst=to_dst * longer,
    )


def _starts(ordered: Int[np.ndarray, " k"]) -> Int[np.ndarray, " u"]:
    """Where each run of equal numbers begins."""
    changes = np.ones(len(ordered), bool)
    changes[1:] = ordered[1:] != ordered[:-1]
    return np.flatnonzero(changes)


def voxel_links(labels: Int[np.ndarray, "x y z"], pitch: float) -> Links:
    """One link per shared face, of area pitch^2, half a pitch on either side.

    Args:
        labels: rank of each labelled voxel in lattice order; -1 for the others.
        pitch: edge of a voxel [m].
    """
    # One voxel more at the upper ends, so that the next along an axis always exists.
    padded = np.pad(labels, (0, 1), constant_values=-1)
    _, y, z = padded.shape
    flat = padded.reshape(-1)
    voxel = np.flatnonzero(flat >= 0)
    # Along z, y and x: for each voxel in rising order.
    after = np.stack([flat[voxel + jump] for jump in (1, z, y * z)], axis=1)
    linked = after >= 0
    own = np.arange(len(voxel), dtype=np.int32)
    dst = after[linked]
    half = np.full(len(dst), pitch / 2)
    return Links(
        src=np.repeat(own, np.count_nonzero(linked, axis=1)),
        dst=dst,
        area=np.full(len(dst), pitch**2),
        distance_src=half,
        distance_dst=half,
    )


LEAST_ACROSS = 0.5
"""Of |d|, the least that is taken for n . d, the rest going to s: where faces are cut
at a slant it would be next to nothing, and the step with it."""

NOTHING = 1e-9
"""Of |d|, what counts as no way along the face."""


class NonOrthogonalLinks(NamedTuple):
    """The links whose ends are apart along their face."""

    link: Int[np.ndarray, " k"]
    """Which of the structure's they are."""
    offset: Float[np.ndarray, "k 3"]
    """s, from `src` to `dst` [m]."""
    stretch: Float[np.ndarray, " e"]
    """Length that the two-point flux of every link has, over n . d."""


def non_orthogonal_links(structure: AbstractStructure) -> NonOrthogonalLinks:
    """Those of one structure."""
    links, place = structure.links(), structure.nodes().place
    normal = face_normals(structure)
    way = place[links.dst] - place[links.src]
    straight = np.linalg.norm(way, axis=1)
    across = np.einsum("ei,ei->e", way, normal)
    across = np.maximum(across, LEAST_ACROSS * straight)
    apart = way - across[:, None] * normal
    some = np.linalg.norm(apart, axis=1) > NOTHING * straight
    link = np.flatnonzero(some & normal.any(axis=1))
    stretch = np.ones(len(way))
    stretch[link] = (link_distance(across, straight) / across)[link]
    return NonOrthogonalLinks(link, apart[link], stretch)


def link_axes(structure: AbstractStructure) -> Float[np.ndarray, "e 3"]:
    """How much of each link crosses along x, y and z: its squared direction, sum 1.

    The direction is the normal of the voxel faces that the two nodes share: along x if
    all of them lie across x, however far the centres are apart sideways. Nodes that
    share no face, as voxels over an edge, have that from centre to centre.
    """
    upward, downward = _face_counts(structure)
    across, links = upward + downward, structure.links()
    centre = structure.nodes().centre
    apart = centre[links.dst] - centre[links.src]
    across = np.where(across.any(axis=1, keepdims=True), across, apart)
    squared = np.square(across)
    return squared / squared.sum(axis=1, keepdims=True)


def face_normals(structure: AbstractStructure) -> Float[np.ndarray, "e 3"]:
    """Unit normal from `src` to `dst` of the voxel faces that each link's nodes share.

    Zero where they share none, or as many looking one way as the other.
    """
    upward, downward = _face_counts(structure)
    normal = upward - downward
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def _face_counts(structure):
    """Voxel faces of every link along x, y, z: with `dst` above, and with it below."""
    links, count = structure.links(), structure.node_count
    pair = lambda one, other: (
        np.minimum(one, other).astype(np.int64) * count + np.maximum(one, other)
    )
    key = pair(links.src, links.dst)
    order = np.argsort(key, kind="stable")
    # One more, so that what is sought beyond the last finds something.
    ranked = np.append(key[order], -1)
    upward, downward = np.zeros((2, len(key), 3))
    for axis, (below, above) in enumerate(_faces_between_nodes(structure)):
        face = pair(below, above)
        place = np.searchsorted(ranked[:-1], face)
        found = ranked[place] == face
        link = order[place[found]]
        rises = links.src[link] == below[found]
        upward[:, axis] = np.bincount(link[rises], minlength=len(key))
        downward[:, axis] = np.bincount(link[~rises], minlength=len(key))
    return upward, downward


def _faces_between_nodes(structure):
    """For each axis the nodes below and above every voxel face between two nodes."""
    solid = structure.grid.solid
    node = np.full(solid.shape, -1, np.int32)
    node[solid] = structure.voxel_node()
    for axis in range(3):
        line = np.moveaxis(node, axis, 0)
        below, above = line[:-1], line[1:]
        shared = (below != above) & (below >= 0) & (above >= 0)
        yield below[shared], above[shared]
