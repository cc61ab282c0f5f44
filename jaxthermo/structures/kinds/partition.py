"""Partition of the voxels by labels of the user."""

from dataclasses import InitVar
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Int

from ...errors import InputError
from ...voxels.grid import VoxelGrid
from ..build.blocks import build_blocks, index_type, number_by_first_voxel
from ..cache import cached
from ..fit_card import as_weights
from ..structure import AbstractBuiltStructure, Built
from ..weights import ConductionWeights


class Partition(AbstractBuiltStructure):
    """Nodes of level 0 that are groups of voxels with equal labels.

    Labels are arbitrary integers over the grid's lattice, `[x y z]`; those of empty
    voxels are ignored, and solid voxels with a negative label are left out. Nodes are
    numbered by their first voxel.

    Raises:
        InputError: if the labels do not fit the grid or leave fragments without a node.
    """

    grid: VoxelGrid = eqx.field(static=True)
    labels: InitVar[Any]
    weights: ConductionWeights = eqx.field(
        kw_only=True, default=ConductionWeights(), converter=as_weights
    )
    built: Built = eqx.field(static=True, init=False)

    def __post_init__(self, labels: Any):
        grid = self.grid
        checked = _checked(grid, labels)
        self.built = cached(
            "partition", grid, {"labels": checked}, lambda: _build(grid, checked)
        )


def _checked(grid: VoxelGrid, labels: Any) -> Int[np.ndarray, "x y z"]:
    """Validate the labels; -1 where the voxel is empty or left out."""
    try:
        given = np.asarray(labels)
    except ValueError:
        raise InputError("Partition(labels=): give an array of integers") from None
    if not np.issubdtype(given.dtype, np.integer):
        raise InputError(
            f"Partition(labels=): {given.dtype} values cannot name nodes: give integers"
        )
    if given.shape != grid.solid.shape:
        raise InputError(
            f"Partition(labels=): shape {given.shape} is not that of the grid's "
            f"lattice: give one label a voxel, {grid.solid.shape}"
        )
    if given.max() > np.iinfo(np.int64).max:
        raise InputError("Partition(labels=): give labels below 2^63")
    checked = np.where(grid.solid & (given >= 0), given.astype(np.int64), -1)
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


def _build(grid: VoxelGrid, labels: Int[np.ndarray, "x y z"]) -> Built:
    flat = labels.reshape(-1)
    covered = np.flatnonzero(flat >= 0)
    found, group = np.unique(flat[covered], return_inverse=True)
    first = np.zeros(len(found), index_type(labels.shape))
    # Written backwards, the first voxel of each label remains.
    first[group[::-1]] = covered[::-1]
    voxel = np.full(flat.shape, -1, first.dtype)
    voxel[covered] = first[group]
    numbers, nodes = number_by_first_voxel(voxel.reshape(labels.shape))
    return build_blocks(grid, numbers, np.zeros(len(nodes), np.int32))
