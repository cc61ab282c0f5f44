"""Several materials of one body, by number."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import Module
from jaxtyping import Array, Float, Int

from ..arrays import is_traced
from ..errors import InputError
from ..material.material import Material
from ..structures.partition.assignment import voxel_owner
from ..structures.structure import AbstractStructure, AbstractVoxelStructure
from ..voxels.grid import VoxelGrid
from ..voxels.selection import Region


class AbstractMaterials(Module):
    """Materials of one body, by number."""

    @property
    @abc.abstractmethod
    def materials(self) -> tuple[Material, ...]:
        """The materials, in the order of their numbers."""

    @abc.abstractmethod
    def of_nodes(self, structure: AbstractStructure) -> Int[np.ndarray, " n"]:
        """Material number of each node."""

    @abc.abstractmethod
    def of_fragments(self, grid: VoxelGrid) -> Int[np.ndarray, " s"]:
        """Material number of each surface fragment."""

    def table(self, field: str, dtype: Any) -> Float[Array | np.ndarray, " c"]:
        """One property of every material, by its field in `Material`."""
        values = [getattr(material, field) for material in self.materials]
        if is_traced(values):
            return jnp.stack([jnp.asarray(value, dtype) for value in values])
        return np.asarray([float(value) for value in values], dtype)


class MaterialMap(AbstractMaterials):
    """A base material, with others painted over it in boxes, later ones on top."""

    base: Material
    painted: tuple[tuple[Region, Material], ...] = ()

    @property
    def materials(self) -> tuple[Material, ...]:
        """The base material, then the painted ones."""
        return (self.base, *(material for _, material in self.painted))

    def number(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Material number of points: 0 for the base, i for the i-th painted one."""
        # Later materials are painted over earlier ones.
        number = np.zeros(len(points), np.int32)
        for i, (region, _) in enumerate(self.painted):
            number[region.contains(points)] = i + 1
        return number

    def of_nodes(self, structure: AbstractStructure) -> Int[np.ndarray, " n"]:
        """Material number at each node's centre."""
        assert isinstance(structure, AbstractVoxelStructure)
        number = self.number(structure.nodes().centre)
        sharing = structure.sharing_node()
        return number if sharing is None else number[sharing]

    def of_fragments(self, grid: VoxelGrid) -> Int[np.ndarray, " s"]:
        """Material number at the centre of each fragment's voxel."""
        return self.number(grid.fragment_centre)


class MaterialLabels(AbstractMaterials):
    """A material number for every voxel, in a label volume.

    A node of several voxels has the material of most of them.
    """

    labels: Int[np.ndarray, "x y z"]
    """Material number of every voxel of the lattice; ignored outside the body."""
    given: tuple[Material, ...]
    names: tuple[str, ...] = eqx.field(static=True, default=(), kw_only=True)
    """Name of the part that has each material, for frames; "0", "1" if none."""

    @property
    def materials(self) -> tuple[Material, ...]:
        """The given materials."""
        return self.given

    def of_nodes(self, structure: AbstractStructure) -> Int[np.ndarray, " n"]:
        """Material number of most voxels of each node.

        Raises:
            InputError: unless every voxel has the number of an existing material.
        """
        labels = np.asarray(self.labels)
        solid = structure.voxels.solid
        if not np.issubdtype(labels.dtype, np.integer) or labels.shape != solid.shape:
            raise InputError(
                f"material labels: got {labels.dtype} values of shape {labels.shape}: "
                f"give one integer for each voxel of the grid, {solid.shape}"
            )
        # Labels outside the body are ignored.
        solid_labels = labels[solid].astype(np.int32)
        count = len(self.given)
        if solid_labels.min() < 0 or solid_labels.max() >= count:
            raise InputError(
                f"material labels: {solid_labels.min()} to {solid_labels.max()}, and "
                f"there are {count} materials: number them from 0"
            )
        assert isinstance(structure, AbstractVoxelStructure)
        owner = voxel_owner(structure)
        pair = owner[owner >= 0].astype(np.int64) * count + solid_labels[owner >= 0]
        votes = np.bincount(pair, minlength=structure.node_count * count)
        number = votes.reshape(-1, count).argmax(axis=1).astype(np.int32)
        sharing = structure.sharing_node()
        return number if sharing is None else number[sharing]

    def of_fragments(self, grid: VoxelGrid) -> Int[np.ndarray, " s"]:
        """Material number of each fragment's voxel."""
        return self.labels[tuple(grid.fragment_voxel.T)]
