"""Conduction of structures with columns, see `network.columns`."""

import jax
import numpy as np
from jaxtyping import Array, Float

from ..arrays import device_array
from ..network.column_network import ColumnNetwork
from ..network.link_operator import row_layout, row_network
from ..network.network import AbstractNetwork
from ..structures.structure import AbstractStructure, ColumnLayout


def column_network(
    structure: AbstractStructure,
    columns: ColumnLayout,
    conductance: Float[np.ndarray | Array, " e"],
    capacity: Float[np.ndarray | Array, " n"],
) -> AbstractNetwork:
    """Network of columns, and of the links outside them [W/K, J/K]."""
    cells = columns.link.size
    # Cells that have no other links are in no row.
    first = 0 if columns.are_linked else cells

    def find():
        links = structure.links()
        outside = np.setdiff1d(np.arange(len(links.src)), columns.link)
        layout = row_layout(
            structure.node_count - first,
            src=links.src[outside] - first,
            dst=links.dst[outside] - first,
        )
        return outside, jax.tree.map(device_array, layout)

    outside, layout = structure.found("column_rows", find)
    hub = columns.hub - cells
    is_sequence = np.array_equal(hub, np.arange(len(hub)))
    return ColumnNetwork(
        others=row_network(layout, conductance[outside], capacity[first:]),
        conductance=device_array(conductance[columns.link]),
        hub=None if is_sequence else device_array(hub.astype(np.int32)),
        node_capacity=device_array(capacity),
        by_link=device_array(conductance),
    )
