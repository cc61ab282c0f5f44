"""Conduction in runs of voxels, and in rows at the surface.

The state has one value for each node, in lattice order. Deep inside a body a node has
six whole links; along z such nodes follow one another in runs, whose neighbours are
runs as well: five streams of numbers, without an index. All other nodes have rows of
links. Threads share blocks of nodes, each with its runs and rows, whose neighbouring
planes fit into a near cache.
"""

from typing import Any, NamedTuple

from jaxtyping import Array, Float, Int

from .call import called


class Runs(NamedTuple):
    """Links of a body in runs and rows, as indices and geometric weights."""

    block: Int[Any, "b_and_1 3"]
    """First run, row and list of each block; the last row has their totals."""
    runs: Int[Any, "r 6"]
    """First node of each run, number of nodes, and the neighbours of the first along
    +x, -x, +y, -y."""
    node: Int[Any, " m"]
    """Node of each row, increasing."""
    neighbour: Int[Any, "m 6"]
    """Neighbours of the node of each row; the node itself where it has fewer."""
    weight: Float[Any, "m 6"]
    """Conductance of each link over that of a whole one [-]; 0 where there is none."""
    volume: Float[Any, " m"]
    """Volume of the node of each row [voxels]."""
    list_row: Int[Any, " k"]
    """Rows of nodes with more links, increasing."""
    list_first: Int[Any, " k_and_1"]
    """First link of each list, and the number of links in lists."""
    list_neighbour: Int[Any, " l"]
    """Neighbour at the other end of each link in a list."""
    list_weight: Float[Any, " l"]
    """Conductance of each link in a list over that of a whole one [-]."""


def conducted(
    state: Float[Array, " n"],
    keep: Float[Array, ""],
    ratio: Float[Array, ""],
    runs: Runs,
) -> Float[Array, " n"]:
    """Step or rate of each node: keep T_i + ratio / V_i sum_j w_ij (T_j - T_i).

    V_i is the volume in voxels.
    """
    return called("runs_loops.conduct", state, state, keep, ratio, *runs)
