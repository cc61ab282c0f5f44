"""Report of a structure as plain types, with units in the keys."""

from dataclasses import fields
from math import prod
from typing import Any

import numpy as np

from .kinds.shell import IrregularMultiLevel
from .structure import AbstractStructure


def structure_report(
    structure: AbstractStructure, build_time: float | None = None
) -> dict[str, Any]:
    """Counts, memory and capacity of every level; with the time to build it [s]."""
    nodes = structure.nodes()
    init = [f.name for f in fields(structure) if f.init]
    options = [name for name in init if name not in ("grid", "weights")]
    counts = np.bincount(nodes.level)
    volumes = np.bincount(nodes.level, nodes.volume)
    report = {
        "kind": type(structure).__name__,
        "options": {name: getattr(structure, name) for name in options},
        "pitch_m": float(structure.grid.pitch),
        "solid_voxels": structure.grid.solid_count,
        "nodes": structure.node_count,
        "links": structure.link_count,
        "fragments": len(structure.grid.fragment_area),
        "bytes_float32": _bytes(structure),
        "capacity_ratio": structure.capacity_ratio,
        "levels": [
            {"level": level, "nodes": int(count), "volume_m3": float(volume)}
            for level, (count, volume) in enumerate(zip(counts, volumes, strict=True))
        ],
        "build_time_s": build_time,
    }
    if isinstance(structure, IrregularMultiLevel):
        report["share_of_body_volume"] = structure.coverage()._asdict()
    return report


def _bytes(structure: AbstractStructure) -> dict[str, int]:
    """Size of the arrays that a solver reads, in float32 and int32 [bytes]."""
    shape = structure.state_shape
    as_stencil = len(shape) == 3
    # Per node a state and a capacity; per link two node indices and a conductance; per
    # fragment a node and an area. A stencil has a state and a byte of open faces for
    # each cell of its lattice, and neither capacities nor links.
    sizes = {
        "state": 4 * prod(shape),
        "capacity": 0 if as_stencil else 4 * structure.node_count,
        "links": prod(shape) if as_stencil else 12 * structure.link_count,
        "fragments": 8 * len(structure.grid.fragment_area),
    }
    return {**sizes, "total": sum(sizes.values())}
