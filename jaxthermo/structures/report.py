"""What a structure is made of, as plain types; units in the keys."""

from dataclasses import fields
from math import prod
from typing import Any

import numpy as np

from .kinds.irregular import IrregularMultiLevel
from .structure import AbstractStructure


def structure_report(
    structure: AbstractStructure, build_time: float | None = None
) -> dict[str, Any]:
    """Counts, memory, and where the capacity is.

    Args:
        structure: of any kind.
        build_time: how long it took to make [s], if that was measured.
    """
    report = {
        "kind": type(structure).__name__,
        "options": _options(structure),
        "pitch_m": float(structure.grid.pitch),
        "solid_voxels": structure.grid.solid_count,
        "nodes": structure.node_count,
        "links": structure.link_count,
        "fragments": len(structure.grid.fragment_area),
        "bytes_float32": _bytes(structure),
        "capacity_ratio": structure.capacity_ratio,
        "levels": _levels(structure),
        "build_time_s": build_time,
    }
    if isinstance(structure, IrregularMultiLevel):
        shares = structure.coverage()
        report["share_of_body_volume"] = shares._asdict()
    return report


def _options(structure: AbstractStructure) -> dict[str, Any]:
    """What was chosen."""
    return {
        field.name: getattr(structure, field.name)
        for field in fields(structure)
        if field.init and field.name not in ("grid", "weights")
    }


def _bytes(structure: AbstractStructure) -> dict[str, int]:
    """Of the arrays that a solver reads, in float32 and int32.

    A state and a capacity for each node, two numbers of nodes and a conductance for
    each link, a node and an area for each fragment. A stencil has a state and a byte
    of open faces for each cell of its lattice, and neither capacities nor links.
    """
    shape = structure.state_shape
    as_stencil = len(shape) == 3
    parts = {
        "state": 4 * prod(shape),
        "capacity": 0 if as_stencil else 4 * structure.node_count,
        "links": prod(shape) if as_stencil else 12 * structure.link_count,
        "fragments": 8 * len(structure.grid.fragment_area),
    }
    return {**parts, "total": sum(parts.values())}


def _levels(structure: AbstractStructure) -> list[dict[str, Any]]:
    """Nodes and volume of every level."""
    nodes = structure.nodes()
    counts = np.bincount(nodes.level)
    volumes = np.bincount(nodes.level, nodes.volume)
    return [
        {"level": level, "nodes": int(count), "volume_m3": float(volume)}
        for level, (count, volume) in enumerate(zip(counts, volumes, strict=True))
    ]
