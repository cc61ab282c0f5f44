"""What a camera sees of a solved scene: geometry only, once for all frames."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..physics.radiation.source import AbstractSource
from ..physics.term import AbstractTerm
from ..raster.layers import peel
from ..scene.solved_surface import SolvedSurface
from .camera import AbstractCamera
from .smooth import PixelWeights, block_weights, smooth_weights


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


def winding_number(
    triangles: Float[np.ndarray, "f 3 3"], point: Float[np.ndarray, "3"]
) -> float:
    """How often closed triangles wind around a point: 1 inside, 0 outside.

    The sum of the signed solid angles over 4 pi (van Oosterom and Strackee 1983).
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dot = lambda u, v: np.einsum("ij,ij->i", u, v)
    below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return float(np.arctan2(volume, below).sum() / (2 * np.pi))


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
