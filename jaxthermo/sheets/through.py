"""Cells through the thickness of a wall of several layers.

A load that lasts a time t goes sqrt(alpha t) deep. Depths are therefore counted as

    s = integral of dx / sqrt(alpha)    [s^(1/2)].

The cells at the faces are at most sqrt(t) / 2 wide, and each cell is wider than its
neighbour nearer to a face by a constant ratio. Where an interface of layers is near a
border of cells, the border is moved to it.

A cell holds a part of a layer, or parts of several. Its temperature differs from that
of its face by the flux there times

    R_face = integral of R c dx / integral of c dx    [m^2 K/W],

with the resistance R from the face to x and the heat capacity c of a volume: exact
where the flux is spent evenly on the cell's capacity, and half of the resistance of a
cell of one layer.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..arrays import is_traced, stacked
from ..errors import InputError
from ..material.layer import Layer


SHORTEST_TIME = 60.0
"""Duration of a load that the cells at the faces resolve by default [s]."""

GROWTH = 1.5
"""Width of a cell over that of its neighbour nearer to a face."""

MAX_CELLS = 64
"""Largest number of cells through a thickness."""


Division = tuple[tuple[float, ...], ...]
"""Fraction of the thickness of every layer that each cell holds, cell by cell."""


def cell_count(layers: Sequence[Layer], time: float, from_front: bool) -> int:
    """Number of cells with which those at the faces resolve a load.

    Args:
        layers: from the front to the back.
        time: duration of the load [s].
        from_front: True if it acts on the front alone.

    Raises:
        InputError: if there are too many, or a layer is traced.
    """
    if is_traced(tuple(layers)):
        raise InputError(
            "Sheet(layers=): a traced layer has no thickness yet: give the number of "
            "cells through it, as in cells=1"
        )
    width = float(_widths(layers).sum())
    for count in range(1, MAX_CELLS + 1):
        relative = _relative_widths(count, from_front)
        if width * relative[0] / relative.sum() <= 0.5 * time**0.5:
            return count
    raise InputError(
        f"Sheet(layers=): a load of {time:g} s needs more than {MAX_CELLS} cells "
        "through the thickness: give their number, as in cells=12"
    )


def resolved_time(
    layers: Sequence[Layer], division: Division, from_front: bool
) -> float:
    """Shortest duration of a load that the cells at the faces resolve [s].

    Args:
        layers: from the front to the back.
        division: the cells.
        from_front: True if it acts on the front alone.
    """
    widths = np.asarray(division) @ _widths(layers)
    widest = widths[0] if from_front else max(widths[0], widths[-1])
    return float((2 * widest) ** 2)


def divided(layers: Sequence[Layer], count: int, from_front: bool) -> Division:
    """Divide a stack into a number of cells, see the module."""
    widths = np.ones(len(layers))
    if not is_traced(tuple(layers)):
        widths = _widths(layers)
    relative = _relative_widths(count, from_front)
    edges = np.append(0.0, np.cumsum(relative / relative.sum())) * widths.sum()
    interfaces = np.append(0.0, np.cumsum(widths))
    edges[-1] = interfaces[-1]
    _move_to(interfaces[1:-1], edges)
    low = np.maximum(edges[:-1, None], interfaces[:-1])
    high = np.minimum(edges[1:, None], interfaces[1:])
    fraction = np.maximum(high - low, 0) / widths
    # Without the slivers of rounding.
    fraction[fraction < 1e-9] = 0
    return tuple(map(tuple, (fraction / fraction.sum(axis=0)).tolist()))


def _widths(layers: Sequence[Layer]) -> Float[np.ndarray, " l"]:
    """Width of each layer, d / sqrt(alpha) [s^(1/2)]."""
    return np.array(
        [
            float(layer.thickness) / float(layer.material.diffusivity) ** 0.5
            for layer in layers
        ]
    )


def _relative_widths(count: int, from_front: bool) -> Float[np.ndarray, " m"]:
    number = np.arange(count)
    steps = number if from_front else np.minimum(number, number[::-1])
    return GROWTH ** steps.astype(float)


def _move_to(interfaces: Float[np.ndarray, " i"], edges: Float[np.ndarray, " e"]):
    """Move borders of cells to interfaces that are near them, in place."""
    is_free = np.ones(len(edges), bool)
    is_free[[0, -1]] = False
    for interface in interfaces:
        nearest = int(np.abs(edges - interface).argmin())
        if not is_free[nearest]:
            continue
        around = np.diff(edges[nearest - 1 : nearest + 2])
        if abs(edges[nearest] - interface) <= 0.5 * around.min():
            edges[nearest] = interface
            is_free[nearest] = False


class CellValues(NamedTuple):
    """Sums over the pieces of each of the m cells of several stacks."""

    conductance: Float[Any, "p m"]
    """Conductance along the surface of a square, sum of k d [W/K]."""
    capacity: Float[Any, "p m"]
    """Heat capacity of an area, sum of rho c_p d [J/(m^2 K)]."""
    to_front: Float[Any, "p m"]
    """Resistance to the cell's front face [m^2 K/W]."""
    to_back: Float[Any, "p m"]
    """Resistance to its back face [m^2 K/W]."""


def cell_values(
    stacks: Sequence[Sequence[Layer]], divisions: Sequence[Division], dtype: Any
) -> CellValues:
    """Values of the cells of stacks: numpy arrays unless a layer is traced."""
    layers = [layer for stack in stacks for layer in stack]
    counts = [len(stack) for stack in stacks]
    # Stacks of fewer layers than others have more of their last one, of no thickness.
    position = np.minimum(np.arange(max(counts)), np.array(counts)[:, None] - 1)
    position += (np.cumsum(counts) - counts)[:, None]
    fraction = np.zeros((len(stacks), len(divisions[0]), max(counts)), dtype)
    for row, division in zip(fraction, divisions, strict=True):
        row[:, : len(division[0])] = division

    def table(numbers: Sequence[Any]) -> Float[Any, "p 1 l"]:
        return stacked(numbers, dtype)[position][:, None]

    depth = fraction * table([layer.thickness for layer in layers])
    k = table([layer.conductivity for layer in layers])
    density = table([layer.material.density for layer in layers])
    capacity = (
        depth * density * table([layer.material.specific_heat for layer in layers])
    )
    resistance = depth / k
    to_middle = resistance.cumsum(axis=-1) - resistance / 2
    total = capacity.sum(axis=-1)
    to_front = (capacity * to_middle).sum(axis=-1) / total
    return CellValues(
        conductance=(depth * k).sum(axis=-1),
        capacity=total,
        to_front=to_front,
        to_back=resistance.sum(axis=-1) - to_front,
    )
