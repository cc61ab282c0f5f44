"""Full volume of one material in runs of voxels, from its grid."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array

from ..arrays import device_array, flat_index
from ..errors import InputError
from ..native.call import require_native
from ..native.runs import Runs
from ..network.run_stencil import RunStencil
from ..network.stencil import solid_degree
from ..structures.kinds.full import FullVolume
from ..voxels.cut_voxels import CutVoxels


WITH_NUMBA = 'FullVolume(kernels="numba")'


def run_stencil(structure: FullVolume, conductivity: Any, heat: Any) -> RunStencil:
    """Network of one material, by its conductivity [W/(m K)] and rho c_p [J/(m^3 K)].

    Raises:
        InputError: without numba, on another device than a CPU, for a conductivity by
            axis, or for weights.
    """
    conductivity = device_array(conductivity)
    if conductivity.ndim:
        raise InputError(
            f"{WITH_NUMBA} has one conductivity for all axes: leave it out"
        )
    if not structure.weights.are_one:
        raise InputError(f"{WITH_NUMBA} has no weights: leave one of them out")
    require_native(WITH_NUMBA)
    grid = structure.grid
    dtype = conductivity.dtype
    runs, row_weight = structure.found(
        ("voxel_runs", dtype.name),
        lambda: jax.tree.map(jnp.asarray, _voxel_runs(grid.solid, grid.cut, dtype)),
    )
    return RunStencil(
        conductance=conductivity * grid.pitch,
        whole_capacity=device_array(heat) * grid.voxel_volume,
        runs=runs,
        row_weight=row_weight,
        node_count=structure.node_count,
    )


class NodeCells(NamedTuple):
    """Cells of a lattice with a rim of one cell, flattened, and the nodes in them."""

    shape: tuple[int, ...]
    """Shape of the lattice with its rim."""
    inside: Bool[np.ndarray, " v"]
    """True for solid cells."""
    position: Int[np.ndarray, " v"]
    """Position of the node of each solid cell in a state."""

    @property
    def steps(self) -> tuple[int, ...]:
        """Differences of the flat index to the next cells along x, y, z."""
        _, y, z = self.shape
        return (y * z, z, 1)

    def at(self, voxel: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, " m"]:
        """Flat indices of voxels."""
        return flat_index(voxel + 1, self.shape)

    def runs(self, regular: Bool[np.ndarray, " v"]) -> Int[np.ndarray, "r 6"]:
        """Runs along z of regular nodes, with six uncut links each, as in `Runs`."""
        edge = np.diff(regular.astype(np.int8), prepend=0, append=0)
        start = np.flatnonzero(edge == 1)
        stop = np.flatnonzero(edge == -1)
        x, y, _ = self.steps
        neighbours = [self.position[start + step] for step in (x, -x, y, -y)]
        columns = [self.position[start], stop - start, *neighbours]
        return np.stack(columns, axis=1).astype(np.int32)

    def links(
        self, cells: Int[np.ndarray, " m"], cut: CutVoxels | None, nodes: int
    ) -> csr_array:
        """Relative conductances from the nodes of some cells to all nodes of a state.

        The cells ascend, and are all those that are cut or have fewer or cut links.
        """
        row = []
        column = []
        weight = []
        for step in (sign * step for step in self.steps for sign in (-1, 1)):
            linked = np.flatnonzero(self.inside[cells + step])
            row.append(linked)
            column.append(self.position[cells[linked] + step])
            weight.append(np.ones(len(linked)))
        if cut is not None:
            src = self.at(cut.links.voxel)
            dst = self.at(cut.links.voxel + cut.links.step)
            for start, end in ((src, dst), (dst, src)):
                row.append(np.searchsorted(cells, start))
                column.append(self.position[end])
                weight.append(cut.links.extra)
        entries = (np.concatenate(row), np.concatenate(column))
        # The link of two neighbours and its correction add up in one entry.
        size = (len(cells), nodes)
        return csr_array(coo_array((np.concatenate(weight), entries), shape=size))

    def volumes(
        self, cells: Int[np.ndarray, " m"], cut: CutVoxels | None
    ) -> Float[np.ndarray, " m"]:
        """Volumes of cells, as in `links` [voxels]."""
        volume = np.ones(len(cells))
        if cut is not None:
            volume[np.searchsorted(cells, self.at(cut.voxel))] = cut.volume
        return volume


def _voxel_runs(
    solid: Bool[np.ndarray, "x y z"], cut: CutVoxels | None, dtype: np.dtype
) -> tuple[Runs, Float[np.ndarray, " m"]]:
    """Runs of the nodes with six uncut links, and rows of all others.

    The second result is the sum of the relative conductances of each row [-].
    """
    inside = np.pad(solid, 1)
    number = np.cumsum(inside, dtype=np.int32) - np.int32(1)
    lattice = NodeCells(shape=inside.shape, inside=inside.reshape(-1), position=number)
    regular = np.pad(solid_degree(solid) == 6, 1).reshape(-1)
    if cut is not None:
        for voxel in (cut.voxel, cut.links.voxel, cut.links.voxel + cut.links.step):
            regular[lattice.at(voxel)] = False
    cells = np.flatnonzero(lattice.inside & ~regular)
    nodes = int(number[-1]) + 1
    runs = lattice.runs(regular)
    links = lattice.links(cells, cut, nodes)
    node = number[cells]
    # Six links of each node, and a list of its further links.
    count = np.diff(links.indptr)
    row = np.repeat(np.arange(len(node)), count)
    rank = np.arange(len(row)) - links.indptr[row]
    neighbour = np.repeat(node[:, None], 6, axis=1)
    weight = np.zeros((len(node), 6))
    in_row = rank < 6
    neighbour[row[in_row], rank[in_row]] = links.indices[in_row]
    weight[row[in_row], rank[in_row]] = links.data[in_row]
    list_row = np.flatnonzero(count > 6)
    layout = Runs(
        block=_blocks(runs[:, 0], rows=node, lists=node[list_row], nodes=nodes),
        runs=runs,
        node=node,
        neighbour=neighbour,
        weight=weight.astype(dtype),
        volume=lattice.volumes(cells, cut).astype(dtype),
        list_row=list_row.astype(np.int32),
        list_first=np.append(0, np.cumsum(count[list_row] - 6)).astype(np.int32),
        list_neighbour=links.indices[~in_row].astype(np.int32),
        list_weight=links.data[~in_row].astype(dtype),
    )
    return layout, links.sum(axis=1).astype(dtype)


# Nodes of a block, so that its neighbouring planes stay in a cache of half a MiB.
_BLOCK = 30_000

# Cost of a row relative to that of a node in a run.
_ROW_WORK = 8


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
        np.concatenate([[0], np.searchsorted(nodes_of, ends), [len(nodes_of)]])
        for nodes_of in (runs, rows, lists)
    ]
    return np.stack(columns, axis=1).astype(np.int32)
