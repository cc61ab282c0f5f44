"""Intersection of two bodies on rays through the overlap of their boxes (5.3).

Faure et al. (2008) render both bodies along three axes into a box around what their
bounding boxes have in common. Every ray gives the depths at which it enters and leaves
both; where it is inside both, its two ends bound the intersection.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.raster.fragments import peel
from jaxthermo.voxels.lattice import pixel_axes


class Bounds(NamedTuple):
    """Crossings that bound the intersection on rays along one axis."""

    axis: int
    position: Float[np.ndarray, "k 3"]
    """[m]"""
    body: Int[np.ndarray, " k"]
    """Body whose surface is crossed, 0 or 1."""
    normal: Float[np.ndarray, "k 3"]
    """Outward normal of that surface."""
    enters: Bool[np.ndarray, " k"]
    """True where the ray enters the intersection."""
    cell: Float[np.ndarray, "3"]
    """Edges of the box over the number of rays along each [m]."""

    @property
    def cell_area(self) -> float:
        """Area of a pixel [m^2]."""
        return float(np.delete(self.cell, self.axis).prod())

    @property
    def volume(self) -> float:
        """Volume of the intersection, by the lengths between its bounds [m^3]."""
        depth = self.position[:, self.axis]
        return self.cell_area * float(np.where(self.enters, -depth, depth).sum())

    @property
    def is_dominant(self) -> Bool[np.ndarray, " k"]:
        """True where the normal's largest component is along the axis."""
        return np.abs(self.normal).argmax(axis=1) == self.axis

    def area_of(self, body: int) -> float:
        """Area of a body's surface that is seen best along this axis [m^2]."""
        chosen = self.is_dominant & (self.body == body)
        along = np.abs(self.normal[chosen, self.axis])
        return self.cell_area * float((1.0 / along).sum())


class Balls(NamedTuple):
    """Two balls that overlap."""

    meshes: tuple[jt.Mesh, jt.Mesh]
    radii: tuple[float, float]
    """[m]"""
    distance: float
    """Between their centres [m]."""

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of what their bounding boxes share [m]."""
        bounds = np.stack([mesh.bounds for mesh in self.meshes])
        return np.stack([bounds[:, 0].max(axis=0), bounds[:, 1].min(axis=0)])

    @property
    def cap_heights(self) -> tuple[float, float]:
        """Heights of the caps of both balls that lie in the other one [m]."""
        a, b = self.radii
        d = self.distance
        plane = (d * d + a * a - b * b) / (2 * d)
        return a - plane, b - (d - plane)

    @property
    def areas(self) -> tuple[float, float]:
        """Areas of these caps, 2 pi R h [m^2]."""
        one, other = zip(self.radii, self.cap_heights, strict=True)
        return 2 * np.pi * one[0] * one[1], 2 * np.pi * other[0] * other[1]

    @property
    def volume(self) -> float:
        """Volume of both caps, pi h^2 (R - h / 3) each [m^3]."""
        caps = zip(self.radii, self.cap_heights, strict=True)
        return float(sum(np.pi * h * h * (r - h / 3) for r, h in caps))


def two_balls(
    radii: tuple[float, float],
    offset: tuple[float, float, float],
    subdivisions: int = 6,
) -> Balls:
    """Balls of two radii [m], the second one with its centre at `offset` [m]."""
    # So fine by default that facets are no part of the error at any resolution here.
    a, b = (sphere(radius, subdivisions) for radius in radii)
    moved = jt.Mesh(b.vertices + np.array(offset), b.faces, "B")
    return Balls((a, moved), radii, float(np.linalg.norm(offset)))


def bounds_along(balls: Balls, axis: int, rays: int) -> Bounds:
    """Cast `rays` x `rays` rays along an axis of the overlap box."""
    low, high = balls.box
    row_axis, column_axis = pixel_axes(axis)
    views = [column_axis, row_axis]
    triangles = np.concatenate([mesh.triangles for mesh in balls.meshes])
    frame = triangles[..., [*views, axis]].copy()
    frame[..., :2] = (frame[..., :2] - low[views]) / (high - low)[views] * rays
    layers = peel(frame, rays, rays)
    body = (layers.triangle >= len(balls.meshes[0].faces)).astype(int)
    step = np.where(layers.entering, 1, -1)
    # Rays are sorted by pixel, then depth, and leave a closed body as often as they
    # enter it: one sum over all of them counts the bodies that each is inside of.
    within = np.stack([np.cumsum(np.where(body == b, step, 0)) for b in (0, 1)])
    kept = np.flatnonzero(within[1 - body, np.arange(len(body))] > 0)
    row, column = np.divmod(layers.pixel[kept], rays)
    cell = (high - low) / rays
    position = np.empty((len(kept), 3))
    position[:, axis] = layers.depth[kept]
    position[:, column_axis] = low[column_axis] + (column + 0.5) * cell[column_axis]
    position[:, row_axis] = low[row_axis] + (row + 0.5) * cell[row_axis]
    return Bounds(
        axis,
        position,
        body[kept],
        _normals(triangles[layers.triangle[kept]]),
        layers.entering[kept],
        cell,
    )


def _normals(triangles: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3"]:
    a, b, c = np.moveaxis(triangles, 1, 0)
    vector = np.cross(b - a, c - a)
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
