"""What the voxels under the nodes say: whose they are, and which way links cross them.

A node may stand for many voxels. What is given voxel by voxel, such as a region that
is heated, reaches the nodes by these, so that its total is the same in all structures.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..structure import AbstractStructure
from .voxel_assignment import grow


def voxel_owner(structure: AbstractStructure) -> Int[np.ndarray, " v"]:
    """The node that each solid voxel's heat goes to, in lattice order.

    A voxel in no node, as inside a shell, goes to the node the fewest steps through
    the body away; one that the body joins to no node keeps -1.
    """
    own, solid = structure.voxel_node(), structure.grid.solid
    if (own >= 0).all():
        return own
    owner = np.full(np.add(solid.shape, 2), -1, np.int32)
    padded = np.pad(solid, 1)
    owner[padded] = own
    grow(padded, owner)
    return owner[padded]


def volume_within(
    structure: AbstractStructure, chosen: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " n"]:
    """Volume of the chosen solid voxels that goes to each node [m^3].

    Args:
        structure: of the body.
        chosen: of the solid voxels, in lattice order.
    """
    owner = voxel_owner(structure)[chosen]
    count = np.bincount(owner[owner >= 0], minlength=structure.node_count)
    return count * structure.grid.voxel_volume


LEAST_SHARE = 0.5
"""Of its own volume, that a node keeps however little is nearest to it: an edge with a
tenth would make the whole body ten times as stiff, and its heat spreads at once."""


def nearest_volume(structure: AbstractStructure) -> Float[np.ndarray, " n"]:
    """Volume of all solid voxels that are nearest to each node [m^3]."""
    everything = np.ones(structure.grid.solid_count, bool)
    least = LEAST_SHARE * structure.nodes().volume
    return np.maximum(volume_within(structure, everything), least)


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
    for axis, (below, above) in enumerate(_shared_faces(structure)):
        face = pair(below, above)
        place = np.searchsorted(ranked[:-1], face)
        found = ranked[place] == face
        link = order[place[found]]
        rises = links.src[link] == below[found]
        upward[:, axis] = np.bincount(link[rises], minlength=len(key))
        downward[:, axis] = np.bincount(link[~rises], minlength=len(key))
    return upward, downward


def _shared_faces(structure):
    """For each axis the nodes below and above every voxel face between two nodes."""
    solid = structure.grid.solid
    node = np.full(solid.shape, -1, np.int32)
    node[solid] = structure.voxel_node()
    for axis in range(3):
        line = np.moveaxis(node, axis, 0)
        below, above = line[:-1], line[1:]
        shared = (below != above) & (below >= 0) & (above >= 0)
        yield below[shared], above[shared]
