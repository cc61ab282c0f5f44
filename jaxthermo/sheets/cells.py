"""Nodes of a sheet: connected parts of its surface within the cells of a lattice.

1. The triangles are welded, and cut until their edges are not longer than half a cell.
2. A node starts as a connected part of the surface within one cell: two sheets in one
   cell are two nodes. Small parts join a neighbour, those around a narrow tube each
   other (see `rings`), and the surface goes to the nearest node along it. Areas are
   those of the mesh, exactly.
3. Triangles with corners in three nodes form a coarse surface. Its Laplacian gives the
   conductances (see `tufted`), and what is stiff stores no heat (see `stiff_nodes`).
4. Each triangle gives each of its corners' nodes a third of its area, with its normal:
   the fragments of one face of the sheet.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, positive_length
from ..geometry.mesh import Mesh
from ..geometry.vectors import unit_vectors
from .coarse import CoarseSurface, SheetLinks, divided_surface, surface_links
from .fragments import SheetFragments, surface_fragments
from .partition import cell_nodes
from .split import split_long_edges
from .stiff_nodes import without_stiff_nodes
from .surface import Surface, proper_faces
from .tufted import with_cut_borders
from .weld import DEFAULT_WELD, WeldedMesh, open_seams, shared_area, weld_mesh


_SEAM = 1e-3
"""Distance of two borders that were perhaps one, over the diagonal of the mesh [-]."""


@dataclass(frozen=True, eq=False)
class SheetCells:
    """Nodes, links and fragments of a surface, before it has a thickness."""

    pitch: float
    """Edge of a cell [m]."""
    position: Float[np.ndarray, "n 3"]
    """Position of each node [m]: on the free border, if it has some of it."""
    area: Float[np.ndarray, "n p"]
    """Area of each node by part of the mesh [m^2]; sums to that of the mesh."""
    links: SheetLinks
    fragments: SheetFragments
    vertices: Float[np.ndarray, "v 3"]
    """Positions of the corners of the triangles [m]."""
    faces: Int[np.ndarray, "t 3"]
    """Vertices of each triangle. Two may be equal where welding collapsed a face."""
    face_area: Float[np.ndarray, " t"]
    """Area of the mesh that each triangle stands for [m^2]."""
    face_origin: Int[np.ndarray, " t"]
    """Face of the mesh that each triangle is a piece of."""
    vertex_node: Int[np.ndarray, " v"]
    """Node of each vertex."""
    border: float
    """Length of the free border [m]; 0 for a closed surface."""
    partitions: float
    """Length of the edges of three, five, .. faces [m], which join a partition."""
    open_seams: float
    """Length of the free border next to another one that was perhaps the same [m]."""
    welded: WeldedMesh
    """Faces before they were cut into triangles, and what was done to join them."""

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return len(self.position)


def sheet_cells(
    mesh: Mesh,
    *,
    pitch: float | int,
    weld: float | int | None = None,
    nodes: Literal["cells", "vertices"] = "cells",
    face_part: Int[np.ndarray, " f"] | None = None,
) -> SheetCells:
    """Divide a surface into nodes with areas, conductances and fragments.

    Args:
        mesh: any triangles: open, closed, not manifold, or not joined at all.
        pitch: edge of the cells [m].
        weld: distance within which vertices are welded, and edges are cut at vertices
            [m]; by default 1e-5 of the diagonal of the mesh.
        nodes: "cells", or "vertices" for the mesh's own vertices as nodes.
        face_part: part of the mesh that each face belongs to, from 0.

    Raises:
        InputError: for a mesh without area, or lengths that are not positive.
    """
    pitch = positive_length("Sheet(pitch=)", pitch)
    lower, upper = mesh.bounds if len(mesh.faces) else np.zeros((2, 3))
    size = float(np.linalg.norm(upper - lower))
    tolerance = DEFAULT_WELD * size
    if weld is not None:
        tolerance = positive_length("Sheet(weld=)", weld)
    if not mesh.area > 0:
        raise InputError("Sheet(mesh=): its faces have no area: give a surface")
    if face_part is None:
        face_part = np.zeros(len(mesh.faces), np.int64)
    welded = weld_mesh(mesh, tolerance)
    if not proper_faces(welded.faces).any():
        raise InputError(
            f"Sheet(weld={tolerance:g} m): no face is left of a mesh of {size:.3g} m: "
            "give a shorter length"
        )
    surface = _cut_surface(mesh, welded, face_part=face_part, pitch=pitch, nodes=nodes)
    if nodes == "cells":
        vertex_node, coarse = divided_surface(
            surface, cell_nodes(surface, lower, pitch), pitch
        )
        loose = without_stiff_nodes(
            surface_links(surface, vertex_node, coarse),
            area=np.bincount(vertex_node, surface.vertex_area),
            pitch=pitch,
        )
        vertex_node = loose.node[vertex_node]
        links = loose.links
        position = coarse.node_position[loose.earlier]
    else:
        vertex_node = np.arange(len(surface.vertices))
        coarse = CoarseSurface(
            position=surface.vertices,
            node=vertex_node,
            vertex=vertex_node,
            triangles=surface.faces,
            part=surface.part,
            is_ring=np.zeros(len(vertex_node), bool),
        )
        links = surface_links(surface, vertex_node, coarse)
        position = coarse.node_position
    fragments = surface_fragments(surface, vertex_node)
    parts = int(face_part.max(initial=0)) + 1
    area = np.bincount(
        fragments.node * parts + fragments.part, fragments.area, len(position) * parts
    )
    border = surface.vertices[surface.border]
    joined = surface.vertices[surface.partition_edges]
    return SheetCells(
        pitch=pitch,
        position=position,
        area=area.reshape(-1, parts),
        links=links,
        fragments=fragments,
        vertices=surface.vertices,
        faces=surface.faces,
        face_area=surface.area,
        face_origin=surface.origin,
        vertex_node=vertex_node,
        border=float(np.linalg.norm(border[:, 1] - border[:, 0], axis=1).sum()),
        partitions=float(np.linalg.norm(joined[:, 1] - joined[:, 0], axis=1).sum()),
        open_seams=open_seams(surface, _SEAM * size),
        welded=welded,
    )


def _cut_surface(
    mesh: Mesh,
    welded: WeldedMesh,
    *,
    face_part: Int[np.ndarray, " f"],
    pitch: float,
    nodes: str,
) -> Surface:
    if nodes == "cells":
        vertices, faces, piece = split_long_edges(
            welded.vertices, welded.faces, pitch / 2
        )
    else:
        cut = with_cut_borders(
            welded.vertices,
            faces=welded.faces,
            part=face_part[welded.face_origin],
        )
        vertices = cut.vertices
        faces = cut.faces
        piece = cut.origin
    origin = welded.face_origin[piece]
    return Surface(
        vertices=vertices,
        faces=faces,
        area=shared_area(vertices, faces=faces, parent=piece, area=welded.face_area),
        origin=origin,
        part=face_part[origin],
        normal=unit_vectors(mesh.area_vectors)[origin],
    )
