"""Points that stand for the surfaces in a browser, coloured by temperature.

A browser takes new colours of points at 3 bytes each and shows them as they are. A mesh
it takes as a whole, four times the bytes, is blank until it has read it, and brightens
the colours as if they were lit.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.sparse import csr_array

from ..arrays import consecutive, flat_index
from ..choices import Palette
from ..geometry.mesh import Mesh
from ..geometry.sample import mesh_sample
from ..geometry.vectors import row_dot, unit_vector
from ..image.colour.palette import apply_palette
from ..image.surface.facets import smooth_normals
from ..image.surface.shapes import Bodies, ShapePoints
from ..image.surface.weights import smooth_weights
from ..scene.scene import BodyGeometry, SolvedSurface


_POINTS = 90_000
"""Approximate number of cells of the surfaces; each holds a point."""

# Random points per cell: with four, one cell in 50 stays empty.
_PER_CELL = 4
# Diameter of a point over the edge of a cell: neighbours in opposite corners overlap.
_OVERLAP = 2.0


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on the surfaces of bodies, with their weights of the fragments."""

    position: tuple[Float[np.ndarray, "_ 3"], ...]
    """Points of each body, in its own frame [m]."""
    weights: csr_array
    """Weights [p, s] of the fragments of all bodies, as in an image."""
    diameter: float
    """Diameter at which points cover the surface [m]."""

    @property
    def rows(self) -> list[slice]:
        """Rows of each body's points among all points."""
        return consecutive(len(points) for points in self.position)

    def temperature(self, fragments: Float[np.ndarray, " s"]) -> Float[np.ndarray, "p"]:
        """Temperature of every point [K], from those of the fragments."""
        return self.weights @ fragments.astype(np.float32, copy=False)

    def body_of(self, point: int) -> int:
        """Number of the body that a point is on."""
        return next(n for n, rows in enumerate(self.rows) if point < rows.stop)


def surface_points(
    surfaces: tuple[SolvedSurface, ...], count: int = _POINTS
) -> SurfacePoints:
    """Spread about `count` points over the surfaces of all bodies."""
    geometries = [surface.geometry for surface in surfaces]
    area = [float(geometry.fragment_area.sum()) for geometry in geometries]
    edge = float(np.sqrt(sum(area) / count))
    position = []
    parts = []
    for body_area, geometry in zip(area, geometries, strict=True):
        random = max(1000, round(_PER_CELL * count * body_area / sum(area)))
        points, face = _one_per_cell(geometry, edge, random)
        normal = smooth_normals(
            geometry.vertices, faces=geometry.faces, face=face, points=points
        )
        if geometry.is_two_sided:
            points = np.concatenate([points, points])
            normal = np.concatenate([normal, -normal])
        parts.append((points, normal))
        if geometry.is_two_sided:
            # Each side in front of the other one.
            points = points + edge / 2 * normal
        position.append(points.astype(np.float32))
    bodies = Bodies.of(surfaces)
    body = np.repeat(np.arange(len(parts)), [len(points) for points in position])
    points, normal = map(np.concatenate, zip(*parts, strict=True))
    weights = smooth_weights(
        ShapePoints(bodies.shape[body], points, normal), bodies.shapes
    )
    single = csr_array(bodies.of_fragments(weights, body), dtype=np.float32)
    return SurfacePoints(tuple(position), single, _OVERLAP * edge)


def _one_per_cell(
    geometry: BodyGeometry, edge: float, random: int
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, " p"]]:
    sample = mesh_sample(Mesh(geometry.vertices, geometry.faces), random)
    cell = np.floor(sample.position / edge).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    key = flat_index(cell, tuple(size.tolist()))
    _, first = np.unique(key, return_index=True)
    return sample.position[first], sample.face[first]


def colours(
    kelvin: Float[np.ndarray, " p"], low: float, high: float, palette: Palette
) -> UInt8[np.ndarray, "p 3"]:
    """Colours of temperatures on a scale [K], as sRGB."""
    return apply_palette(kelvin[None], low=low, high=high, name=palette)[0]


def point_on_ray(
    world: Float[np.ndarray, "p 3"],
    origin: Float[np.ndarray, " 3"],
    direction: Float[np.ndarray, " 3"],
    radius: float,
) -> int | None:
    """Index of the first point that a ray passes within a radius [m]; None for none."""
    ahead = unit_vector(direction)
    offset = world - origin
    depth = offset @ ahead
    away = row_dot(offset, offset) - depth**2
    near = np.flatnonzero((away < radius**2) & (depth > 0))
    return int(near[depth[near].argmin()]) if len(near) else None
