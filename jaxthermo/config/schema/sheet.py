"""Sheets: thin walls of layers on a surface, instead of voxels; and the ground."""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Discriminator, Field, Tag
from typing_extensions import override

import jaxthermo

from ..types.model import Model, build
from ..types.quantities import (
    Extent,
    NotEmpty,
    PositiveLength,
    PositiveTime,
    Temperature,
    Whole,
    word_or_temperature,
)
from .material import Material, data_rows, one_of


_CELLS_OF_SIZE = 100
"""Number of cells along the longest edge of a body whose pitch is not given."""


@cache
def _stack_names() -> tuple[str, ...]:
    # From the data file: `jaxthermo.stacks` has the same names, but imports JAX.
    return tuple(dict.fromkeys(row["name"] for row in data_rows("stacks.csv")))


_StackName = Annotated[
    str,
    one_of("stack", _stack_names),
    Field(json_schema_extra={"enum": [*_stack_names()]}),
]


class _LayerConfig(Model, builds="Layer"):
    """A layer of a sheet."""

    material: Material
    thickness: PositiveLength


_LayerList = Annotated[tuple[_LayerConfig, ...], NotEmpty]


def _name_or_list(value: Any) -> str:
    return "<name>" if isinstance(value, str) else "<list>"


_Stack = Annotated[
    Annotated[_StackName, Tag("<name>")] | Annotated[_LayerList, Tag("<list>")],
    Discriminator(_name_or_list),
]
"""Layers from the front to the back, or the name of a stack."""


def _stack_or_parts(value: Any) -> str:
    return "<parts>" if isinstance(value, Mapping) else "<stack>"


_Layers = Annotated[
    Annotated[_Stack, Tag("<stack>")]
    | Annotated[dict[str, _Stack], NotEmpty, Tag("<parts>")],
    Discriminator(_stack_or_parts),
]


_Back = Annotated[
    Annotated[Literal["open", "adiabatic"], Tag("<word>")]
    | Annotated[Temperature, Tag("<temperature>")],
    word_or_temperature("open", "adiabatic"),
]


class SheetConfig(Model):
    """A thin wall on the surface of the body, with two faces."""

    layers: _Layers
    """Layers from the front, the side of the normals, to the back, or the name of a
    stack; or these by part, or by a pattern of parts as for materials."""
    pitch: PositiveLength | None = None
    """Edge of the cells along the surface [m]; a hundredth of the longest edge of the
    body if not given."""
    cells: Annotated[Whole, Field(ge=1, le=64)] | None = None
    """Number of cells through the thickness; by the shortest time if not given."""
    shortest_time: PositiveTime | None = None
    """Duration of a load that the cells at the faces resolve [s]."""
    weld: PositiveLength | None = None
    """Distance within which vertices are joined [m]; 1e-5 of the size if not given."""
    nodes: Literal["cells", "vertices"] = "cells"
    """Nodes are cells of the surface, or the vertices of the mesh."""
    back: _Back | None = None
    """`open` to all terms (as without this, but for ground), `adiabatic` but for terms
    with `on: {face: back}`, or the temperature at which it is held [K]. That of ground
    is held at the body's temperature at the start."""

    @property
    def held(self) -> float | None:
        """Temperature at which the back is held [K]; None if it is not."""
        return None if isinstance(self.back, str) else self.back

    @override
    def build(self, *args: Any) -> Any:
        """The sheet on the parts of a mesh, which are the argument.

        Raises:
            InputError: for layers or parts that do not fit.
        """
        (parts,) = args
        arguments = super().arguments()
        arguments["layers"] = self.built_layers()
        if self.held is not None:
            arguments["back"] = "adiabatic"
        bounds = np.concatenate([mesh.bounds for mesh in parts.values()])
        arguments["pitch"] = self.pitch_on(bounds)
        return jaxthermo.Sheet(parts, **arguments)

    def pitch_on(self, bounds: Float[np.ndarray, "n 3"]) -> float:
        """Edge of the cells along a surface with these bounds [m]."""
        if self.pitch is not None:
            return self.pitch
        return float(np.ptp(bounds, axis=0).max()) / _CELLS_OF_SIZE

    def built_layers(self) -> Any:
        """The layers of all parts, or those by part."""
        return _built_layers(self.layers)


def _built_layers(layers: Any) -> Any:
    if isinstance(layers, Mapping):
        return {pattern: _built_layers(stack) for pattern, stack in layers.items()}
    return jaxthermo.stacks[layers] if isinstance(layers, str) else build(layers)


class GroundShape(Model, kind="ground"):
    """A horizontal rectangle at z = 0 with its front up."""

    size: Extent
    """Edges along x and y [m]."""
    layers: _Layers | None = None
    """Layers from the top down, or the name of a stack: short for a `sheet` with
    these layers."""

    @override
    def build(self, *args: Any) -> Any:
        width, length = self.size
        return jaxthermo.shapes.rectangle(width, length)
