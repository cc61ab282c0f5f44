"""Sheets of a scene's file in finer and coarser cells."""

from collections.abc import Mapping, Sequence

from jaxthermo.config.schema.body import BodyConfig
from jaxthermo.config.schema.sheet import GroundShape, SheetConfig
from jaxthermo.material.layer import Layer
from jaxthermo.sheets.through import (
    SHORTEST_TIME,
    cell_count,
    divided,
    resolved_time,
)


def resized_sheet(body: BodyConfig, pitch: float, size: float) -> BodyConfig:
    """A body that is a sheet, in cells of another size along and through it.

    Args:
        body: config of the body.
        pitch: edge of the cells along the surface [m].
        size: widths of the cells through the thickness over those of the config [-].
    """
    wall = body.wall
    assert wall is not None
    changes: dict[str, object] = {"pitch": pitch}
    if size != 1:
        # A load goes as deep as the root of its duration.
        changes |= {"cells": None, "shortest_time": _resolved_time(wall) * size**2}
    resized: dict[str, object] = {"sheet": wall.model_copy(update=changes)}
    if isinstance(body.shape, GroundShape):
        # Those are short for a sheet.
        resized["shape"] = body.shape.model_copy(update={"layers": None})
    return body.model_copy(update=resized)


def without_cells(body: BodyConfig) -> BodyConfig:
    """A body that is a sheet, with the default cells through its thickness."""
    assert body.wall is not None
    wall = body.wall.model_copy(update={"cells": None, "shortest_time": None})
    return body.model_copy(update={"sheet": wall})


def _resolved_time(wall: SheetConfig) -> float:
    """Shortest duration of a load that the cells through a wall resolve [s]."""
    if wall.cells is None:
        return wall.shortest_time or SHORTEST_TIME
    from_front = _is_heated_at_front(wall)
    return max(
        resolved_time(stack, divided(stack, wall.cells, from_front), from_front)
        for stack in _stacks(wall)
    )


def through_count(wall: SheetConfig) -> int:
    """Number of cells through the thickness of a wall."""
    if wall.cells is not None:
        return wall.cells
    time = wall.shortest_time or SHORTEST_TIME
    from_front = _is_heated_at_front(wall)
    return max(cell_count(stack, time, from_front) for stack in _stacks(wall))


def _stacks(wall: SheetConfig) -> list[Sequence[Layer]]:
    layers = wall.built_layers()
    return list(layers.values()) if isinstance(layers, Mapping) else [layers]


def _is_heated_at_front(wall: SheetConfig) -> bool:
    return wall.back not in (None, "open")
