"""Conduction in a sheet: along its surface, and through its layers.

Along the surface, two nodes of one layer of cells exchange heat with

    G = w sum of k d    [W/K],

the weight w of the Laplacian of the surface; through the wall, two neighbouring cells
of the area A with

    G = A / (R_back + R_front)    [W/K],

their resistances from the common face (see `sheets.through`): the columns of
`network.columns`, which do not shorten explicit steps. Where parts of several
stacks meet in a node, their conductances and capacities add up.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import device_array, product
from ..network.link_operator import row_layout, row_network
from ..network.network import AbstractNetwork
from ..structures.kinds.sheet import Sheet
from .column_conduction import column_network


def sheet_network(sheet: Sheet, dtype: Any) -> AbstractNetwork:
    """Network of a sheet, from the values of its layers."""
    geometry = sheet.found(
        ("sheet_geometry", np.dtype(dtype).name), lambda: _geometry(sheet, dtype)
    )
    values = sheet.cell_values(dtype)
    # [parts, cells through the thickness].
    along, capacity, to_front, to_back = (
        jnp.stack([jnp.asarray(column) for column in columns])
        for columns in zip(*values, strict=True)
    )
    weight, area = geometry
    part = sheet.grid.cells.links.part
    along_surface = (along.T[:, part] * weight[None]).reshape(-1)
    node_capacity = product(area, capacity).T.reshape(-1)
    through = product(area, 1 / (to_back[:, :-1] + to_front[:, 1:])).T.reshape(-1)
    conductance = jnp.concatenate([along_surface, through])
    columns = sheet.columns()
    if columns is None:
        layout = sheet.found("row_layout", lambda: _layout(sheet))
        return row_network(layout, conductance, node_capacity)
    return column_network(
        sheet, columns=columns, conductance=conductance, capacity=node_capacity
    )


def _layout(sheet: Sheet) -> Any:
    links = sheet.links()
    layout = row_layout(sheet.node_count, links.src, links.dst)
    return jax.tree.map(device_array, layout)


def _geometry(
    sheet: Sheet, dtype: Any
) -> tuple[Float[Array, " e"], Float[Array, "n p"]]:
    """Weights of the links along the surface [-], and areas by part [m^2]."""
    cells = sheet.grid.cells
    return device_array(cells.links.weight, dtype), device_array(cells.area, dtype)
