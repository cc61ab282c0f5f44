"""What a camera sees of a solved scene: geometry only, once for all frames."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..geometry.mesh import winding_number
from ..physics.radiation.source import AbstractSource
from ..physics.term import AbstractTerm
from ..raster.layers import peel
from ..scene.solved_surface import BodyGeometry, SolvedSurface
from .camera import AbstractCamera


REACH = 2.0
"""Radius of the weights, in voxels: 1.4 holds at least one fragment of any surface."""

CHUNK = 65536


class PixelWeights(NamedTuple):
    """value[pixel] = sum of weight * value[fragment] over the entries."""

    pixel: Int[np.ndarray, " w"]
    """Sorted."""
    fragment: Int[np.ndarray, " w"]
    weight: Float[np.ndarray, " w"]


class _Cells:
    """Fragments sorted into cubic cells of the weights' radius."""

    def __init__(self, position: np.ndarray, radius: float):
        self.radius = radius
        self.low = position.min(0) - 1.5 * radius
        cell = self._cell(position)
        self.size = cell.max(0) + 3
        key = self._key(cell)
        self.order = np.argsort(key, kind="stable")
        self.keys, self.start, self.count = np.unique(
            key[self.order], return_index=True, return_counts=True
        )

    def _cell(self, points: np.ndarray) -> np.ndarray:
        return np.floor((points - self.low) / self.radius).astype(np.int64)

    def _key(self, cell: np.ndarray) -> np.ndarray:
        return (cell[..., 0] * self.size[1] + cell[..., 1]) * self.size[2] + cell[
            ..., 2
        ]

    def pairs(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every (point, fragment) in the same or neighbouring cells."""
        reach = np.arange(-1, 2)
        offsets = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), -1)
        cell = self._cell(points)[:, None] + offsets.reshape(1, -1, 3)
        within = ((cell >= 0) & (cell < self.size)).all(-1)
        key = np.where(within, self._key(cell), -1).ravel()
        slot = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
        count = np.where(self.keys[slot] == key, self.count[slot], 0)
        owner = np.repeat(np.arange(len(points)).repeat(27), count)
        first = np.repeat(self.start[slot] - np.cumsum(count) + count, count)
        return owner, self.order[first + np.arange(len(first))]


def _kernel(points, normals, geometry, owner, fragment, radius):
    apart = points[owner] - geometry.fragment_position[fragment]
    share = np.einsum("ij,ij->i", apart, apart) / radius**2
    cosine = np.einsum("ij,ij->i", normals[owner], geometry.fragment_normal[fragment])
    near = np.maximum(1 - share, 0) ** 2
    return near * np.maximum(cosine, 0) ** 2 * geometry.fragment_area[fragment]


def nearest_fragments(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> Int[np.ndarray, " p"]:
    """The nearest fragment of each point, whatever its normal."""
    found = np.full(len(points), -1, np.int64)
    radius = geometry.pitch
    while (missing := np.flatnonzero(found < 0)).size:
        radius *= 2
        cells = _Cells(geometry.fragment_position, radius)
        for part in np.array_split(missing, len(missing) // CHUNK + 1):
            owner, fragment = cells.pairs(points[part])
            away = points[part][owner] - geometry.fragment_position[fragment]
            distance = np.einsum("ij,ij->i", away, away)
            order = np.lexsort([distance, owner])
            owners, first = np.unique(owner[order], return_index=True)
            found[part[owners]] = fragment[order][first]
    return found


def smooth_weights(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    geometry: BodyGeometry,
) -> PixelWeights:
    """Weights of the fragments around each point; they sum to one.

    Args:
        points: on the body's surface, in its own frame [m].
        normals: outward there.
        geometry: the body.
    """
    radius = REACH * geometry.pitch
    cells = _Cells(geometry.fragment_position, radius)
    parts = []
    for first in range(0, len(points), CHUNK):
        here = slice(first, first + CHUNK)
        owner, fragment = cells.pairs(points[here])
        weight = _kernel(points[here], normals[here], geometry, owner, fragment, radius)
        kept = weight > 0
        parts.append((owner[kept] + first, fragment[kept], weight[kept]))
    pixel, fragment, weight = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    total = np.bincount(pixel, weights=weight, minlength=len(points))
    alone = np.flatnonzero(total == 0)
    if len(alone):
        # Parts too thin to have fragments of their own show the nearest ones'.
        pixel = np.concatenate([pixel, alone])
        fragment = np.concatenate(
            [fragment, nearest_fragments(points[alone], geometry)]
        )
        weight = np.concatenate([weight, np.ones(len(alone))])
        order = np.argsort(pixel, kind="stable")
        pixel, fragment, weight = pixel[order], fragment[order], weight[order]
        total[alone] = 1.0
    return PixelWeights(pixel, fragment, weight / total[pixel])


def block_weights(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> PixelWeights:
    """The nearest fragment alone: shows the voxels as they are."""
    return PixelWeights(
        np.arange(len(points)),
        nearest_fragments(points, geometry),
        np.ones(len(points)),
    )


@dataclass(frozen=True, eq=False)
class View:
    """Everything per pixel that does not change with time; p pixels show a body."""

    camera: AbstractCamera
    pixel: Int[np.ndarray, " p"]
    """Number of each pixel that shows a body, rows first."""
    body: Int[np.ndarray, " p"]
    depth: Float[np.ndarray, " p"]
    """Along the optical axis [m]."""
    normal: Float[np.ndarray, "p 3"]
    """World, outward."""
    weights: PixelWeights
    """From fragments of all bodies, one after the other."""
    exposure: tuple[tuple[int, Float[np.ndarray, " p"]], ...]
    """For each source (its number among the terms): cosine times lit share."""


def _check_outside(surfaces: tuple[SolvedSurface, ...], camera: AbstractCamera):
    for index, surface in enumerate(surfaces):
        triangles = surface.geometry.triangles
        if abs(winding_number(triangles, np.asarray(camera.position, float))) > 0.5:
            raise InputError(
                f"camera: position {camera.position} is inside body {index}; "
                "move it out, or leave the camera out to have it placed"
            )


def standing(
    surfaces: tuple[SolvedSurface, ...], terms: tuple[AbstractTerm, ...], time: float
) -> tuple[tuple[SolvedSurface, ...], tuple[AbstractTerm, ...]]:
    """Bodies and sources where they stand at a moment [s]."""
    return tuple(s.at(time) for s in surfaces), tuple(t.at(time) for t in terms)


def look(
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    camera: AbstractCamera,
    smooth: bool = True,
) -> View:
    """Find what each pixel shows and how to read a temperature there.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    _check_outside(surfaces, camera)
    world = [s.geometry.triangles for s in surfaces]
    triangles = np.concatenate(world)
    corners, parent = camera.to_raster(triangles)
    layers = peel(*_on_screen(corners, camera))
    front = layers.layer == 0
    pixel, key = layers.pixel[front], layers.depth[front]
    if not len(pixel):
        raise InputError(
            f"camera: at {camera.position} it sees no body; "
            "turn it round, or leave the camera out to have it placed"
        )
    hit = parent[_kept(corners, camera)][layers.triangle[front]]
    point, depth = camera.points(pixel, key)
    normal = _normals(triangles[hit])
    body = np.repeat(np.arange(len(world)), [len(w) for w in world])[hit]
    pitch = min(s.geometry.pitch for s in surfaces)
    exposure = tuple(
        (number, term.exposure(triangles, point, normal, pitch))
        for number, term in enumerate(terms)
        if isinstance(term, AbstractSource)
    )
    weights = _all_weights(surfaces, body, point, normal, smooth)
    return View(camera, pixel, body, depth, normal, weights, exposure)


def _kept(corners: np.ndarray, camera: AbstractCamera) -> np.ndarray:
    """Triangles whose bounding box meets the image."""
    low, high = corners[..., :2].min(1), corners[..., :2].max(1)
    size = np.array(camera.size)
    return np.flatnonzero(((high > 0) & (low < size)).all(1))


def _on_screen(corners: np.ndarray, camera: AbstractCamera):
    return corners[_kept(corners, camera)], *camera.size


def _normals(triangles: Float[np.ndarray, "p 3 3"]) -> Float[np.ndarray, "p 3"]:
    a, b, c = np.moveaxis(triangles, 1, 0)
    vector = np.cross(b - a, c - a)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return vector / np.where(length > 0, length, 1)


def _all_weights(surfaces, body, point, normal, smooth) -> PixelWeights:
    """Weights of every body's pixels, in terms of all bodies' fragments."""
    parts, first = [], 0
    for index, surface in enumerate(surfaces):
        here = np.flatnonzero(body == index)
        geometry = surface.geometry
        if len(here):
            own = geometry.placed.unplace(point[here])
            turned = geometry.placed.unturn(normal[here])
            found = (
                smooth_weights(own, turned, geometry)
                if smooth
                else block_weights(own, geometry)
            )
            parts.append((here[found.pixel], found.fragment + first, found.weight))
        first += len(geometry.fragment_area)
    pixel, fragment, weight = (np.concatenate(c) for c in zip(*parts, strict=True))
    order = np.argsort(pixel, kind="stable")
    return PixelWeights(pixel[order], fragment[order], weight[order])
