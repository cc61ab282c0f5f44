"""Conduction in sheets: along its surface, and through its layers.

Along the surface, two nodes of one layer of cells exchange heat with

    G = w sum of k d    [W/K],

the weight w of the Laplacian of the surface; through the wall, two neighbouring cells
of the area A with

    G = A / (R_back + R_front)    [W/K],

their resistances from the common face (see `sheets.through`): the columns of
`network.columns`, which do not shorten explicit steps. Where parts of several
stacks meet in a node, their conductances and capacities add up.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ..arrays import array_namespace, consecutive, device_array
from ..network.link_operator import row_layout, row_network
from ..network.network import AbstractNetwork
from ..sheets.through import CellValues, cell_values
from ..structures.joined import JoinedStructure
from ..structures.kinds.sheet import Sheet
from ..structures.structure import AbstractStructure
from .column_conduction import column_network


class Conduction(NamedTuple):
    """Conduction of bodies that are one network."""

    network: AbstractNetwork
    half_cell: Float[Any, " s"]
    """Conductance from each fragment to its node [W/K]."""


def sheets_conduction(
    structure: AbstractStructure, sheets: Sequence[Sheet], dtype: Any
) -> Conduction:
    """Conduction of sheets with the same number of cells through the thickness.

    `structure` is the sheet, or the structure that joins them; conductances follow from
    the values of their layers.
    """
    geometry = structure.found(
        ("sheet_geometry", np.dtype(dtype).name), lambda: _geometry(sheets, dtype)
    )
    values = cell_values(
        [stack for sheet in sheets for stack in sheet.stacks],
        divisions=[division for sheet in sheets for division in sheet.divisions],
        dtype=dtype,
    )
    xp = array_namespace(values.to_front)
    faces = xp.concatenate([values.to_front[:, 0], values.to_back[:, -1]])
    area = structure.grid.fragment_area.astype(dtype)
    return Conduction(
        network=_network(structure, geometry, values),
        half_cell=area / faces[geometry.face],
    )


def _network(
    structure: AbstractStructure, geometry: "_Geometry", values: CellValues
) -> AbstractNetwork:
    along = values.conductance.T[:, geometry.part] * geometry.weight[None]

    def of_nodes(by_area: Float[Any, "p m"]) -> Float[Any, " _"]:
        by_stack = geometry.area[None] * by_area.T[:, geometry.stack]
        return by_stack.sum(axis=-1).reshape(-1)

    through = of_nodes(1 / (values.to_back[:, :-1] + values.to_front[:, 1:]))
    xp = array_namespace(through)
    conductance = xp.concatenate([along.reshape(-1), through])
    if isinstance(structure, JoinedStructure):
        order = structure.found("sheet_links", lambda: _link_order(structure))
        conductance = conductance[order]
    columns = structure.columns
    if columns is None:
        layout = structure.found("row_layout", lambda: _layout(structure))
        return row_network(layout, conductance, of_nodes(values.capacity))
    return column_network(
        structure,
        columns=columns,
        conductance=conductance,
        capacity=of_nodes(values.capacity),
    )


def _layout(structure: AbstractStructure) -> Any:
    links = structure.links()
    layout = row_layout(structure.node_count, links.src, links.dst)
    return jax.tree.map(device_array, layout)


class _Geometry(NamedTuple):
    """Cells of the surfaces of all sheets; stacks are numbered through."""

    part: Int[np.ndarray, " e"]
    """Stack of each link along the surface."""
    weight: Float[np.ndarray, " e"]
    """Weight of each link along the surface [-]."""
    stack: Int[np.ndarray, "n k"]
    """Stacks of each cell, as many as any cell has."""
    area: Float[np.ndarray, "n k"]
    """Area of each cell with each of its stacks [m^2]."""
    face: Int[np.ndarray, " s"]
    """Place of each fragment in the fronts of all stacks, then all backs."""


def _geometry(sheets: Sequence[Sheet], dtype: Any) -> _Geometry:
    first_stacks = consecutive(len(sheet.stacks) for sheet in sheets)
    total = first_stacks[-1].stop
    part = []
    weight = []
    stack = []
    area = []
    face = []
    for sheet, numbers in zip(sheets, first_stacks, strict=True):
        cells = sheet.grid.cells
        part.append(cells.links.part + numbers.start)
        weight.append(cells.links.weight)
        # The stacks of a cell first, those that it does not have behind them.
        order = np.argsort(cells.area <= 0, axis=1, kind="stable")
        stack.append(order + numbers.start)
        area.append(np.take_along_axis(cells.area, order, axis=1))
        of_part = sheet.grid.fragment_part + numbers.start
        face.append(total * sheet.grid.fragment_face + of_part)
    most = max(int((cell_area > 0).sum(axis=1).max()) for cell_area in area)
    widths = [((0, 0), (0, max(most - values.shape[1], 0))) for values in area]
    stack_rows = [
        np.pad(rows[:, :most], width, mode="edge")
        for rows, width in zip(stack, widths, strict=True)
    ]
    area_rows = [
        np.pad(rows[:, :most], width) for rows, width in zip(area, widths, strict=True)
    ]
    return _Geometry(
        part=np.concatenate(part).astype(np.int32),
        weight=np.concatenate(weight).astype(dtype),
        stack=np.concatenate(stack_rows).astype(np.int32),
        area=np.concatenate(area_rows).astype(dtype),
        face=np.concatenate(face).astype(np.int32),
    )


def _link_order(structure: JoinedStructure) -> Int[np.ndarray, " e"]:
    """Number of each link where those of all sheets follow layer by layer.

    First those along the surfaces, then those through the walls.
    """
    sheets = [part for part in structure.parts if isinstance(part, Sheet)]
    layers = sheets[0].cells_through
    cells = consecutive(sheet.surface_cells for sheet in sheets)
    links = consecutive(len(sheet.grid.cells.links.src) for sheet in sheets)
    along = np.arange(layers * links[-1].stop).reshape(layers, -1)
    through = along.size + np.arange((layers - 1) * cells[-1].stop)
    through = through.reshape(layers - 1, cells[-1].stop)
    number = [
        np.append(along[:, of_links], through[:, of_cells])
        for of_links, of_cells in zip(links, cells, strict=True)
    ]
    return np.concatenate(number)[structure.link_order]
