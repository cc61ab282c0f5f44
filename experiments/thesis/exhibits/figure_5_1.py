"""Figure 5.1: the shortest path of heat from one side to the other, measured."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import cg

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.structures.structure import AbstractStructure

from ..exhibit import Exhibit, Finding, Picture, Row, Verdict
from ..slices import Slice, level_legend


# Of the sphere [m]; voxels across it; levels of the multi-level one.
_RADIUS, _ACROSS, _LEVELS = 0.25, 41, 4
# Caps that heat enters and leaves by, from this part of the radius outwards [-].
_CAP = 0.8


class _Path(NamedTuple):
    """The shortest way over links from the rightmost to the leftmost node."""

    length: float
    """Sum of the links' lengths [m]."""
    points: np.ndarray
    """Nodes on the way [m]."""


def _shortest(structure: AbstractStructure) -> _Path:
    nodes, links = structure.nodes(), structure.links()
    count = len(nodes.volume)
    length = links.distance_src + links.distance_dst
    graph = coo_array((length, (links.src, links.dst)), (count, count)).tocsr()
    surface = np.flatnonzero(nodes.level == 0)
    middle = nodes.centre.mean(axis=0)
    # The surface node that is farthest along +x or -x, on the axis of the sphere.
    away = np.abs(nodes.centre[surface, 1:] - middle[1:]).sum(axis=1)
    score = nodes.centre[surface, 0] - middle[0]
    right = surface[np.argmax(score - 1e-3 * away)]
    left = surface[np.argmax(-score - 1e-3 * away)]
    found = dijkstra(graph, directed=False, indices=right, return_predecessors=True)
    distance, before = found[0], found[1]
    way = [left]
    while way[-1] != right:
        way.append(before[way[-1]])
    return _Path(float(distance[left]), nodes.centre[way])


def _conductance(structure: AbstractStructure) -> float:
    """Heat between the two caps at 1 K over the conductivity, in steady state [m]."""
    nodes, links = structure.nodes(), structure.links()
    count = len(nodes.volume)
    one_way = links.area / (links.distance_src + links.distance_dst)
    ends = (
        np.concatenate([links.src, links.dst]),
        np.concatenate([links.dst, links.src]),
    )
    conducts = coo_array((np.tile(one_way, 2), ends), (count, count)).tocsr()
    laplace = (diags_array(conducts.sum(axis=1)) - conducts).tocsr()
    along = structure.grid.fragment_position[:, 0] / _RADIUS
    temperature = np.zeros(count)
    is_cap = np.zeros(count, bool)
    for cap, value in ((along > _CAP, 1.0), (along < -_CAP, 0.0)):
        node = structure.fragment_node()[cap]
        temperature[node], is_cap[node] = value, True
    # Nodes without a link, cut off in a corner of the lattice, take no part.
    solved = np.flatnonzero(~is_cap & (laplace.diagonal() > 0))
    load = -(laplace @ temperature)[solved]
    inner = laplace[solved][:, solved]
    scale = diags_array(1 / inner.diagonal())
    temperature[solved], failed = cg(inner, load, rtol=1e-8, M=scale)
    if failed:
        raise ArithmeticError(f"no convergence after {failed} iterations")
    return float((laplace @ temperature)[is_cap & (temperature == 1.0)].sum())


def _measure(_: bool) -> Finding:
    grid = jt.voxelize(
        sphere(_RADIUS, subdivisions=5), 2 * _RADIUS / _ACROSS, "dominant_axis"
    )
    built = {
        "(a) full volume": jt.FullVolume(grid),
        "(b) single shell": jt.SingleShell(grid),
        "(c) multi-level": jt.MultiLevel(grid, levels=_LEVELS),
        "(d) irregular multi-level": jt.IrregularMultiLevel(grid),
    }
    paths = {name: _shortest(structure) for name, structure in built.items()}
    straight = paths["(a) full volume"].length
    ratio = {name: path.length / straight for name, path in paths.items()}
    conducts = {name: _conductance(structure) for name, structure in built.items()}
    whole = conducts["(a) full volume"]
    resists = {name: whole / each for name, each in conducts.items()}
    tiles, most = [], 0
    for name, structure in built.items():
        shown = Slice(structure, 1, _ACROSS / 2)
        shown.path(paths[name].points)
        most = max(most, shown.levels)
        tiles.append(Tile(shown.pixels, name, f"{ratio[name]:.2f} of the full volume"))
    title = "Shortest paths over the links from right to left"
    picture = sheet(tiles, level_legend(most, path=True), title, columns=4)
    shell, levels, nested = (ratio[name] for name in list(ratio)[1:])
    ordered = shell > 1.2 and nested < 1.1 and levels <= shell * 1.05
    reason = (
        f"Over the shell the path is {shell:.2f} times as long, an exact half circle "
        f"{np.pi / 2:.2f} times; through {_LEVELS} levels {levels:.2f} and through "
        f"irregular ones {nested:.2f} times. "
        + (
            "A few levels do not shorten it: within them heat goes over faces alone, "
            "not over edges as in the shell, and the way round a hole stays one."
            if levels > 0.95 * shell
            else "A few levels shorten it, yet it still goes round the hole."
        )
    )
    reason += (
        " The resistance between two caps is what heat feels: "
        + ", ".join(f"{resists[name]:.2f} times in {name[4:]}" for name in resists)
        + "."
    )
    words = dict(zip(ratio, ("1", "longer", "near (a)", "near (a)"), strict=True))
    rows = (
        *(
            Row(f"length of the path over the full volume's, {name}", words[name], each)
            for name, each in ratio.items()
        ),
        *(
            Row(f"resistance between two caps over the full volume's, {name}", None, r)
            for name, r in resists.items()
        ),
    )
    chosen = (
        ("body", f"a sphere {_ACROSS} voxels across, cut through its middle"),
        ("levels", f"{_LEVELS} of single voxels; as many irregular ones as fit"),
    )
    caption = (
        "As in the figure: (a) full volume, (b) single shell, (c) multi-level, (d) "
        "irregular multi-level; red, the shortest path from right to left."
    )
    return Finding(
        Verdict.REPRODUCED if ordered and levels < 0.95 * shell else Verdict.DIFFERENT,
        reason,
        rows,
        chosen=chosen,
        parts=(Picture("figure-5.1", picture, caption),),
        numbers={
            "length_over_full_volume": ratio,
            "resistance_over_full_volume": resists,
            "half_circle": float(np.pi / 2),
        },
    )


EXHIBIT = Exhibit(
    name="figure-5.1",
    title="shortest paths of heat in four structures",
    place="5.2, figure 5.1",
    claims=("C12",),
    measure=_measure,
)
