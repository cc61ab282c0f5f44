"""Report of a structure as plain types, with units in the keys."""

from dataclasses import fields
from math import prod
from typing import Any, NotRequired

import numpy as np
from typing_extensions import TypedDict

from .kinds.sheet import Sheet
from .kinds.shell import IrregularMultiLevel
from .kinds.skin import Skin
from .sheet_report import SheetReport, sheet_report
from .structure import AbstractStructure


class _ArrayBytes(TypedDict):
    """Size of the arrays that a solver reads, in float32 and int32 [bytes]."""

    state: int
    capacity: int
    links: int
    fragments: int
    total: int


class _Level(TypedDict):
    """The nodes of one level."""

    level: int
    nodes: int
    volume_m3: float


class StructureReport(TypedDict):
    """Counts, memory and capacity of a structure."""

    kind: str
    options: dict[str, Any]
    pitch_m: float
    solid_voxels: NotRequired[int]
    """Voxels of a solid."""
    surface_cells: NotRequired[int]
    """Cells of the surface of a sheet."""
    nodes: int
    links: int
    fragments: int
    bytes_float32: _ArrayBytes
    capacity_ratio: float
    """Heat capacity of the nodes over that of the body [-]."""
    levels: list[_Level]
    build_time_s: float | None
    sheet: NotRequired[SheetReport]
    """Cells through the thickness, and what welding did; for a sheet."""
    share_of_body_volume: NotRequired[dict[str, float]]
    """Overlap and cracks of cells on several lattices."""


def structure_report(
    structure: AbstractStructure, build_time: float | None = None
) -> StructureReport:
    """Counts, memory and capacity of every level; with the time to build it [s]."""
    nodes = structure.nodes()
    counts = np.bincount(nodes.level)
    volumes = np.bincount(nodes.level, nodes.volume)
    report = StructureReport(
        kind=type(structure).__name__,
        options=_options(structure),
        pitch_m=float(structure.grid.pitch),
        nodes=structure.node_count,
        links=structure.link_count,
        fragments=len(structure.grid.fragment_area),
        bytes_float32=_bytes(structure),
        capacity_ratio=structure.capacity_ratio,
        levels=[
            _Level(level=level, nodes=int(count), volume_m3=float(volume))
            for level, (count, volume) in enumerate(zip(counts, volumes, strict=True))
        ],
        build_time_s=build_time,
    )
    if isinstance(structure, Sheet):
        report["surface_cells"] = structure.surface_cells
        report["sheet"] = sheet_report(structure)
    else:
        report["solid_voxels"] = structure.voxels.solid_count
    if isinstance(structure, IrregularMultiLevel):
        report["share_of_body_volume"] = structure.coverage()._asdict()
    return report


def _options(structure: AbstractStructure) -> dict[str, object]:
    if isinstance(structure, Sheet):
        thickness = [
            [float(layer.thickness) for layer in stack] for stack in structure.stacks
        ]
        return {"cells": structure.cells_through, "thickness_m": thickness}
    if isinstance(structure, Skin):
        divided = structure.structure
        kind = type(divided).__name__
        return {
            "cells": structure.cells,
            "columns": structure.column_count,
            "structure": {"kind": kind, **_options(divided)},
        }
    init = [field.name for field in fields(structure) if field.init]
    names = [name for name in init if name not in ("grid", "weights")]
    return {name: getattr(structure, name) for name in names}


def _bytes(structure: AbstractStructure) -> _ArrayBytes:
    shape = structure.state_shape
    as_stencil = len(shape) == 3
    # Per node a state and a capacity; per link two node indices and a conductance; per
    # fragment a node and an area. A stencil has a state and a byte of open faces for
    # each cell of its lattice, and neither capacities nor links.
    state = 4 * prod(shape)
    capacity = 0 if as_stencil else 4 * structure.node_count
    links = prod(shape) if as_stencil else 12 * structure.link_count
    fragments = 8 * len(structure.grid.fragment_area)
    return _ArrayBytes(
        state=state,
        capacity=capacity,
        links=links,
        fragments=fragments,
        total=state + capacity + links + fragments,
    )
