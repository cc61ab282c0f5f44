"""Meshes of sheets for tests, and temperatures of their nodes."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import Delaunay

import jaxthermo as jt
from jaxthermo.geometry.mesh import Mesh


FRONT = jt.Face("front", body=0)
BACK = jt.Face("back", body=0)

_AXES = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
_ORIGIN = np.array([0.31, -0.17, 0.23])


def turned(mesh: Mesh) -> Mesh:
    """The mesh turned and moved so that nothing is along an axis."""
    return Mesh(mesh.vertices @ _AXES + _ORIGIN, mesh.faces, mesh.name)


def turned_back(points: np.ndarray) -> np.ndarray:
    """Positions before `turned`."""
    return (points - _ORIGIN) @ _AXES.T


def flat(points: np.ndarray) -> Mesh:
    """Triangles between points of the plane z = 0, facing up."""
    faces = Delaunay(points).simplices
    corner = points[faces]
    first = corner[:, 1] - corner[:, 0]
    second = corner[:, 2] - corner[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    # Points along a border make triangles without area.
    faces = faces[np.abs(area) > 1e-12]
    area = area[np.abs(area) > 1e-12]
    faces[area < 0] = faces[area < 0][:, ::-1]
    vertices = np.column_stack([points, np.zeros(len(points))])
    return Mesh(vertices, faces.astype(int))


def plate(length: float, width: float, divisions: int = 2) -> Mesh:
    """A rectangle around the origin, facing up."""
    x = np.linspace(-length / 2, length / 2, divisions + 1)
    y = np.linspace(-width / 2, width / 2, divisions + 1)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return flat(grid.reshape(-1, 2))


def badly_meshed_strip(length: float, width: float, seed: int = 0) -> Mesh:
    """A strip from x = 0 to its length, of few, long and thin triangles."""
    draw = np.random.default_rng(seed)
    inside = draw.uniform(size=(40, 2)) * [length, width]
    along = draw.uniform(size=(12, 1)) * length
    lower = np.hstack([along[:6], np.zeros((6, 1))])
    upper = np.hstack([along[6:], np.full((6, 1), width)])
    corners = np.array([[0, 0], [length, 0], [0, width], [length, width]])
    return flat(np.concatenate([corners, lower, upper, inside]))


def open_cylinder(radius: float, height: float, facets: int) -> Mesh:
    """A cylinder about z without ends, of flat facets, facing outwards."""
    angle = 2 * np.pi * np.arange(facets) / facets
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    lower = np.column_stack([ring, np.full(facets, -height / 2)])
    upper = np.column_stack([ring, np.full(facets, height / 2)])
    first = np.arange(facets)
    second = (first + 1) % facets
    faces = np.concatenate(
        [
            np.stack([first, second, second + facets], axis=1),
            np.stack([first, second + facets, first + facets], axis=1),
        ]
    )
    return Mesh(np.concatenate([lower, upper]), faces)


def disc(radius: float, rings: int = 4, sectors: int = 96) -> Mesh:
    """A flat disc around the origin, facing up."""
    angle = 2 * np.pi * np.arange(sectors) / sectors
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radii = radius * np.arange(1, rings + 1) / rings
    points = (radii[:, None, None] * circle).reshape(-1, 2)
    return flat(np.concatenate([np.zeros((1, 2)), points]))


def strips_at_an_edge(length: float, width: float, count: int = 3) -> Mesh:
    """Strips that meet in the edge x = y = 0, from z = 0 to their width."""
    edge = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, width]])
    vertices = [edge]
    faces = []
    for strip in range(count):
        angle = 2 * np.pi * strip / count
        outward = length * np.array([np.cos(angle), np.sin(angle), 0.0])
        vertices.append(edge + outward)
        far = 2 + 2 * strip
        faces += [[0, far, far + 1], [0, far + 1, 1]]
    return Mesh(np.concatenate(vertices), np.array(faces))


class NodeReading(NamedTuple):
    """Temperatures of one face of a sheet, at its nodes."""

    position: np.ndarray
    """Positions of the nodes [m]."""
    temperature: np.ndarray
    """Mean over the fragments of each node by area [K]."""
    area: np.ndarray
    """Area of each node [m^2]."""

    def rms(self, exact: np.ndarray) -> float:
        """Root of the mean square of the deviation from the exact values, by area."""
        deviation = (self.temperature - exact) ** 2
        return float(np.sqrt(np.average(deviation, weights=self.area)))


def at_nodes(structure: Any, temperature: Any, face: int = 0) -> NodeReading:
    """Surface temperatures of a body's fragments, by the nodes of a face."""
    grid = structure.grid
    of_face = np.flatnonzero(np.asarray(grid.fragment_face) == face)
    node = np.asarray(structure.fragment_node())[of_face]
    area = np.asarray(grid.fragment_area)[of_face]
    number, index = np.unique(node, return_inverse=True)
    total = np.bincount(index, area)
    value = np.asarray(temperature, float)[of_face]
    return NodeReading(
        position=np.asarray(structure.nodes().location)[number],
        temperature=np.bincount(index, area * value) / total,
        area=total,
    )


def fragments_of(structure: Any, is_node: np.ndarray) -> jt.FragmentMask:
    """Select all fragments, of both faces, of the flagged nodes."""
    return jt.FragmentMask(is_node[np.asarray(structure.fragment_node())])
