"""Sheet: a thin wall of layers on a surface, with two faces."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from typing_extensions import override

from ...arrays import array_namespace, stacked, typed_array
from ...errors import InputError, require, whole_number
from ...geometry.mesh import Mesh
from ...geometry.part_names import pattern_of_parts
from ...geometry.parts import joined_parts
from ...material.layer import Layer
from ...memo.found import found
from ...sheets.cells import sheet_cells
from ...sheets.sheet_grid import BACK, SheetGrid, sheet_grid
from ...sheets.through import (
    MAX_CELLS,
    SHORTEST_TIME,
    CellValues,
    Division,
    cell_count,
    cell_values,
    divided,
)
from ...voxels.selection import AbstractSpace
from ..structure import AbstractStructure, ColumnLayout, Links, Nodes
from ..weights import ConductionWeights


class Sheet(AbstractStructure):
    """Wall of one or several layers on a mesh that is a surface.

    Each cell of the surface has nodes through the thickness: node l n + i is the l-th
    from the front in the i-th of n cells. Heat flows along the surface with the sum of
    k d, through the wall in series. Both faces have fragments; an outermost node has
    those of its face.

    Raises:
        InputError: for layers that are none, or a mesh without area.

    Example:
        >>> import jaxthermo as jt
        >>> panel = jt.shapes.box((1.0, 0.5, 0.5))
        >>> sheet = jt.Sheet(panel, (jt.Layer("copper", 0.8e-3),), pitch=0.05)
        >>> sheet.cells_through
        1
    """

    stacks: tuple[tuple[Layer, ...], ...]
    """Layers of every part of the mesh, from the front to the back."""
    grid: SheetGrid = eqx.field(static=True)
    divisions: tuple[Division, ...] = eqx.field(static=True)
    """Cells through the thickness of every part."""
    weights: ConductionWeights = eqx.field(static=True, default=ConductionWeights())
    """Weights of 1: nothing of a sheet is fitted but the values of its layers."""

    def __init__(
        self,
        mesh: Mesh | Mapping[str, Mesh],
        layers: Sequence[Layer] | Mapping[str, Sequence[Layer]],
        pitch: float,
        *,
        cells: int | None = None,
        shortest_time: float = SHORTEST_TIME,
        weld: float | None = None,
        nodes: Literal["cells", "vertices"] = "cells",
        back: Literal["open", "adiabatic"] = "open",
    ):
        """Divide a surface into cells, and its thickness.

        Args:
            mesh: any triangles: open, closed, or not joined at all. Their normals point
                to the front. Or named parts, from `load_parts`.
            layers: from the front to the back, with their thicknesses; or by part, by
                its name or a pattern as in `materials_by_part`.
            pitch: edge of the cells along the surface [m].
            cells: number of cells through the thickness; by default as many as a load
                of `shortest_time` needs.
            shortest_time: duration of a load that the cells at the faces resolve [s].
            weld: distance within which vertices are joined [m]; by default 1e-5 of the
                size of the mesh.
            nodes: "cells", or "vertices" to have a node in each vertex of the mesh.
            back: "open", or "adiabatic" for a back on which only terms that name it
                act, with `on=Face("back")`, as below ground; the cells through the
                thickness are then narrow at the front alone.
        """
        _require_word("nodes", nodes, ("cells", "vertices"))
        _require_word("back", back, ("open", "adiabatic"))
        from_front = back == "adiabatic"
        parts = mesh if isinstance(mesh, Mapping) else {"": mesh}
        if not parts:
            raise InputError("Sheet(mesh={}): there are no parts: give one or more")
        for part in parts.values():
            require(part, classes=Mesh, argument="Sheet(mesh=)", give="a Mesh")
        by_part = layers if isinstance(layers, Mapping) else {"*": layers}
        patterns = pattern_of_parts(list(parts), list(by_part), "Sheet(layers=)")
        self.stacks = tuple(_stack(by_part[patterns[name]]) for name in parts)
        # Negated, so that NaN is refused too.
        if not shortest_time > 0:
            raise InputError(
                f"Sheet(shortest_time={shortest_time!r}): give a positive time [s]"
            )
        if cells is None:
            count = max(cell_count(s, shortest_time, from_front) for s in self.stacks)
        else:
            count = whole_number(cells, "Sheet(cells=)")
            if count > MAX_CELLS:
                raise InputError(f"Sheet(cells={cells}): give {MAX_CELLS} at most")
        self.divisions = tuple(
            divided(stack, count, from_front) for stack in self.stacks
        )
        self.grid = _grid(parts, pitch=pitch, weld=weld, nodes=nodes, back=back)
        self.weights = ConductionWeights()

    @property
    @override
    def identity(self) -> tuple[object, ...]:
        return (self.grid,)

    @property
    def cells_through(self) -> int:
        """Number m of cells through the thickness."""
        return len(self.divisions[0])

    @property
    def surface_cells(self) -> int:
        """Number n of cells of the surface."""
        return self.grid.cells.node_count

    @property
    @override
    def node_count(self) -> int:
        return self.cells_through * self.surface_cells

    @property
    @override
    def link_count(self) -> int:
        m = self.cells_through
        along = len(self.grid.cells.links.src)
        return m * along + (m - 1) * self.surface_cells

    @property
    @override
    def volume(self) -> float:
        return float(self._cell_volumes().sum())

    @property
    def mass(self) -> float:
        """Sum of rho d A of the layers [kg]."""
        area = self.grid.cells.area.sum(axis=0)
        by_area = [
            sum(
                float(layer.material.density) * float(layer.thickness)
                for layer in stack
            )
            for stack in self.stacks
        ]
        return float(area @ by_area)

    @property
    @override
    def capacity_ratio(self) -> float:
        return 1.0

    @override
    def nodes(self) -> Nodes:
        m = self.cells_through
        position = self.found(
            "node_position", lambda: np.tile(self.grid.cells.position, (m, 1))
        )
        return Nodes(
            centre=position,
            volume=self._cell_volumes().reshape(-1),
            level=np.repeat(np.arange(m), self.surface_cells),
            location=position,
        )

    def _cell_volumes(self) -> Float[Any, "m n"]:
        """Volume of each node [m^3]: numpy arrays unless a thickness is traced."""
        thickness = self.cell_thickness()
        xp = array_namespace(thickness)
        rows = xp.stack(thickness, axis=1)
        return rows @ typed_array(self.grid.cells.area.T, rows.dtype)

    def cell_thickness(self) -> list[Float[Any, " m"]]:
        """Thickness of the cells of each part [m]."""
        pairs = zip(self.stacks, self.divisions, strict=True)
        return [_thickness_of_cells(stack, division) for stack, division in pairs]

    def volume_within(self, space: AbstractSpace | None) -> Float[Any, " n"]:
        """Volume of the part of each node in a part of space [m^3]; of all for None."""
        volume = self._cell_volumes()
        if space is not None:
            fraction = self.grid.cell_fractions(space)
            volume = volume * fraction
        return volume.reshape(-1)

    @override
    def links(self) -> Links:
        return self.found("links", self._links)

    def _links(self) -> Links:
        """Links along the surface in each layer of cells, then through the wall.

        Areas and distances are those of the surface alone, of a wall of unit thickness:
        conductances do not follow from them.
        """
        along = self.grid.cells.links
        n = self.surface_cells
        m = self.cells_through
        position = self.grid.cells.position
        distance = np.linalg.norm(position[along.dst] - position[along.src], axis=1)
        first = n * np.arange(m)[:, None]
        inner = np.arange((m - 1) * n)
        half = np.tile(distance / 2, m)
        area = np.tile(along.weight * distance, m)
        # Nodes above each other are at one location.
        no_distance = np.zeros(len(inner))
        return Links(
            src=np.append((first + along.src).ravel(), inner).astype(np.int32),
            dst=np.append((first + along.dst).ravel(), inner + n).astype(np.int32),
            area=np.append(area, no_distance),
            distance_src=np.append(half, no_distance),
            distance_dst=np.append(half, no_distance),
        )

    @property
    @override
    def columns(self) -> ColumnLayout | None:
        n = self.surface_cells
        inner = self.cells_through - 1
        if not inner:
            return None
        along = (inner + 1) * len(self.grid.cells.links.src)
        return ColumnLayout(
            link=along + np.arange(inner * n).reshape(inner, n),
            hub=inner * n + np.arange(n),
            are_linked=True,
        )

    @override
    def fragment_node(self) -> Int[np.ndarray, " s"]:
        return self.found("fragment_node", self._fragment_node)

    def _fragment_node(self) -> Int[np.ndarray, " s"]:
        last = (self.cells_through - 1) * self.surface_cells
        at_back = self.grid.fragment_face == BACK
        number = self.grid.fragment_surface_cell + np.where(at_back, last, 0)
        return number.astype(np.int32)

    @property
    @override
    def fragment_distance(self) -> Float[np.ndarray, " s"]:
        # That of `fragment_depth`: a fragment is above its node.
        return np.full(len(self.grid.fragment_area), self.grid.pitch / 2)

    def cell_values(self, dtype: Any) -> CellValues:
        """Values of the cells through the thickness, of each part."""
        return cell_values(self.stacks, self.divisions, dtype)

    def face_values(self, field: str, dtype: Any) -> Float[Any, " s"]:
        """A property of the outermost layer at each fragment, by its field."""
        outermost = (*(s[0] for s in self.stacks), *(s[-1] for s in self.stacks))
        values = [getattr(layer.material, field) for layer in outermost]
        return self._at_fragments(values, dtype)

    def face_capacity(self, dtype: Any) -> Float[Any, " s"]:
        """Heat capacity of the node of each fragment, of an area [J/(m^2 K)]."""
        capacity = self.cell_values(dtype).capacity
        faces = array_namespace(capacity).concatenate([capacity[:, 0], capacity[:, -1]])
        return faces[self.face_row]

    def face_cell_thickness(self, dtype: Any) -> Float[Any, " s"]:
        """Thickness of the cell at each fragment [m]."""
        thickness = self.cell_thickness()
        fronts = [cells[0] for cells in thickness]
        return self._at_fragments([*fronts, *(c[-1] for c in thickness)], dtype)

    def _at_fragments(self, values: Sequence[Any], dtype: Any) -> Float[Any, " s"]:
        """Values at the front of each part, then at the back, by fragment."""
        return stacked(values, dtype)[self.face_row]

    @property
    def face_row(self) -> Int[np.ndarray, " s"]:
        """Place of each fragment in the fronts of all parts, then all backs."""
        return len(self.stacks) * self.grid.fragment_face + self.grid.fragment_part


def _thickness_of_cells(stack: Sequence[Layer], division: Division) -> Float[Any, " m"]:
    """Thickness of each cell through a stack [m]."""
    depth = [layer.thickness for layer in stack]
    xp = array_namespace(depth)
    dtype = np.float64 if xp is np else xp.result_type(*depth)
    thickness = xp.stack([xp.asarray(value, dtype) for value in depth])
    return np.asarray(division, dtype) @ thickness


def _require_word(argument: str, word: Any, words: tuple[str, str]) -> None:
    if word not in words:
        raise InputError(
            f"Sheet({argument}={word!r}): give {words[0]!r} or {words[1]!r}"
        )


def _stack(layers: Any) -> tuple[Layer, ...]:
    stack = tuple(layers) if isinstance(layers, Sequence) else (layers,)
    if not stack:
        raise InputError("Sheet(layers=): there are none: give one or more")
    for layer in stack:
        require(
            layer,
            classes=Layer,
            argument="Sheet(layers=)",
            give='layers, as in (Layer("copper", 1e-3),)',
        )
    return stack


def _grid(parts: Mapping[str, Mesh], **options: Any) -> SheetGrid:
    """Cells of the surface, the same for equal meshes and options."""
    by = ("sheet", tuple(parts), *options.values())
    return found(tuple(parts.values()), by=by, find=lambda: _divided(parts, **options))


def _divided(
    parts: Mapping[str, Mesh],
    *,
    pitch: float,
    weld: float | None,
    nodes: Literal["cells", "vertices"],
    back: str,
) -> SheetGrid:
    mesh, face_part = joined_parts(list(parts.values()))
    cells = sheet_cells(mesh, pitch=pitch, weld=weld, nodes=nodes, face_part=face_part)
    names = tuple(parts)
    return sheet_grid(
        mesh,
        cells,
        part_names=() if names == ("",) else names,
        has_adiabatic_back=back == "adiabatic",
    )
