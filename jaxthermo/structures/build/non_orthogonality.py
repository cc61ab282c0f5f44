"""Links whose ends are apart along the face between them.

Of the vector d from one node to the other the part n . d crosses the face, whose normal
is n; the rest s lies along it. With the gradient g there the difference across is
T_j - T_i - g . s, over the distance n . d: the non-orthogonal correction of finite
volumes, exact for any linear temperature. The two-point flux instead takes T_j - T_i
over a length between n . d and |d| (`link_distance`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..structure import AbstractStructure
from .block_links import link_distance
from .voxel_to_node import face_normals


LEAST_ACROSS = 0.5
"""Of |d|, the least that is taken for n . d, the rest going to s: where faces are cut
at a slant it would be next to nothing, and the step with it."""

NOTHING = 1e-9
"""Of |d|, what counts as no way along the face."""


class Sideways(NamedTuple):
    """The links whose ends are apart along their face."""

    link: Int[np.ndarray, " k"]
    """Which of the structure's they are."""
    apart: Float[np.ndarray, "k 3"]
    """s, from `src` to `dst` [m]."""
    stretch: Float[np.ndarray, " e"]
    """Length that the two-point flux of every link has, over n . d."""


def sideways_links(structure: AbstractStructure) -> Sideways:
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
    return Sideways(link, apart[link], stretch)
