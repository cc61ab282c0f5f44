"""Structures whose nodes are groups of voxels: layers, blocks, cells, labels."""

from dataclasses import InitVar, replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Int

from ...choices import Hollow
from ...errors import InputError, whole_number
from ...voxels.grid import VoxelGrid
from ..cache import built_once
from ..partition.blocks import (
    block_parts,
    build_blocks,
    index_type,
    number_by_first_voxel,
    voxel_layers,
)
from ..partition.cubes import build_cubes, octree_levels
from ..partition.slabs import Slab, build_slabs
from ..structure import AbstractBuiltStructure, Built


class MultiLevel(AbstractBuiltStructure):
    """The outer `levels` layers of voxels, linked over their faces (thesis 4.3).

    With at least as many levels as the body has layers it is the full volume.
    """

    levels: int = eqx.field(static=True, default=10)
    hollow: Hollow = eqx.field(static=True, default="empty")
    """Capacity of deeper voxels: "empty" drops it, "innermost" distributes it evenly
    over the nodes of the innermost level."""

    def __post_init__(self):
        self.levels = whole_number(self.levels, "MultiLevel(levels=)")
        if self.hollow not in ("empty", "innermost"):
            raise InputError(
                f'MultiLevel(hollow={self.hollow!r}): choose "empty" or "innermost"'
            )
        options = {"levels": self.levels, "hollow": self.hollow}
        self.built = built_once(
            "multilevel", grid=self.grid, options=options, build=_build_layers
        )


def _build_layers(grid: VoxelGrid, levels: int, hollow: str) -> Built:
    layer = voxel_layers(grid, levels)
    index = np.arange(layer.size, dtype=index_type(layer.shape)).reshape(layer.shape)
    labels, first = number_by_first_voxel(np.where(layer >= 0, index, -1))
    built = build_blocks(grid, labels, layer.reshape(-1)[first])
    if hollow == "empty":
        return built
    nodes = built.nodes
    innermost = nodes.level == nodes.level.max()
    deeper = np.where(built.voxel_node < 0, 0, -1)
    missing = float(grid.volume_of(deeper, 1)[0])
    volume = nodes.volume + innermost * (missing / np.count_nonzero(innermost))
    return replace(built, nodes=nodes._replace(volume=volume))


class ShellOverCore(AbstractBuiltStructure):
    """Layers of single voxels (level 0) over blocks of factor^3 voxels (level 1)."""

    layers: int = eqx.field(static=True, default=1)
    factor: int = eqx.field(static=True, default=4)
    """Voxels along an edge of a block of the core."""

    def __post_init__(self):
        self.layers = whole_number(self.layers, "ShellOverCore(layers=)")
        self.factor = whole_number(self.factor, "ShellOverCore(factor=)")
        options = {"layers": self.layers, "factor": self.factor}
        self.built = built_once(
            "shell_over_core",
            grid=self.grid,
            options=options,
            build=_build_shell_over_core,
        )


def _build_shell_over_core(grid: VoxelGrid, layers: int, factor: int) -> Built:
    fine = voxel_layers(grid, layers) >= 0
    factor = min(factor, max(grid.solid.shape))
    surface = len(grid.fragment_area) * layers
    return build_slabs(
        grid,
        factor=factor,
        surface_nodes=surface,
        slab_of=lambda x: _shell_and_core(grid.solid[x], fine[x], factor),
    )


def _shell_and_core(
    solid: Bool[np.ndarray, "x y z"], fine: Bool[np.ndarray, "x y z"], factor: int
) -> Slab:
    voxel = block_parts(solid & ~fine, factor)
    # Single voxels are their own first voxel.
    voxel[fine] = np.flatnonzero(fine)
    labels, first = number_by_first_voxel(voxel)
    return Slab(labels=labels, level=~fine.reshape(-1)[first] * 1)


class Octree(AbstractBuiltStructure):
    """Cells of 1, 2, 4, ... voxels per edge, as large as possible inside the body.

    A cell exists where it and its 26 neighbours of the same size are entirely solid.
    """

    # Hence neighbours, over corners too, differ by at most one level: the neighbours of
    # a cell's children all lie in the cell's neighbours, so they could exist there.

    levels: int | None = eqx.field(static=True, default=None)
    """Number of cell sizes; 1 for single voxels only, None for no limit."""

    def __post_init__(self):
        if self.levels is not None:
            self.levels = whole_number(self.levels, "Octree(levels=)")
        self.built = built_once(
            "octree",
            grid=self.grid,
            options={"levels": self.levels},
            build=_build_octree,
        )


def _build_octree(grid: VoxelGrid, levels: int | None) -> Built:
    return build_cubes(grid, octree_levels(grid.solid, levels))


class Partition(AbstractBuiltStructure):
    """Nodes of level 0 that are groups of voxels with equal labels.

    Labels are arbitrary integers over the grid's lattice, `[x y z]`; those of empty
    voxels are ignored, and solid voxels with a negative label are left out. Nodes are
    numbered by their first voxel.

    Raises:
        InputError: if the labels do not fit the grid or leave fragments without a node.
    """

    labels: InitVar[Any]

    def __post_init__(self, labels: Any):
        checked = _checked_labels(self.grid, labels)
        self.built = built_once(
            "partition",
            grid=self.grid,
            options={"labels": checked},
            build=_build_partition,
        )


def _checked_labels(grid: VoxelGrid, labels: Any) -> Int[np.ndarray, "x y z"]:
    """Validate the labels; -1 where the voxel is empty or left out."""
    try:
        values = np.asarray(labels)
    except ValueError:
        raise InputError("Partition(labels=): give an array of integers") from None
    if not np.issubdtype(values.dtype, np.integer):
        raise InputError(
            f"Partition(labels=): {values.dtype} values cannot name nodes: "
            "give integers"
        )
    if values.shape != grid.solid.shape:
        raise InputError(
            f"Partition(labels=): shape {values.shape} is not that of the grid's "
            f"lattice: give one label a voxel, {grid.solid.shape}"
        )
    if values.max() > np.iinfo(np.int64).max:
        raise InputError("Partition(labels=): give labels below 2^63")
    checked = np.where(grid.solid & (values >= 0), values.astype(np.int64), -1)
    if checked.max() < 0:
        raise InputError("Partition(labels=): no solid voxel has a label of at least 0")
    uncovered = grid.fragment_voxel[checked[tuple(grid.fragment_voxel.T)] < 0]
    if len(uncovered):
        raise InputError(
            "Partition(labels=): labels leave surface voxels without a node, "
            f"{len(np.unique(uncovered, axis=0))} of them, the first at "
            f"{tuple(map(int, uncovered[0]))}: give each a label of at least 0"
        )
    return checked


def _build_partition(grid: VoxelGrid, labels: Int[np.ndarray, "x y z"]) -> Built:
    flat = labels.reshape(-1)
    covered = np.flatnonzero(flat >= 0)
    distinct, group = np.unique(flat[covered], return_inverse=True)
    first = np.zeros(len(distinct), index_type(labels.shape))
    # Written backwards, the first voxel of each label remains.
    first[group[::-1]] = covered[::-1]
    voxel = np.full(flat.shape, -1, first.dtype)
    voxel[covered] = first[group]
    numbers, nodes = number_by_first_voxel(voxel.reshape(labels.shape))
    return build_blocks(grid, numbers, np.zeros(len(nodes), np.int32))
