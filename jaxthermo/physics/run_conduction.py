"""Full volume of one material in runs of voxels, from its grid."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import coo_array, csr_array

from ..errors import InputError
from ..native.call import require_native
from ..native.runs import Runs
from ..network.run_stencil import RunStencil
from ..network.stencil import solid_degree
from ..structures.kinds.full import FullVolume
from ..voxels.cut_voxels import CutVoxels


WITH_NUMBA = 'FullVolume(kernels="numba")'


def run_stencil(structure: FullVolume, conductivity: Array, heat: Array) -> RunStencil:
    """Network of one material, of a conductivity [W/(m K)] and rho c_p [J/(m^3 K)].

    Raises:
        InputError: without numba, on another device than a CPU, for a conductivity by
            axis, or for weights.
    """
    if conductivity.ndim:
        raise InputError(
            f"{WITH_NUMBA} has one conductivity for all axes: leave it out"
        )
    if not structure.weights.are_one:
        raise InputError(f"{WITH_NUMBA} has no weights: leave one of them out")
    require_native(WITH_NUMBA)
    grid, dtype = structure.grid, conductivity.dtype
    runs, row_weight = structure.found(
        ("voxel_runs", dtype.name),
        lambda: jax.tree.map(jnp.asarray, voxel_runs(grid.solid, grid.cut, dtype)),
    )
    return RunStencil(
        conductance=conductivity * grid.pitch,
        whole_capacity=heat * grid.voxel_volume,
        runs=runs,
        row_weight=row_weight,
        node_count=structure.node_count,
    )


class NodeCells(NamedTuple):
    """Cells of a lattice with a rim of one, in one row, and the nodes in them."""

    shape: tuple[int, ...]
    inside: Bool[np.ndarray, " v"]
    position: Int[np.ndarray, " v"]
    """Position of the node of each solid cell in a state."""

    @property
    def steps(self) -> tuple[int, int, int]:
        """From a cell to the next along x, y, z."""
        _, y, z = self.shape
        return y * z, z, 1

    def at(self, voxel: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        """Cells of voxels."""
        return np.asarray(np.ravel_multi_index(tuple(voxel.T + 1), self.shape))

    def runs(self, whole: Bool[np.ndarray, " v"]) -> Int[np.ndarray, "r 6"]:
        """Runs along z of nodes with six whole links each, as in `Runs`."""
        edge = np.diff(whole.astype(np.int8), prepend=0, append=0)
        start, stop = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
        x, y, _ = self.steps
        beside = [self.position[start + step] for step in (x, -x, y, -y)]
        columns = [self.position[start], stop - start, *beside]
        return np.stack(columns, axis=1).astype(np.int32)

    def links(
        self, cells: Int[np.ndarray, " m"], cut: CutVoxels | None, nodes: int
    ) -> csr_array:
        """Relative conductances from the nodes of some cells to those in a state.

        The cells ascend, and are all that are cut or have links that are not whole.
        """
        row, column, weight = [], [], []
        for step in (sign * step for step in self.steps for sign in (-1, 1)):
            linked = np.flatnonzero(self.inside[cells + step])
            row.append(linked)
            column.append(self.position[cells[linked] + step])
            weight.append(np.ones(len(linked)))
        if cut is not None:
            ends = cut.links.voxel, cut.links.voxel + cut.links.step
            one, other = map(self.at, ends)
            for here, there in ((one, other), (other, one)):
                row.append(np.searchsorted(cells, here))
                column.append(self.position[there])
                weight.append(cut.links.extra)
        entries = np.concatenate(row), np.concatenate(column)
        # Both the whole link of two neighbours and what is open of it, in one entry.
        size = len(cells), nodes
        return csr_array(coo_array((np.concatenate(weight), entries), shape=size))

    def volumes(
        self, cells: Int[np.ndarray, " m"], cut: CutVoxels | None
    ) -> Float[np.ndarray, " m"]:
        """Volumes of the same cells [voxels]."""
        found = np.ones(len(cells))
        if cut is not None:
            found[np.searchsorted(cells, self.at(cut.voxel))] = cut.volume
        return found


def voxel_runs(
    solid: Bool[np.ndarray, "x y z"], cut: CutVoxels | None, dtype: np.dtype
) -> tuple[Runs, Float[np.ndarray, " m"]]:
    """Runs of the nodes with six whole links, and rows of all others.

    With the sum of the relative conductances of each row.
    """
    inside = np.pad(solid, 1)
    number = np.cumsum(inside, dtype=np.int32) - np.int32(1)
    every = NodeCells(inside.shape, inside.reshape(-1), number)
    whole = np.pad(solid_degree(solid) == 6, 1).reshape(-1)
    if cut is not None:
        for voxel in (cut.voxel, cut.links.voxel, cut.links.voxel + cut.links.step):
            whole[every.at(voxel)] = False
    cells, nodes = np.flatnonzero(every.inside & ~whole), int(number[-1]) + 1
    runs, links = every.runs(whole), every.links(cells, cut, nodes)
    node = number[cells]
    rows = _rows(node, links)
    found = Runs(
        block=_blocks(runs[:, 0], rows=node, lists=node[rows.list_row], nodes=nodes),
        runs=runs,
        node=node,
        neighbour=rows.neighbour,
        weight=rows.weight.astype(dtype),
        volume=every.volumes(cells, cut).astype(dtype),
        list_row=rows.list_row,
        list_first=rows.list_first,
        list_neighbour=rows.list_neighbour,
        list_weight=rows.list_weight.astype(dtype),
    )
    return found, links.sum(axis=1).astype(dtype)


class _Rows(NamedTuple):
    """Links of the surface as in `Runs`."""

    neighbour: Int[np.ndarray, "m 6"]
    weight: Float[np.ndarray, "m 6"]
    list_row: Int[np.ndarray, " k"]
    list_first: Int[np.ndarray, " k_and_1"]
    list_neighbour: Int[np.ndarray, " l"]
    list_weight: Float[np.ndarray, " l"]


def _rows(node: Int[np.ndarray, " m"], links: csr_array) -> _Rows:
    """Six links of each node, and a list of what it has besides."""
    count = np.diff(links.indptr)
    row = np.repeat(np.arange(len(node)), count)
    rank = np.arange(len(row)) - links.indptr[row]
    neighbour, weight = np.repeat(node[:, None], 6, axis=1), np.zeros((len(node), 6))
    own = rank < 6
    neighbour[row[own], rank[own]] = links.indices[own]
    weight[row[own], rank[own]] = links.data[own]
    more = np.flatnonzero(count > 6)
    return _Rows(
        neighbour=neighbour,
        weight=weight,
        list_row=more.astype(np.int32),
        list_first=np.append(0, np.cumsum(count[more] - 6)).astype(np.int32),
        list_neighbour=links.indices[~own].astype(np.int32),
        list_weight=links.data[~own],
    )


_BLOCK, _ROW_WORK = 30_000, 8
"""Nodes of a block, so that the planes beside it stay in a cache of half a MiB; and the
time that a row takes relative to a node of a run."""


def _blocks(
    runs: Int[np.ndarray, " r"],
    rows: Int[np.ndarray, " m"],
    lists: Int[np.ndarray, " k"],
    nodes: int,
) -> Int[np.ndarray, "b_and_1 3"]:
    """First run, row and list of blocks that take equally long, by their nodes."""
    work = np.ones(nodes, np.int32)
    work[rows] = _ROW_WORK
    total = np.cumsum(work)
    blocks = -(-int(total[-1]) // _BLOCK)
    ends = np.searchsorted(total, np.arange(1, blocks) * (total[-1] / blocks))
    columns = [
        np.concatenate([[0], np.searchsorted(each, ends), [len(each)]])
        for each in (runs, rows, lists)
    ]
    return np.stack(columns, axis=1).astype(np.int32)
