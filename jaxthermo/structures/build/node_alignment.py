"""Nodes of blocks in line with each other, so that links cross faces straight.

The temperature difference of two nodes says what flows between them where the line from
one to the other is along the face's normal. Centres of what is solid in blocks are not
in line along a surface: one lies deeper than the next, and a gradient across the
surface looks like one along it. Middles of blocks are in line, but what a node holds is
not at the middle. Standing between the two costs little of either.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from ..structure import Built
from .block_links import link_distance


def in_line(
    built: Built,
    block: Int[np.ndarray, "n 3"],
    corner: Float[np.ndarray, "3"],
    edge: float,
    alignment: float,
) -> Built:
    """The same structure with its nodes moved, and its links as long as they then are.

    A node without a neighbour along an axis stays where it is on it: a thin sheet has
    nothing to be in line with across.

    Args:
        built: nodes that are parts of cubic blocks.
        block: of each, its place among the blocks.
        corner: of the first block [m].
        edge: of a block [m].
        alignment: how far to move, from the centre (0) to the middle of the block (1).
    """
    links, centre = built.links, built.nodes.centre
    src, dst = links.src, links.dst
    axis = np.argmax(block[src] != block[dst], axis=1)
    linked = np.zeros(block.shape, bool)
    linked[src, axis] = linked[dst, axis] = True
    middle = corner + (block + 0.5) * edge
    place = centre + alignment * np.where(linked, middle - centre, 0)
    row = np.arange(len(src))
    face = corner[axis] + np.maximum(block[src], block[dst])[row, axis] * edge
    to_src, to_dst = (np.abs(face - place[end, axis]) for end in (src, dst))
    normal = to_src + to_dst
    straight = np.linalg.norm(place[dst] - place[src], axis=1)
    longer = link_distance(normal, straight) / normal
    return replace(
        built,
        nodes=built.nodes._replace(place=place),
        links=links._replace(
            distance_src=to_src * longer, distance_dst=to_dst * longer
        ),
    )
