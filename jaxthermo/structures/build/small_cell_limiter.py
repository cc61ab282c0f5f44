"""Slivers held back: small nodes with large faces must not set everyone's step.

The explicit step is limited by the node with the smallest time constant C / sum_j G_j,
which for one material is V / (alpha sum_j A_j / L_j). A few thin parts of blocks have
one far below a whole block's. They follow their neighbours anyway; with longer links
they follow a little later, and the step is longer for all. Capacities and areas stay as
they are, so no heat is lost.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..structure import Built


def hold_back(built: Built, least: float) -> Built:
    """The same structure with the links of slivers lengthened.

    Args:
        built: nodes and links.
        least: time constant that no node is below, times the diffusivity [m^2].
    """
    links, volume = built.links, built.nodes.volume
    conductance = links.area / (links.distance_src + links.distance_dst)
    total = np.bincount(links.src, conductance, len(volume))
    total += np.bincount(links.dst, conductance, len(volume))
    share = _share(volume, total * least)
    stretch = 1 / np.minimum(share[links.src], share[links.dst])
    longer = links._replace(
        distance_src=links.distance_src * stretch,
        distance_dst=links.distance_dst * stretch,
    )
    return replace(built, links=longer)


def _share(
    volume: Float[np.ndarray, " n"], needed: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Of their conductances, what nodes may keep: 1 where they are large enough."""
    return np.minimum(1.0, volume / np.maximum(needed, volume))
