"""Conduction along parts of up to two voxels, compared with that of the true body.

Turned against the lattice, such a part is a staircase of voxels, which conducts less
along itself than the part, and nothing where its steps touch over edges alone. In cubes
of the lattice with thin parts a steady field is solved that is linear in the true body,

    sum_j G_ij (T_i - T_j) = k sum_f A_f n_f . u  in free voxels,    T = u . x  else,

for two directions u along the part, with the fragments f of each voxel. Voxels with a
link out of the cube are not free. The mean flux relative to the true one, k V, is

    [sum_links G (T_i - T_j) (x_i - x_j) . u + k sum_f A_f n_f . u (x_f - x_i) . u]
    / (k V),

and 1 where the voxels conduct as the part does. The lowest value over all directions
along a sheet counts, for a rod the one along its axis.
"""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from ..arrays import flat_index
from ..geometry.vectors import row_dot
from .cut_links import CutLinks
from .lattice import Lattice
from .represented import MAX_DIFFERENCE


# Cells along an edge of a cube.
_CUBE = 32

# Smallest part of a body's volume in thin parts that matters.
_MIN_VOLUME = 0.02

# Smallest part of the voxels of a cube that are thin, for it to be solved.
_MIN_THIN = 0.2

# Most voxels of cubes that are solved; beyond them, cubes are sampled evenly.
_MAX_VOXELS = 50_000

# Fraction of the squared normals along one axis from which a part is a sheet.
_SHEET = 0.8

# Least volume of a cube, over the largest, for its value to be the lowest.
_MIN_SHARE = 0.1

# Conductance over k h that holds isolated voxels.
_LEAK = 1e-6


class ThinConduction(NamedTuple):
    """Conduction along the thin parts of a body."""

    mean: float
    """Conduction along them over the true one, mean by volume [-]."""
    lowest: float
    """Lowest value in a cube of the lattice [-]."""
    position: Float[np.ndarray, "3"]
    """Middle of the voxels of that cube, in the body's frame [m]."""

    @property
    def is_off(self) -> bool:
        """True if it is off by more than 2 %."""
        return abs(self.mean - 1) > MAX_DIFFERENCE

    def described(self) -> str:
        """One line, in percent of the true conduction."""
        position = ", ".join(f"{x:.3g}" for x in self.position)
        return (
            f"conducts {100 * self.mean:.3g} % of what it should along its parts of up "
            f"to two voxels, {100 * self.lowest:.3g} % near ({position}) m, where they "
            "are turned against the lattice: use a finer pitch, or turn the mesh along "
            "the axes and the body by its pose"
        )


class ThinBody(NamedTuple):
    """Voxels and surface of a body."""

    lattice: Lattice
    solid: Bool[np.ndarray, "x y z"]
    links: CutLinks
    """Links that are not those of whole voxels."""
    volume: Float[np.ndarray, " v"]
    """Volumes of the solid voxels, in lattice order [voxels]."""
    fragment_voxel: Int[np.ndarray, "s 3"]
    fragment_foot: Float[np.ndarray, "s 3"]
    """[m]"""
    fragment_normal: Float[np.ndarray, "s 3"]
    fragment_area: Float[np.ndarray, " s"]
    """[m^2]"""


class _Nodes(NamedTuple):
    """Solid voxels of cubes with thin parts."""

    flat: Int[np.ndarray, " n"]
    """Index of each in the lattice, ascending."""
    cell: Int[np.ndarray, "n 3"]
    cube: Int[np.ndarray, " n"]
    """Number of its cube; of voxels around the cubes, the number of cubes."""
    count: int
    """Number of cubes."""
    is_open: Bool[np.ndarray, " n"]
    """True for voxels with a link out of their cube."""

    def at(self, flat: Int[np.ndarray, " m"]) -> Int[np.ndarray, " m"]:
        """Numbers of voxels of the lattice; -1 for those that are no nodes."""
        number = np.searchsorted(self.flat, flat).clip(max=len(self.flat) - 1)
        return np.where(self.flat[number] == flat, number, -1)


class _Links(NamedTuple):
    """Links by the numbers of the nodes."""

    first: Int[np.ndarray, " l"]
    second: Int[np.ndarray, " l"]
    conductance: Float[np.ndarray, " l"]
    """Over k h [-]."""


def thin_voxels(solid: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Voxels that no voxel with six solid neighbours touches."""
    inside = np.pad(solid, 1)
    interior = inside[1:-1, 1:-1, 1:-1].copy()
    for axis in range(3):
        for step in (-1, 1):
            interior &= np.roll(inside, step, axis)[1:-1, 1:-1, 1:-1]
    near = np.pad(interior, 1)
    for axis in range(3):
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
    return solid & ~near[1:-1, 1:-1, 1:-1]


def thin_conduction(body: ThinBody) -> ThinConduction | None:
    """Conduction along the thin parts of a body; None if it has hardly any."""
    thin = thin_voxels(body.solid)
    total = body.volume.sum()
    if body.volume[thin[body.solid]].sum() < _MIN_VOLUME * total:
        return None
    nodes = _nodes(thin, body.solid)
    if not nodes.count:
        return None
    voxel_volume = body.volume[np.searchsorted(np.flatnonzero(body.solid), nodes.flat)]
    volume = np.bincount(nodes.cube, voxel_volume, nodes.count + 1)[:-1]
    relative = np.maximum(_relative_flux(body, nodes, volume), 0)
    significant = np.flatnonzero(volume >= _MIN_SHARE * volume.max())
    worst = int(significant[relative[significant].argmin()])
    return ThinConduction(
        mean=float(np.average(relative, weights=volume)),
        lowest=float(relative[worst]),
        position=body.lattice.centres(nodes.cell[nodes.cube == worst]).mean(0),
    )


def _nodes(thin: Bool[np.ndarray, "x y z"], solid: Bool[np.ndarray, "x y z"]) -> _Nodes:
    """Voxels of the cubes with thin parts, or of some of many cubes."""
    cell = np.argwhere(solid)
    key = flat_index(cell // _CUBE, solid.shape)
    _, cube = np.unique(key, return_inverse=True)
    thin_count = np.bincount(cube, thin[solid])
    with_thin_parts = np.flatnonzero(thin_count >= _MIN_THIN * np.bincount(cube))
    voxels = int(np.isin(cube, with_thin_parts).sum())
    chosen = with_thin_parts[:: max(1, -(-voxels // _MAX_VOXELS))]
    number = np.full(int(cube.max()) + 1, -1)
    number[chosen] = np.arange(len(chosen))
    solved = np.flatnonzero(number[cube] >= 0)
    around, is_open = _around(cell[solved], solid)
    flat = np.concatenate([np.flatnonzero(solid)[solved], around])
    # Voxels beyond a cube may be in another one, and then come twice.
    flat, first = np.unique(flat, return_index=True)
    cubes = np.append(number[cube[solved]], np.full(len(around), len(chosen)))
    opens = np.append(is_open, np.ones(len(around), bool))
    return _Nodes(
        flat=flat,
        cell=np.stack(np.unravel_index(flat, solid.shape), axis=1),
        cube=cubes[first],
        count=len(chosen),
        is_open=opens[first],
    )


def _around(
    cell: Int[np.ndarray, "n 3"], solid: Bool[np.ndarray, "x y z"]
) -> tuple[Int[np.ndarray, " m"], Bool[np.ndarray, " n"]]:
    """Solid voxels beyond the sides of the voxels' cubes, and where there are any."""
    is_open = np.zeros(len(cell), bool)
    padded = np.pad(solid, 1)
    around = []
    for offset in np.indices((3, 3, 3)).reshape(3, -1).T - 1:
        # Links pass faces and edges.
        if 1 <= np.abs(offset).sum() <= 2:
            beyond = cell + offset
            leaves = (beyond // _CUBE != cell // _CUBE).any(1)
            leaves &= padded[tuple((beyond + 1).T)]
            is_open |= leaves
            around.append(flat_index(beyond[leaves], solid.shape))
    return np.unique(np.concatenate(around)), is_open


def _links(body: ThinBody, nodes: _Nodes) -> _Links:
    """Links over faces and edges between all nodes."""
    shape = body.solid.shape
    firsts = []
    seconds = []
    conductances = []
    for axis in range(3):
        is_inside = nodes.cell[:, axis] + 1 < shape[axis]
        jump = int(np.prod(shape[axis + 1 :]))
        second = np.where(is_inside, nodes.at(nodes.flat + jump), -1)
        first = np.flatnonzero(second >= 0)
        firsts.append(first)
        seconds.append(second[first])
        conductances.append(body.links.open_across(nodes.flat, shape, axis)[first])
    edges = body.links.selected(body.links.over_edge)
    first = nodes.at(flat_index(edges.voxel, shape))
    second = nodes.at(flat_index(edges.voxel + edges.step, shape))
    known = (first >= 0) & (second >= 0)
    first = np.concatenate([*firsts, first[known]])
    second = np.concatenate([*seconds, second[known]])
    conductance = np.concatenate([*conductances, edges.extra[known]])
    return _Links(first, second, conductance)


class _Surface(NamedTuple):
    """Fragments of the solved voxels, in cells."""

    node: Int[np.ndarray, " f"]
    cube: Int[np.ndarray, " f"]
    foot: Float[np.ndarray, "f 3"]
    area_vector: Float[np.ndarray, "f 3"]


def _surface(body: ThinBody, nodes: _Nodes) -> _Surface:
    node = nodes.at(flat_index(body.fragment_voxel, body.solid.shape))
    solved = np.flatnonzero(node >= 0)
    solved = solved[nodes.cube[node[solved]] < nodes.count]
    area = body.fragment_area[solved] / body.lattice.pitch**2
    return _Surface(
        node=node[solved],
        cube=nodes.cube[node[solved]],
        foot=body.lattice.to_cells(body.fragment_foot[solved]) - 0.5,
        area_vector=area[:, None] * body.fragment_normal[solved],
    )


def _relative_flux(
    body: ThinBody, nodes: _Nodes, volume: Float[np.ndarray, " c"]
) -> Float[np.ndarray, " c"]:
    """Mean flux along the parts of each cube over the true one, in the worst direction.

    The volumes of the cubes are in voxels.
    """
    surface = _surface(body, nodes)
    links = _links(body, nodes)
    size = np.maximum(np.linalg.norm(surface.area_vector, axis=1), 1e-12)
    squares = surface.area_vector[:, :, None] * surface.area_vector[:, None, :]
    moments = np.zeros((nodes.count, 3, 3))
    np.add.at(moments, surface.cube, squares / size[:, None, None])
    values, axes = np.linalg.eigh(moments)
    is_sheet = values[:, 2] > _SHEET * values.sum(axis=1)
    # The voxels around the cubes have no direction.
    directions = [np.append(axes[:, :, k], np.zeros((1, 3)), axis=0) for k in (0, 1)]
    fields = _fields(nodes, links=links, surface=surface, directions=directions)
    step = (nodes.cell[links.first] - nodes.cell[links.second]).astype(float)
    is_inner = nodes.cube[links.first] == nodes.cube[links.second]
    beyond = surface.foot - nodes.cell[surface.node]
    flux = np.zeros((nodes.count, 2, 2))
    for i, field in enumerate(fields):
        drop = field[links.first] - field[links.second]
        entering = row_dot(surface.area_vector, directions[i][surface.cube])
        for j, direction in enumerate(directions):
            # Each end has half a link; between cubes the field is linear in each.
            for end in (links.first, links.second):
                cube = nodes.cube[end]
                difference = np.where(
                    is_inner, drop, row_dot(step, directions[i][cube])
                )
                moved = links.conductance * difference * row_dot(step, direction[cube])
                flux[:, i, j] += np.bincount(cube, moved / 2, nodes.count + 1)[:-1]
            at_surface = entering * row_dot(beyond, direction[surface.cube])
            flux[:, i, j] += np.bincount(surface.cube, at_surface, nodes.count)
    relative = flux / np.maximum(volume, 1e-12)[:, None, None]
    symmetric = (relative + np.swapaxes(relative, 1, 2)) / 2
    lowest = np.linalg.eigvalsh(symmetric)[:, 0]
    return np.where(is_sheet, lowest, relative[:, 0, 0])


def _fields(
    nodes: _Nodes,
    links: _Links,
    surface: _Surface,
    directions: list[Float[np.ndarray, "d 3"]],
) -> list[Float[np.ndarray, " n"]]:
    """Steady fields of all nodes for each of the directions of their cubes."""
    count = len(nodes.flat)
    free = np.flatnonzero(~nodes.is_open)
    is_inner = nodes.cube[links.first] == nodes.cube[links.second]
    first = links.first
    second = links.second
    conductance = links.conductance * is_inner
    matrix = scipy.sparse.coo_matrix(
        (
            np.concatenate([conductance, conductance, -conductance, -conductance]),
            (
                np.concatenate([first, second, first, second]),
                np.concatenate([first, second, second, first]),
            ),
        ),
        (count, count),
    ).tocsr()
    held = matrix[free][:, free] + _LEAK * scipy.sparse.eye(len(free))
    factors = scipy.sparse.linalg.splu(held.tocsc()) if len(free) else None
    fields = []
    for direction in directions:
        linear = row_dot(nodes.cell.astype(float), direction[nodes.cube])
        entering = row_dot(surface.area_vector, direction[surface.cube])
        supplied = np.bincount(surface.node, entering, count)
        field = np.where(nodes.is_open, linear, 0.0)
        if factors is not None:
            load = supplied[free] - (matrix @ field)[free] + _LEAK * linear[free]
            field[free] = factors.solve(load)
        fields.append(field)
    return fields
