"""Frames as a function of the camera's pose, linear about one at which they are exact.

A pixel shows the point x where its ray o + d z meets a triangle with the normal n. In
another pose the ray is another one, and meets the plane of the triangle elsewhere:

    dx = do + z dd - d n.(do + z dd) / n.d

The temperature there follows from the weights of the fragments (`fragment_cells`),
whose slopes along the surface are exact, with those of the interpolated normal. The
weights (1 - r^2/R^2)^2 and the squared cosines go to 0 with their slopes, so that the
derivative is continuous where a fragment comes within the radius, in each triangle;
over an edge of the mesh the depth keeps its value and changes its slope. Points are
where the rays meet the planes: those of the raster, with its corners snapped to 1/1024
pixel, move in steps. Pixels at an
outline, where the surface ends or another begins, have no derivative: `outline`.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.linalg import expm, expm_frechet
from scipy.sparse import csr_array

from ..scene.scene import SolvedSurface
from .background import Background
from .camera import AbstractCamera
from .facets import normal_slopes
from .moving_weights import MovingWeights
from .pose import POSE_SIZE, moved_camera
from .view import SMOOTHING_RADIUS, View, all_weights, in_bodies
from .visible import VisiblePoints, visible_points, world_meshes


class LinearizedView(eqx.Module):
    """Chosen pixels of a camera near one pose; arrays of one shape for all poses."""

    pose: Float[Array, "6"]
    """Pose at which it is exact: rotation vector [rad], translation [m], see `pose`."""
    row: Int[Array, " n"]
    fragment: Int[Array, " n"]
    weight: Float[Array, " n"]
    slope: Float[Array, "2 n"]
    """Those of `MovingWeights`."""
    motion: Float[Array, "p 2 6"]
    """Distance that each point moves along both directions, by each number of the pose
    [m/rad, 1]."""
    seen: Float[Array, " p"]
    """1 where the pixel shows a body, else 0."""

    def at(self, pose: Float[Array, "6"], camera: AbstractCamera) -> View:
        """View of the pixels side by side in one row, for `draw`.

        Its depths, normals and numbers of bodies are not those of the surface.
        """
        change = pose - self.pose
        shift = self.motion @ change
        sums = self.row, self.fragment, self.weight, self.slope
        count = len(self.seen)
        return View(
            camera=replace(camera, width=count, height=1),
            pixel=np.arange(count),
            body=np.zeros(count, int),
            depth=np.zeros(count),
            normal=np.zeros((count, 3)),
            weights=MovingWeights(*sums, shift),
            background=Background(None, ()),
        )


def linearize_view(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    pose: Float[np.ndarray, "6"],
    pixels: Int[np.ndarray, " p"],
    size: int | None = None,
    dtype: np.typing.DTypeLike = float,
) -> LinearizedView:
    """Render the surface points of some pixels of a camera in a pose, with slopes.

    Args:
        surfaces: of the bodies.
        camera: as given, to which the pose is relative.
        pose: rotation vector [rad] and translation [m].
        pixels: indices, rows first.
        size: number of weights to have room for; as many as there are if None.
        dtype: of the arrays.

    Raises:
        InputError: if the camera is inside a body or sees none.
        OverflowError: if there are more weights than `size`.
    """
    moved = moved_camera(camera, pose)
    found, place = _chosen(surfaces, moved, pixels)
    flat, along = _tangents(surfaces, found)
    found = _on_planes(surfaces, camera=moved, found=found, flat=flat)
    local, normal = in_bodies(surfaces, found)
    weights = all_weights(surfaces, body=found.body, local=local, normal=normal)
    slopes = _weight_slopes(
        surfaces, found=found, local=local, normal=normal, along=along, weights=weights
    )
    change = _point_motion(camera, pose=pose, found=found, flat=flat)
    motion = np.zeros((len(pixels), 2, POSE_SIZE))
    motion[place] = np.einsum("kpj,pjm->pkm", along, change)
    seen = np.zeros(len(pixels))
    seen[place] = 1
    return _padded(
        pose,
        place=place,
        weights=weights,
        slopes=slopes,
        motion=motion,
        seen=seen,
        size=size,
        dtype=dtype,
    )


def blank_view(
    count: int, size: int, pose: Float[np.ndarray, "6"], dtype: np.typing.DTypeLike
) -> LinearizedView:
    """View of which nothing is known: its pixels are not finite."""
    none, shape = csr_array((0, 1)), (count, 2, POSE_SIZE)
    slopes, motion, seen = np.zeros((2, 0)), np.zeros(shape), np.zeros(count)
    given = pose, np.arange(0), none, slopes, motion, seen
    blank = _padded(*given, size, dtype)
    return eqx.tree_at(lambda v: v.seen, blank, blank.seen * jnp.nan)


def _chosen(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    pixels: Int[np.ndarray, " p"],
) -> tuple[VisiblePoints, Int[np.ndarray, " q"]]:
    """Points in those of the pixels that show a body, and which of them do."""
    found = visible_points(world_meshes(surfaces), camera)
    number = np.full(camera.width * camera.height, -1)
    number[found.pixel] = np.arange(len(found.pixel))
    place = np.flatnonzero(number[pixels] >= 0)
    picked = number[pixels[place]]
    return VisiblePoints(*(each[picked] for each in found)), place


def _tangents(
    surfaces: tuple[SolvedSurface, ...], found: VisiblePoints
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "2 p 3"]]:
    """Normals of the triangles in the world, and two unit vectors along each."""
    flat = np.empty_like(found.position)
    for number, surface in enumerate(surfaces):
        here, geometry = found.body == number, surface.geometry
        a, b, c = np.moveaxis(geometry.vertices[geometry.faces[found.face[here]]], 1, 0)
        flat[here] = geometry.placed.rotate(np.cross(b - a, c - a))
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    # Any direction that is not along the normal gives a first tangent.
    axis = np.eye(3)[np.abs(flat).argmin(axis=1)]
    first = np.cross(flat, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return flat, np.stack([first, np.cross(flat, first)])


def _on_planes(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    found: VisiblePoints,
    flat: Float[np.ndarray, "p 3"],
) -> VisiblePoints:
    """Points where the rays meet the planes of the triangles.

    The raster snaps corners to 1/1024 pixel: what it finds moves in steps.
    """
    corner = np.empty_like(found.position)
    for number, surface in enumerate(surfaces):
        here, geometry = found.body == number, surface.geometry
        first = geometry.vertices[geometry.faces[found.face[here], 0]]
        corner[here] = geometry.placed.to_world(first)
    origin, step = camera.rays(found.pixel)
    ahead = np.einsum("pj,pj->p", flat, step)
    depth = np.einsum("pj,pj->p", flat, corner - origin) / ahead
    # Seen edge-on a plane has its points anywhere.
    sane = np.abs(depth - found.depth) < 0.1 * np.abs(found.depth)
    depth = np.where(sane, depth, found.depth)
    position = origin + depth[:, None] * step
    return found._replace(position=position, depth=depth)


def _point_motion(
    camera: AbstractCamera,
    pose: Float[np.ndarray, "6"],
    found: VisiblePoints,
    flat: Float[np.ndarray, "p 3"],
) -> Float[np.ndarray, "p 3 6"]:
    """Derivative of the points in the planes of their triangles by the pose."""
    axes, turn = camera.frame, _skew(pose[:3])
    origin, step = camera.rays(found.pixel)
    # In the axes of the given camera.
    start, ahead = (origin - np.asarray(camera.position)) @ axes.T, step @ axes.T
    direction = ahead @ (axes.T @ expm(turn)).T
    moved = np.zeros((len(flat), 3, POSE_SIZE))
    # The ray's point at the same depth: all of its change but that of the depth.
    there = start + found.depth[:, None] * ahead
    for number, unit in enumerate(np.eye(3)):
        change = expm_frechet(turn, _skew(unit), compute_expm=False)
        moved[:, :, number] = there @ (axes.T @ change).T
        moved[:, :, 3 + number] = axes[number]
    across = np.einsum("pj,pjm->pm", flat, moved)
    across /= np.einsum("pj,pj->p", flat, direction)[:, None]
    return moved - direction[:, :, None] * across[:, None]


def _skew(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Matrix of the cross product with a vector."""
    return np.cross(np.eye(3), vector)


def _weight_slopes(
    surfaces: tuple[SolvedSurface, ...],
    found: VisiblePoints,
    local: Float[np.ndarray, "p 3"],
    normal: Float[np.ndarray, "p 3"],
    along: Float[np.ndarray, "2 p 3"],
    weights: csr_array,
) -> Float[np.ndarray, "2 n"]:
    """Change of the normalized weights along two directions of the surface [1/m]."""
    bodies = [surface.geometry for surface in surfaces]
    own, turned, direction = np.empty_like(local), np.empty_like(along), along.copy()
    radius = np.empty(len(local))
    for number, geometry in enumerate(bodies):
        here, placed = found.body == number, geometry.placed
        own[here] = placed.rotate_back(normal[here])
        direction[:, here] = [placed.rotate_back(each[here]) for each in along]
        mesh = geometry.vertices, geometry.faces
        given = *mesh, found.face[here], local[here], direction[:, here]
        turned[:, here] = normal_slopes(*given)
        radius[here] = SMOOTHING_RADIUS * geometry.pitch
    row = np.repeat(np.arange(len(local)), np.diff(weights.indptr))
    position, other, area = (
        np.concatenate([getattr(g, name) for g in bodies])[weights.indices]
        for name in ("fragment_position", "fragment_normal", "fragment_area")
    )
    away, square = local[row] - position, radius[row] ** 2
    fade = np.maximum(1 - np.einsum("nj,nj->n", away, away) / square, 0)
    cosine = np.maximum(np.einsum("nj,nj->n", own[row], other), 0)
    whole, count = (fade * cosine) ** 2 * area, len(local)
    total = np.bincount(row, whole, count)
    # A part too thin for fragments shows the nearest one, which does not change.
    total = np.where(total > 0, total, np.inf)[row]
    slopes = []
    for tangent, bend in zip(direction, turned, strict=True):
        closer = -2 * np.einsum("nj,nj->n", away, tangent[row]) / square
        turn = np.einsum("nj,nj->n", bend[row], other)
        slope = 2 * fade * cosine * area * (closer * cosine + fade * turn)
        all_slopes = np.bincount(row, slope, count)[row]
        slopes.append((slope - whole * all_slopes / total) / total)
    return np.stack(slopes)


def _padded(
    pose: np.ndarray,
    place: np.ndarray,
    weights: csr_array,
    slopes: np.ndarray,
    motion: np.ndarray,
    seen: np.ndarray,
    size: int | None,
    dtype: np.typing.DTypeLike,
) -> LinearizedView:
    counts = np.zeros(len(seen), int)
    counts[place] = np.diff(weights.indptr)
    # A pixel without a body shows any fragment, so that its temperature is one.
    lost = np.flatnonzero(counts == 0)
    counts[lost] = 1
    needed = int(counts.sum())
    size = needed if size is None else size
    if needed > size:
        raise OverflowError(f"{needed} weights and room for {size}")
    row = np.full(size, len(seen) - 1)
    row[:needed] = np.repeat(np.arange(len(seen)), counts)
    given = np.flatnonzero(seen[row[:needed]])
    fragment, weight, slope = np.zeros(size, int), np.zeros(size), np.zeros((2, size))
    weight[np.searchsorted(row[:needed], lost)] = 1
    fragment[given], weight[given] = weights.indices, weights.data
    slope[:, given] = slopes
    real = lambda values: jnp.asarray(np.asarray(values, dtype))
    whole = lambda values: jnp.asarray(np.asarray(values, np.int32))
    return LinearizedView(
        pose=real(pose),
        row=whole(row),
        fragment=whole(fragment),
        weight=real(weight),
        slope=real(slope),
        motion=real(motion),
        seen=real(seen),
    )
