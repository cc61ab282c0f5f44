"""4.3 and 5.2: structures of a sphere, and the ways that heat takes through them."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.sparse import coo_array, diags_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import cg

import jaxthermo as jt
from jaxthermo.report.sheet import Tile, sheet
from jaxthermo.structures.structure import AbstractStructure

from ...harness.link_matrix import laplacian
from ..bodies import SPHERE_RADIUS, sphere_grid
from ..exhibit import Finding, Verdict, exhibit, judged
from ..slices import Slice, level_legend


# Levels of the multi-level structure.
_LEVELS = 4
# Caps that heat enters and leaves by, from this fraction of the radius outwards [-].
_CAP = 0.8
_FULL = "(a) full volume"
_SHELL = "(b) single shell"
_MULTI_LEVEL = "(c) multi-level"
_IRREGULAR = "(d) irregular multi-level"


def _slices(
    structures: Mapping[str, AbstractStructure],
    plane: float,
    note: Callable[[str], str],
    title: str,
    paths: Mapping[str, np.ndarray] | None = None,
) -> Image.Image:
    """Slices of structures side by side, with the paths through them if given."""
    tiles = []
    level_count = 0
    for name, structure in structures.items():
        slice_ = Slice(structure, axis=1, plane=plane)
        if paths:
            slice_.draw_path(paths[name])
        level_count = max(level_count, slice_.levels)
        tiles.append(Tile(slice_.pixels, name, note(name)))
    legend = level_legend(level_count, has_path=paths is not None)
    return sheet(tiles, legend, title, columns=len(tiles))


@exhibit("figure-4.8", "4.3, figure 4.8")
def _slices_of_a_sphere(_: bool) -> Finding:
    """Build the three structures of a sphere."""
    across = 40
    grid = sphere_grid(across)
    irregular = jt.IrregularMultiLevel(grid)
    structures = {
        "single shell": jt.SingleShell(grid),
        "multi-level": jt.MultiLevel(grid, levels=_LEVELS),
        "irregular multi-level": irregular,
    }
    nodes = {name: built.node_count for name, built in structures.items()}
    picture = _slices(
        structures,
        plane=across / 2 - 0.5,
        note=lambda name: (
            f"{nodes[name]:,} nodes, {nodes[name] / grid.solid_count:.0%} of the voxels"
        ),
        title="Slices of a sphere",
    )
    cover = irregular.coverage()
    return Finding(
        Verdict.DIFFERENT,
        {
            "capacity_ratio": irregular.capacity_ratio,
            "overlap": cover.overlap,
            "crack": cover.crack,
            "outside": cover.outside,
            "nodes": nodes,
            "nodes_over_voxels": {
                name: count / grid.solid_count for name, count in nodes.items()
            },
            "voxels": grid.solid_count,
        },
        {"figure-4.8": picture},
        {"C15": Verdict.REPRODUCED},
    )


@exhibit("figure-5.1", "5.2, figure 5.1")
def _shortest_paths(_: bool) -> Finding:
    """Measure the shortest way of heat from one side of a sphere to the other."""
    across = 41
    grid = sphere_grid(across)
    structures = {
        _FULL: jt.FullVolume(grid),
        _SHELL: jt.SingleShell(grid),
        _MULTI_LEVEL: jt.MultiLevel(grid, levels=_LEVELS),
        _IRREGULAR: jt.IrregularMultiLevel(grid),
    }
    paths = {name: _shortest_path(built) for name, built in structures.items()}
    straight = paths[_FULL].length
    length_ratio = {name: path.length / straight for name, path in paths.items()}
    conductance = {name: _conductance(built) for name, built in structures.items()}
    shell = length_ratio[_SHELL]
    levels = length_ratio[_MULTI_LEVEL]
    is_ordered = (
        shell > 1.2 and length_ratio[_IRREGULAR] < 1.1 and levels <= shell * 1.05
    )
    is_shorter = levels < 0.95 * shell
    picture = _slices(
        structures,
        plane=across / 2,
        note=lambda name: f"{length_ratio[name]:.2f} of the full volume",
        title="Shortest paths over the links from right to left",
        paths={name: path.points for name, path in paths.items()},
    )
    return Finding(
        judged(is_ordered and is_shorter, different=True),
        {
            "length_over_full_volume": length_ratio,
            "resistance_over_full_volume": {
                name: conductance[_FULL] / value for name, value in conductance.items()
            },
            "half_circle": np.pi / 2,
            "levels_shorten_it": is_shorter,
        },
        {"figure-5.1": picture},
    )


class _Path(NamedTuple):
    """The shortest way over links from the rightmost to the leftmost node."""

    length: float
    """Sum of the lengths of the links [m]."""
    points: Float[np.ndarray, "n 3"]
    """Nodes on the way [m]."""


def _shortest_path(structure: AbstractStructure) -> _Path:
    nodes = structure.nodes()
    links = structure.links()
    count = len(nodes.volume)
    ends = (links.src, links.dst)
    graph = coo_array((links.length, ends), (count, count)).tocsr()
    surface = np.flatnonzero(nodes.level == 0)
    middle = nodes.centre.mean(axis=0)
    # The surface node that is farthest along +x or -x, on the axis of the sphere.
    off_middle = nodes.centre[surface] - middle
    off_axis = np.abs(off_middle[:, 1:]).sum(axis=1)
    along = off_middle[:, 0]
    right = surface[np.argmax(along - 1e-3 * off_axis)]
    left = surface[np.argmax(-along - 1e-3 * off_axis)]
    distance, predecessor = dijkstra(
        graph, directed=False, indices=right, return_predecessors=True
    )
    path = [left]
    while path[-1] != right:
        path.append(predecessor[path[-1]])
    return _Path(length=float(distance[left]), points=nodes.centre[path])


def _conductance(structure: AbstractStructure) -> float:
    """Heat between the two caps at 1 K over the conductivity, in steady state [m]."""
    nodes = structure.nodes()
    links = structure.links()
    count = len(nodes.volume)
    laplace = laplacian(links, links.area / links.length, count)
    along = structure.grid.fragment_position[:, 0] / SPHERE_RADIUS
    temperature = np.zeros(count)
    is_cap = np.zeros(count, bool)
    for in_cap, value in ((along > _CAP, 1.0), (along < -_CAP, 0.0)):
        cap_nodes = structure.fragment_node()[in_cap]
        temperature[cap_nodes] = value
        is_cap[cap_nodes] = True
    # Nodes without a link, cut off in a corner of the lattice, take no part.
    solved = np.flatnonzero(~is_cap & (laplace.diagonal() > 0))
    load = -(laplace @ temperature)[solved]
    inner = laplace[solved][:, solved]
    preconditioner = diags_array(1 / inner.diagonal())
    temperature[solved], failed = cg(inner, load, rtol=1e-8, M=preconditioner)
    if failed:
        raise ArithmeticError(f"no convergence after {failed} iterations")
    return float((laplace @ temperature)[is_cap & (temperature == 1.0)].sum())
