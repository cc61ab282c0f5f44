"""Meshes of sheets, and steady temperatures on their nodes by a direct solve."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve

from jaxthermo.geometry.mesh import Mesh, joined
from jaxthermo.sheets.cells import SheetCells


def rotation(seed: int) -> Float[np.ndarray, "3 3"]:
    """A turn of space by chance."""
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    matrix[:, 0] *= np.linalg.det(matrix)
    return matrix


def turned(mesh: Mesh, matrix: Float[np.ndarray, "3 3"]) -> Mesh:
    """The mesh after a turn: `points @ matrix` undoes it."""
    return replace(mesh, vertices=mesh.vertices @ matrix.T)


def grid_plate(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " m"]) -> Mesh:
    """Rectangle in the plane z = 0, with vertices at all x and y."""
    points = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    first = (np.arange(len(x) - 1)[:, None] * len(y) + np.arange(len(y) - 1)).ravel()
    right = first + len(y)
    lower = np.stack([first, right, right + 1], axis=1)
    upper = np.stack([first, right + 1, first + 1], axis=1)
    return Mesh(points, np.concatenate([lower, upper]))


def uneven_strip(length: float, width: float, seed: int = 3) -> Mesh:
    """Rectangle in the plane z = 0 of needles and uneven triangles."""
    rng = np.random.default_rng(seed)
    x = np.sort(np.concatenate([[0, length], rng.uniform(0, length, 9)]))
    y = np.sort(np.concatenate([[0, width], rng.uniform(0, width, 2)]))
    return grid_plate(x, y)


def open_cylinder(radius: float, height: float, sides: int) -> Mesh:
    """Prism along z without ends, two triangles a side."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    points = np.concatenate(
        [np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height)]
    )
    here = np.arange(sides)
    right = (here + 1) % sides
    lower = np.stack([here, right, right + sides], axis=1)
    upper = np.stack([here, right + sides, here + sides], axis=1)
    return Mesh(points, np.concatenate([lower, upper]))


def meshes_together(*meshes: Mesh) -> Mesh:
    """All faces of several meshes, not welded."""
    return Mesh(*joined([(mesh.vertices, mesh.faces) for mesh in meshes]))


def polygon_soup(seed: int = 0) -> Mesh:
    """Open panels of 65 m^2 as CAD exports and games have them, 3 600 faces.

    Panels with T-junctions, ribs, needles, boxes of unwelded faces, thin rods, faces
    twice and faces without area; vertices off by up to 0.3 um.
    """
    rng = np.random.default_rng(seed)
    size = np.array([4.4, 1.6, 1.25])
    meshes = []

    def add_panel(origin: Any, u: Any, v: Any, cells: tuple[int, int]) -> None:
        plate = grid_plate(
            np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1)
        )
        frame = np.stack([u, v, [0, 0, 0]])
        meshes.append(replace(plate, vertices=plate.vertices @ frame + origin))

    length, width, height = np.diag(size)
    corner = np.zeros(3)
    add_panel(corner, length, width, (7, 3))
    add_panel(height, length, width, (5, 4))
    add_panel(corner, length, height, (9, 2))
    add_panel(width, length, height, (11, 1))
    add_panel(corner, width, height, (4, 3))
    add_panel(length, width, height, (3, 5))
    for fraction in np.linspace(0.1, 0.9, 9):
        add_panel(fraction * length, width, height / 4, (int(rng.integers(1, 6)), 1))
    for _ in range(40):
        u, v = rotation(int(rng.integers(1 << 30)))[:2]
        u = u * rng.uniform(0.5, 1.5)
        v = v * rng.uniform(0.005, 0.03)
        add_panel(rng.uniform(0, 1, 3) * size, u, v, (int(rng.integers(1, 4)), 1))
    for index in range(80):
        solid = _solid(index, rng)
        meshes.append(turned(solid, rotation(index)).moved(rng.uniform(0, 1, 3) * size))
    mesh = meshes_together(*meshes)
    doubled = mesh.faces[rng.choice(len(mesh.faces), 100, replace=False)]
    doubled[:50] = doubled[:50, ::-1]
    flat = np.stack(
        [mesh.faces[:20, 0], mesh.faces[:20, 0], mesh.faces[:20, 1]], axis=1
    )
    noise = rng.uniform(-3e-7, 3e-7, mesh.vertices.shape)
    return Mesh(mesh.vertices + noise, np.concatenate([mesh.faces, doubled, flat]))


def _solid(index: int, rng: np.random.Generator) -> Mesh:
    """A box of twelve unwelded faces, or every fourth time a rod."""
    if index % 4 == 0:
        return open_cylinder(0.015, 1.2, sides=60)
    box_size = rng.uniform(0.05, 0.45, 3)
    meshes = []
    for axis in range(3):
        plate = grid_plate(np.array([0, 1.0]), np.array([0, 1.0]))
        points = np.roll(plate.vertices, axis, axis=1)
        for level in (0.0, 1.0):
            side = points.copy()
            side[:, (2 + axis) % 3] = level
            triangles = side[plate.faces].reshape(-1, 3) * box_size
            meshes.append(Mesh(triangles, np.arange(6).reshape(2, 3)))
    return meshes_together(*meshes)


def conduction(cells: SheetCells) -> Any:
    """Matrix of the conductances of a sheet, over conductivity times thickness [-]."""
    links = cells.links
    count = cells.node_count
    pairs = coo_array((links.weight, (links.src, links.dst)), shape=(count, count))
    weights = (pairs + pairs.T).tocsr()
    return (diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights).tocsr()


def steady(
    matrix: Any,
    heat: Float[np.ndarray, " n"],
    *,
    held: Int[np.ndarray, " k"],
    values: Float[np.ndarray, " k"],
) -> Float[np.ndarray, " n"]:
    """Temperatures with some of them held."""
    free = np.setdiff1d(np.arange(len(heat)), held)
    temperature = np.zeros(len(heat))
    temperature[held] = values
    rows = matrix[free]
    load = heat[free] - rows[:, held] @ values
    temperature[free] = np.asarray(spsolve(rows[:, free].tocsc(), load))
    return temperature


def orders(errors: list[float]) -> list[float]:
    """Observed orders of errors at steps that are halved."""
    return [float(np.log2(coarse / fine)) for coarse, fine in pairwise(errors)]
