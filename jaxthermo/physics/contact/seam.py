"""Heat conduction through seams: along the lines at which sheets end on other bodies.

A seam of the length L and the thickness d of the (thinner) sheet is a contact of the
area d L. Its half cells are

- of a sheet, k d L / e, with the distance e from its nodes to the seam;
- of a solid, k L / (1 / 2 + ln(1 / sin(pi d / (4 b))) / pi) with the depth b of its
  node: heat spreads from a strip of the width d to a cell of the width 2 b > d (Mikic
  and Rohsenow 1966), and goes on to its middle.

The nodes at a border are on it, and e would be 0 in the limit of rigid links. It is an
eighth of the mean width of their cells: then links over the seam do not shorten
explicit steps much, and a seam adds the resistance of an eighth of a cell to a sheet.

The cells through the thickness of two sheets meet by their relative depths.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from ...arrays import TimeVarying, array_namespace, device_array, typed_array
from ...network.segment_sums import sums_of_sizes
from ...sheets.sheet_grid import BACK
from ...structures.kinds.sheet import Sheet
from ..time_varying import for_jit
from .joint import AbstractJoint, BodyNumbers
from .links import ContactEnd, ContactLinks
from .rays import PlacedGrid
from .seam_search import SeamPairs, seams_between
from .search import Joint


_DISTANCE = 1 / 8
"""Distance of a seam from its nodes over the width of their cells [-]."""


class Seam(AbstractJoint):
    """Heat conduction along the lines at which sheets end on other bodies.

    q = G (T_a - T_b) [W],    1 / G = 1 / G_a + 1 / (h_c d L) + 1 / G_b,

    with the length L of the seam, the thickness d of the sheet, of two sheets the
    thinner one, and the half cells G_a and G_b [W/K] from the seam to the nodes of both
    bodies. A free border of a sheet has a seam with the border of another, with its
    face, and with the surface of a solid. Of several seams of two bodies the first in
    the scene counts.

    Raises:
        InputError: for a negative conductance, or a threshold that is not positive.
    """

    name = "seam"

    conductance: TimeVarying
    """h_c [W/(m^2 K)], a number or a function of time; infinity is a weld."""
    bodies: tuple[BodyNumbers, BodyNumbers] | None = eqx.field(
        static=True, default=None
    )
    """Numbers or names of the two bodies, or of the bodies of two groups; None for
    all."""
    threshold: float | None = eqx.field(static=True, default=None)
    """Largest gap that counts as a seam [m]; None for a tenth of a cell of the finer
    body."""
    max_pairs: int | None = eqx.field(static=True, default=None)
    """Largest number of pieces; None for that of the scene."""

    def __check_init__(self):
        self.check_joint({"threshold": self.threshold})

    @override
    def touching(
        self, bodies: tuple[PlacedGrid, ...]
    ) -> dict[tuple[int, int], SeamPairs]:
        return seams_between(bodies, self.max_gap)

    @override
    def bind(self, joints: Sequence[Joint], ends: tuple[Any, Any]) -> ContactLinks:
        parts = [
            _bound_joint(joint, ends, self.max_pairs or joint.size) for joint in joints
        ]
        dtype = np.dtype(ends[0].half_cell.dtype)
        sizes = [len(part.area) for part in parts]
        return ContactLinks(
            entries=tuple(joint.entry for joint in joints),
            pair_sums=sums_of_sizes(sizes) if sizes[1:] else None,
            bodies=(ends[0].number, ends[1].number),
            ends=(
                _joined([part.ends[0] for part in parts]),
                _joined([part.ends[1] for part in parts]),
            ),
            area=device_array(_rows([part.area for part in parts]), dtype),
            conductance=for_jit(self.conductance, dtype),
        )


class _Cells(NamedTuple):
    """Cells of a body through its depth at each piece of a seam."""

    node: Int[np.ndarray, "q p"]
    """Node in the group of the body."""
    conductance: Float[Any, "q p"]
    """Conductance from the seam to each node [W/K]."""
    low: Float[Any, "q p"]
    """Depth at which each cell begins, over the thickness [-]."""
    high: Float[Any, "q p"]


class _Side:
    """One body at the pieces of a seam."""

    def __init__(
        self,
        end: Any,
        *,
        body: int,
        fragment: Int[np.ndarray, " p"],
        on_face: Bool[np.ndarray, " p"],
        length: Float[np.ndarray, " p"],
    ):
        member = end.group.numbers.index(body)
        self.end = end
        self.structure = end.group.bodies[member].structure
        self.nodes = end.group.nodes[member]
        """Nodes of the body among those of its group."""
        self.fragment = fragment
        """Fragment in the group of the body."""
        # Rows of the padding have no fragment of the body.
        first = end.group.fragments[member].start
        self.local = np.where(length > 0, fragment - first, 0)
        self.on_face = on_face
        self.length = length
        self.dtype = np.dtype(end.half_cell.dtype)

    @property
    def thickness(self) -> Float[Any, " p"] | float:
        """Thickness of a sheet [m]; infinite for a solid."""
        if not isinstance(self.structure, Sheet):
            return np.inf
        total = [cells.sum() for cells in self.structure.cell_thickness()]
        return self._of_parts(total)

    def cells(self, strip: Float[Any, " p"]) -> _Cells:
        """Cells at each piece, of which heat spreads from a strip of a width [m]."""
        if isinstance(self.structure, Sheet):
            return self._of_sheet(self.structure)
        return self._of_solid(strip)

    def _of_sheet(self, sheet: Sheet) -> _Cells:
        m = sheet.cells_through
        n = sheet.surface_cells
        grid = sheet.grid
        column = grid.fragment_surface_cell[self.local]
        total = self.length.sum()
        area = grid.cells.area.sum(axis=1)[np.unique(column)].sum()
        # [W/K] over k d
        shape = self.length / (_DISTANCE * area / total if total else 1.0)
        along = sheet.cell_values(self.dtype).conductance
        thickness = sheet.cell_thickness()
        edges = [depth.cumsum() / depth.sum() for depth in thickness]
        is_back = grid.fragment_face[self.local] == BACK
        conductance = []
        lows = []
        highs = []
        outermost = np.where(is_back, m - 1, 0)
        for cell in range(m):
            conducts = ~self.on_face | (outermost == cell)
            weight = typed_array(shape * conducts, self.dtype)
            conductance.append(self._of_parts([k[cell] for k in along]) * weight)
            high = self._of_parts([edge[cell] for edge in edges])
            low = self._of_parts([edge[cell - 1] if cell else 0.0 for edge in edges])
            # Depths count from the face of the fragment; a face meets all depths.
            xp = array_namespace([low, high])
            nearest = xp.where(is_back, 1 - high, low)
            farthest = xp.where(is_back, 1 - low, high)
            lows.append(xp.where(self.on_face, 0.0, nearest))
            highs.append(xp.where(self.on_face, 1.0, farthest))
        xp = array_namespace([conductance, lows])
        return _Cells(
            node=self.nodes[n * np.arange(m)[:, None] + column],
            conductance=xp.stack(conductance),
            low=xp.stack(lows),
            high=xp.stack(highs),
        )

    def _of_solid(self, strip: Float[Any, " p"]) -> _Cells:
        structure = self.structure
        distance = structure.fragment_distance[self.local]
        k = self.end.half_cell[self.fragment] * typed_array(
            distance / structure.grid.fragment_area[self.local], self.dtype
        )
        xp = array_namespace([strip, k])
        width = xp.minimum(strip / typed_array(2 * distance, self.dtype), 1.0)
        resistance = 0.5 - xp.log(xp.sin(np.pi / 2 * width)) / np.pi
        conductance = k * typed_array(self.length, self.dtype) / resistance
        node = structure.fragment_node()[self.local]
        depth = np.zeros((1, len(self.length)), self.dtype)
        return _Cells(
            node=self.nodes[node[None]],
            conductance=conductance[None],
            low=depth,
            high=depth + 1,
        )

    def _of_parts(self, values: Sequence[Any]) -> Float[Any, " p"]:
        """Values of each part of the sheet at its pieces."""
        rows = [typed_array(value, self.dtype) for value in values]
        part = self.structure.grid.fragment_part[self.local]
        return array_namespace(rows).stack(rows)[part]

    def bound(
        self, node: Int[np.ndarray, " r"], half_cell: Float[Any, " r"]
    ) -> ContactEnd:
        """This side of the links of rows of pieces."""
        address = self.end.address_of(node)
        capacity = self.end.network.capacity_at(address)
        fragment = np.resize(self.fragment, len(node))
        parts = self.end.conductivity_parts
        return ContactEnd(
            address=address,
            fragment=device_array(fragment),
            half_cell=device_array(half_cell, self.dtype),
            per_capacity=jnp.broadcast_to(1 / capacity, half_cell.shape),
            # No face takes part.
            area_fraction=device_array(np.zeros(len(node), self.dtype)),
            conductivity_parts=None if parts is None else parts[:, fragment],
        )


class _BoundJoint(NamedTuple):
    """Links of the seam of two bodies."""

    ends: tuple[ContactEnd, ContactEnd]
    area: Float[Any, " r"]
    """[m^2]"""


def _bound_joint(joint: Joint, ends: tuple[Any, Any], size: int) -> _BoundJoint:
    """Links of each piece of a seam, with each pair of cells in depth."""
    pairs = (joint.pairs or SeamPairs.none()).padded(size, joint.name)
    columns = (
        (pairs.fragment_a, pairs.on_face_a),
        (pairs.fragment_b, pairs.on_face_b),
    )
    sides = [
        _Side(end, body=body, fragment=fragment, on_face=on_face, length=pairs.length)
        for end, body, (fragment, on_face) in zip(
            ends, joint.bodies, columns, strict=True
        )
    ]
    thickness = [side.thickness for side in sides]
    strip = array_namespace(thickness).minimum(thickness[0], thickness[1])
    first, second = (side.cells(strip) for side in sides)
    # By cells of the first, cells of the second, and pieces.
    xp = array_namespace([first, second])
    low = xp.maximum(first.low[:, None], second.low[None])
    high = xp.minimum(first.high[:, None], second.high[None])
    common = xp.maximum(high - low, 0)
    half_a = first.conductance[:, None] * common / (first.high - first.low)[:, None]
    half_b = second.conductance[None] * common / (second.high - second.low)[None]
    node_a = np.broadcast_to(first.node[:, None], common.shape)
    node_b = np.broadcast_to(second.node[None], common.shape)
    area = common * (strip * typed_array(pairs.length, sides[0].dtype))[None, None]
    return _BoundJoint(
        ends=(
            sides[0].bound(node_a.reshape(-1), half_a.reshape(-1)),
            sides[1].bound(node_b.reshape(-1), half_b.reshape(-1)),
        ),
        area=area.reshape(-1),
    )


def _joined(ends: Sequence[ContactEnd]) -> ContactEnd:
    """Ends of several joints one after the other."""
    if len(ends) == 1:
        return ends[0]
    return jax.tree.map(lambda *rows: _rows(rows), *ends)


def _rows(parts: Sequence[Any]) -> Any:
    """Arrays one after the other along their last axis."""
    return array_namespace(parts).concatenate(parts, axis=-1)
