"""Surfaces of a solution as VTU and GLB files, with values at their vertices."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from ...arrays import consecutive
from ...choices import Palette
from ...errors import InputError
from ...geometry.mesh import joined
from ...geometry.refine import refine_edges
from ...geometry.vectors import unit_vectors
from ...integrate.run.abstract_solution import AbstractSolution
from ...memo.found import found
from ...scene.scene import BodyGeometry, SolvedSurface
from ...scene.surface_outputs import SURFACE_OUTPUTS
from ..colour.palette import apply_palette
from ..surface.facets import corner_normals
from ..surface.shapes import ShapePoints, Shapes
from ..surface.weights import smooth_weights
from .gltf import GltfMesh, linear_colours, write_meshes
from .vtu import write_triangles


# Longest edge [voxels]: the weights of a point have this radius.
_LONGEST_EDGE = 2.0


class _VertexMesh(NamedTuple):
    """Triangles that are about as fine as the voxels, in the frame of their body.

    A vertex on an edge of more than 40 degrees exists once for each side: the sides of
    a box have their own temperatures and normals.
    """

    vertices: Float[np.ndarray, "v 3"]
    """In the frame of the body [m]."""
    normals: Float[np.ndarray, "v 3"]
    """Outward, of the smooth surface that the mesh approximates."""
    faces: Int[np.ndarray, "f 3"]
    parent: Int[np.ndarray, " f"]
    """Number of the body's triangle that each face belongs to."""
    weights: csr_array
    """Weights [v, s] of the body's fragments at each vertex, those of a pixel there."""
    back_weights: csr_array | None = None
    """Weights at the back of a thin wall; None for a solid."""

    def values(self, fragments: Float[np.ndarray, " s"]) -> Float[np.ndarray, " v"]:
        """Values at the vertices, interpolated as by an image."""
        return (self.weights @ fragments).astype(np.float32)

    def back_values(
        self, fragments: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, " v"]:
        """Values at the back of a thin wall; those at the vertices of a solid."""
        if self.back_weights is None:
            return self.values(fragments)
        return (self.back_weights @ fragments).astype(np.float32)


def _vertex_mesh(
    geometry: BodyGeometry, longest_edge: float | None = None
) -> _VertexMesh:
    """Mesh of a body with the weights of its vertices.

    Args:
        geometry: of the body.
        longest_edge: length to which edges are cut [m]; two voxels if None.
    """
    creased = corner_normals(geometry.vertices, geometry.faces)
    columns = np.concatenate(
        [geometry.vertices[creased.vertex], creased.normals], axis=1
    )
    longest = longest_edge or _LONGEST_EDGE * geometry.pitch
    columns, faces, parent = refine_edges(columns, creased.faces, longest)
    vertices = columns[:, :3]
    normals = columns[:, 3:]
    normals = unit_vectors(normals)
    shapes = Shapes.of((geometry,))
    front = ShapePoints.of_one(vertices, normals)
    back_weights = None
    if geometry.is_two_sided:
        back = front._replace(normal=-normals)
        back_weights = smooth_weights(back, shapes)
    return _VertexMesh(
        vertices=vertices,
        normals=normals,
        faces=faces,
        parent=parent,
        weights=smooth_weights(front, shapes),
        back_weights=back_weights,
    )


_UNITS = {"heat_flux": "W_m2", "heat_transfer_coefficient": "W_m2K"}
# Smallest range of a colour scale [K].
_MIN_RANGE = 0.1


def body_rows(solution: AbstractSolution) -> list[slice]:
    """Fragments of every body in arrays of all of them."""
    return consecutive(len(s.geometry.fragment_area) for s in solution.surfaces)


def temperature_scale(
    solution: AbstractSolution,
    indices: Sequence[int],
    low: float | None = None,
    high: float | None = None,
) -> tuple[float, float]:
    """Ends of a colour scale [K]: `low` and `high`, else the extremes at some times.

    Raises:
        InputError: for ends that are not in order, or temperatures that are not finite.
    """
    seen = [np.asarray(solution.surface_temperature[k], float) for k in indices]
    coldest = min(float(kelvin.min()) for kelvin in seen) if low is None else float(low)
    hottest = (
        max(float(kelvin.max()) for kelvin in seen) if high is None else float(high)
    )
    if high is None:
        hottest = max(hottest, coldest + _MIN_RANGE)
    elif low is None:
        coldest = min(coldest, hottest - _MIN_RANGE)
    if not -np.inf < coldest < hottest < np.inf:
        raise InputError(
            f"the colour scale from {coldest:g} to {hottest:g} K: give finite "
            "temperatures, the lower one first"
        )
    return coldest, hottest


def write_vtu(
    path: str | Path,
    solution: AbstractSolution,
    index: int = -1,
    *,
    names: Sequence[str] = (),
) -> None:
    """Write the surfaces of all bodies at a saved time for ParaView.

    Points, in the world [m], have `temperature_K`, `emissivity`, `Normals`, and the
    `surface_outputs` of the scene; cells have the number of their `body`, which the
    field data have under its name. Temperatures are those of an image at the same
    points; edges are at most two voxels long. A thin wall is there once, with the
    values of its front; if there is one, `_back` before the unit marks those of the
    back, `temperature_back_K`, which for solids are equal.

    Args:
        path: of the file.
        solution: from `simulate` or `steady`.
        index: index of the saved time.
        names: of the bodies; their own, or their numbers, if none are given.

    Raises:
        InputError: if the file cannot be written.
    """
    time = float(solution.times[index])
    meshes = [_mesh(s.geometry) for s in solution.surfaces]
    poses = [s.geometry.pose.at(time) for s in solution.surfaces]
    pairs = list(zip(meshes, poses, strict=True))
    body = [np.full(len(m.faces), n, np.int32) for n, m in enumerate(meshes)]
    values = {}
    has_back = any(mesh.back_weights is not None for mesh in meshes)
    for field in _fields(solution, index):
        by_body = list(zip(meshes, field.of_body, strict=True))
        front = [mesh.values(fragments) for mesh, fragments in by_body]
        values[field.name + field.unit] = np.concatenate(front)
        if has_back:
            back = [mesh.back_values(fragments) for mesh, fragments in by_body]
            values[f"{field.name}_back{field.unit}"] = np.concatenate(back)
    normals = [pose.rotate(mesh.normals) for mesh, pose in pairs]
    values["Normals"] = np.concatenate(normals).astype(np.float32)
    world = [(pose.to_world(mesh.vertices), mesh.faces) for mesh, pose in pairs]
    points, faces = joined(world)
    cells = {"body": np.concatenate(body)}
    write_triangles(
        path,
        points=points,
        faces=faces,
        point_data=values,
        cell_data=cells,
        time=time,
        names=names or _names(solution),
    )


def _names(solution: AbstractSolution) -> list[str]:
    """Names of the bodies, or their numbers where they have none."""
    bodies = [surface.geometry.name for surface in solution.surfaces]
    return [name or f"body{number}" for number, name in enumerate(bodies)]


def _mesh(geometry: BodyGeometry) -> _VertexMesh:
    """Mesh of a body, the same at all times and poses."""
    arrays = geometry.vertices, geometry.faces, geometry.fragment_position
    key = "vertex_mesh", float(geometry.pitch)
    return found(arrays, key, lambda: _vertex_mesh(geometry))


class _Field(NamedTuple):
    """A quantity on the surfaces."""

    name: str
    unit: str
    """With an underscore before it; empty for a number."""
    of_body: list[Float[np.ndarray, " _"]]
    """Values of the fragments of every body."""


def _fields(solution: AbstractSolution, index: int) -> Iterator[_Field]:
    """Quantities at a saved time."""
    rows = body_rows(solution)

    def split(values: Any) -> list[Any]:
        return [np.asarray(values, float)[fragments] for fragments in rows]

    yield _Field("temperature", "_K", split(solution.surface_temperature[index]))
    emissivity = [_emissivity(surface) for surface in solution.surfaces]
    yield _Field("emissivity", "", emissivity)
    for name in SURFACE_OUTPUTS:
        output = getattr(solution, name)
        if output is not None:
            yield _Field(name, f"_{_UNITS[name]}", split(output[index]))


def _emissivity(surface: SolvedSurface) -> Float[np.ndarray, " s"]:
    shape = surface.geometry.fragment_area.shape
    return np.broadcast_to(np.asarray(surface.emissivity, float), shape)


def write_glb(
    path: str | Path,
    solution: AbstractSolution,
    index: int = -1,
    *,
    low: float | None = None,
    high: float | None = None,
    palette: Palette = "iron",
    names: Sequence[str] = (),
) -> None:
    """Write the bodies at a saved time as a GLB file, for Blender and viewers.

    Vertices have `_TEMPERATURE` [K] and the palette's colours, whose scale is in the
    scene's extras. Temperatures are those of an image at the same points. A thin wall
    has triangles of its front, and after them the same ones of its back, wound the
    other way round: a viewer shows those that face it.

    Args:
        path: of the file.
        solution: from `simulate` or `steady`.
        index: index of the saved time.
        low: temperature of the first colour [K]; the least if None.
        high: temperature of the last colour [K]; the largest if None.
        palette: name of the palette.
        names: of the bodies; their own, or their numbers, if none are given.

    Raises:
        InputError: for an unknown palette or a scale that is not in order, or if the
            file cannot be written.
    """
    low, high = temperature_scale(solution, indices=[index], low=low, high=high)
    time = float(solution.times[index])
    kelvin = np.asarray(solution.surface_temperature[index], float)
    drawn = []
    names = names or _names(solution)
    bodies = zip(names, solution.surfaces, body_rows(solution), strict=True)
    for name, surface, rows in bodies:
        mesh = _mesh(surface.geometry)
        vertices = mesh.vertices
        normals = mesh.normals
        faces = mesh.faces
        values = mesh.values(kelvin[rows])
        if surface.geometry.is_two_sided:
            faces = np.concatenate([faces, len(vertices) + faces[:, ::-1]])
            vertices = np.concatenate([vertices, vertices])
            normals = np.concatenate([normals, -normals])
            values = np.append(values, mesh.back_values(kelvin[rows]))
        colours = apply_palette(values[None], low=low, high=high, name=palette)[0]
        attributes = {
            "POSITION": vertices,
            "NORMAL": normals,
            "COLOR_0": linear_colours(colours),
            "_TEMPERATURE": values,
        }
        pose = surface.geometry.pose.at(time)
        drawn.append(GltfMesh(name=name, pose=pose, faces=faces, attributes=attributes))
    notes = {"time_s": time, "palette": palette, "low_K": low, "high_K": high}
    notes["units"] = "POSITION: m; _TEMPERATURE: K; COLOR_0: linear RGB of the palette"
    write_meshes(path, drawn, notes)
