"""From a validated config to structures, their weights and surface maps."""

from collections.abc import Mapping
from typing import Any, assert_never

from ..errors import InputError
from ..structures.kinds.aggregate import Aggregate
from ..structures.kinds.full import FullVolume
from ..structures.kinds.irregular import IrregularMultiLevel
from ..structures.kinds.multilevel import MultiLevel
from ..structures.kinds.octree import Octree
from ..structures.kinds.partition import Partition
from ..structures.kinds.shell import SingleShell
from ..structures.kinds.shell_over_core import ShellOverCore
from ..structures.structure import AbstractStructure
from ..structures.surface.surface_map import (
    AbstractSurfaceMap,
    ConstantMap,
    FluxCorrectedMap,
    LinearMap,
)
from ..structures.weights import ConductionWeights
from ..voxels.grid import VoxelGrid
from . import schema_structure as schema
from .array_files import read_labels
from .card_file import load_card


def build_structure(
    config: schema.StructureConfig, grid: VoxelGrid
) -> AbstractStructure:
    """The nodes and links that stand for a body.

    Raises:
        InputError: if the labels of a partition, or a fit card, are not to be used.
    """
    weights = build_weights(config)
    match config:
        case schema.FullVolume():
            return FullVolume(grid, weights=weights)
        case schema.SingleShell(capacity=capacity):
            return SingleShell(grid, capacity=capacity, weights=weights)
        case schema.MultiLevel(levels=levels, hollow=hollow):
            return MultiLevel(grid, levels=levels, hollow=hollow, weights=weights)
        case schema.IrregularMultiLevel(levels=levels, keep_capacity=keep):
            return IrregularMultiLevel(
                grid, levels=levels, keep_capacity=keep, weights=weights
            )
        case schema.Octree(levels=levels):
            return Octree(grid, levels=levels, weights=weights)
        case schema.Aggregate():
            return Aggregate(
                grid,
                factor=config.factor,
                min_time_constant=config.min_time_constant,
                alignment=config.alignment,
                weights=weights,
            )
        case schema.ShellOverCore(layers=layers, factor=factor):
            return ShellOverCore(grid, layers=layers, factor=factor, weights=weights)
        case schema.Partition(labels=labels):
            return Partition(grid, read_labels(labels), weights=weights)
        case _:
            assert_never(config)


def build_weights(config: schema.StructureConfig) -> ConductionWeights:
    """The weights as given, or those of a fit card.

    Raises:
        InputError: for a card of another kind of structure.
    """
    given = config.weights
    if given.card is None:
        return ConductionWeights(**given.model_dump(exclude={"card"}))
    card = load_card(given.card)
    own = structure_options(config)
    if dict(card.structure) != own:
        raise InputError(
            f"weights: {given.card.name} is of {_listed(card.structure)}, and the "
            f"structure is {_listed(own)}: fit one for it, or use the card's structure"
        )
    return card.weights


def structure_options(config: schema.StructureConfig) -> dict[str, Any]:
    """The kind and options of a structure as plain values, without its weights."""
    return config.model_dump(mode="json", exclude={"weights"}, exclude_none=True)


def _listed(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in options.items())


def build_surface_map(config: schema.SurfaceMapConfig) -> AbstractSurfaceMap:
    """How the surface's temperature is read from the nodes."""
    match config:
        case schema.ConstantMap():
            return ConstantMap()
        case schema.LinearMap(at=at):
            return LinearMap(at=at)
        case schema.FluxCorrectedMap(at=at):
            return FluxCorrectedMap(at=at)
        case _:
            assert_never(config)
