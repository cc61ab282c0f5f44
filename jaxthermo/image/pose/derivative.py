"""Frames as a function of the camera's pose, linear about one at which they are exact.

A pixel shows the point x where its ray o + d z meets a triangle with the normal n. In
another pose the ray is another one, and meets the plane of the triangle elsewhere:

    dx = do + z dd - d n.(do + z dd) / n.d

The temperature there follows from the weights of the fragments (`weights`),
whose slopes along the surface are exact, with those of the interpolated normal. The
weights (1 - r^2/R^2)^2 and the squared cosines go to 0 with their slopes, so that the
derivative is continuous where a fragment comes within the radius, in each triangle;
over an edge of the mesh the depth keeps its value and changes its slope. Points are
where the rays meet the planes: points of the raster, whose corners are snapped to
1/1024 pixel, would move in steps. Pixels at an outline, where the surface ends or
another begins, have no derivative: `outline`.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.linalg import expm, expm_frechet
from scipy.sparse import csr_array

from ...geometry.vectors import row_dot, tangents, triangle_normals, unit_vectors
from ...scene.scene import SolvedSurface
from ..surface.abstract_camera import AbstractCamera
from ..surface.background import Background
from ..surface.facets import normal_slopes
from ..surface.linear_weights import linear_slopes, offsets
from ..surface.shapes import Bodies, ShapePoints
from ..surface.view import View, in_bodies
from ..surface.visible import (
    VisiblePoints,
    on_planes,
    visible_points,
    world_meshes,
)
from ..surface.weights import SMOOTHING_RADIUS, MovingWeights, smooth_weights
from .pose import POSE_SIZE, moved_camera


class LinearizedView(eqx.Module):
    """Chosen pixels of a camera near one pose; arrays of one shape for all poses."""

    pose: Float[Array, "6"]
    """Pose at which it is exact: rotation vector [rad], translation [m], see `pose`."""
    weights: MovingWeights
    """Weights at `pose`, and their slopes along the surface."""
    motion: Float[Array, "p 2 6"]
    """Distance that each point moves along both directions, by each number of the pose
    [m/rad, 1]."""
    seen: Float[Array, " p"]
    """1 where the pixel shows a body, else 0."""

    def at(self, pose: Float[Array, "6"], camera: AbstractCamera) -> View:
        """View of the pixels side by side in one row, for `draw`.

        Its depths, normals and numbers of bodies are not those of the surface.
        """
        shift = self.motion @ (pose - self.pose)
        count = len(self.seen)
        return View(
            camera=camera.in_one_row(count),
            pixel=np.arange(count),
            body=np.zeros(count, int),
            depth=np.zeros(count),
            normal=np.zeros((count, 3)),
            weights=replace(self.weights, shift=shift),
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
        size: number of weights of the arrays; that of the view if None.
        dtype: of the arrays.

    Raises:
        InputError: if the camera is inside a body or sees none.
        OverflowError: if there are more weights than `size`.
    """
    moved = moved_camera(camera, pose)
    visible, rows = _chosen(surfaces, moved, pixels)
    bodies = Bodies.of(surfaces)
    corners = _triangles(bodies, visible)
    flat = unit_vectors(triangle_normals(corners))
    along = np.stack(tangents(flat))
    visible = on_planes(moved, visible=visible, corner=corners[:, 0], normal=flat)
    points = in_bodies(bodies, visible)
    weights = smooth_weights(points, bodies.shapes)
    slopes = _weight_slopes(
        bodies, visible=visible, points=points, along=along, weights=weights
    )
    weights = bodies.of_fragments(weights, visible.body)
    change = _point_motion(camera, pose=pose, visible=visible, flat=flat)
    motion = np.zeros((len(pixels), 2, POSE_SIZE))
    motion[rows] = np.einsum("kpj,pjm->pkm", along, change)
    seen = np.zeros(len(pixels))
    seen[rows] = 1
    return _padded(
        pose,
        rows=rows,
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
    """View before the first linearization: its pixels are not finite."""
    blank = _padded(
        pose,
        rows=np.arange(0),
        weights=csr_array((0, 1)),
        slopes=np.zeros((2, 0)),
        motion=np.zeros((count, 2, POSE_SIZE)),
        seen=np.zeros(count),
        size=size,
        dtype=dtype,
    )
    return eqx.tree_at(lambda v: v.seen, blank, blank.seen * jnp.nan)


def _chosen(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    pixels: Int[np.ndarray, " p"],
) -> tuple[VisiblePoints, Int[np.ndarray, " q"]]:
    """Points in those of the pixels that show a body, and which of them do."""
    visible = visible_points(world_meshes(surfaces), camera)
    number = np.full(camera.width * camera.height, -1)
    number[visible.pixel] = np.arange(len(visible.pixel))
    rows = np.flatnonzero(number[pixels] >= 0)
    picked = number[pixels[rows]]
    return VisiblePoints(*(field[picked] for field in visible)), rows


def _triangles(bodies: Bodies, visible: VisiblePoints) -> Float[np.ndarray, "p 3 3"]:
    """Corners of the triangle of each point in the world [m]."""
    shapes = bodies.shapes
    corners = shapes.vertices[shapes.faces[bodies.face_of(visible.face, visible.body)]]
    body = visible.body.repeat(3)
    return bodies.to_world(corners.reshape(-1, 3), body).reshape(-1, 3, 3)


def _point_motion(
    camera: AbstractCamera,
    pose: Float[np.ndarray, "6"],
    visible: VisiblePoints,
    flat: Float[np.ndarray, "p 3"],
) -> Float[np.ndarray, "p 3 6"]:
    """Derivative of the points in the planes of their triangles by the pose."""
    axes = camera.frame
    turn = _skew(pose[:3])
    origin, step = camera.rays(visible.pixel)
    # In the axes of the given camera.
    start = (origin - np.asarray(camera.position)) @ axes.T
    ahead = step @ axes.T
    direction = ahead @ (axes.T @ expm(turn)).T
    moved = np.zeros((len(flat), 3, POSE_SIZE))
    # The ray's point at the same depth: all of its change but that of the depth.
    ray_point = start + visible.depth[:, None] * ahead
    for number, unit in enumerate(np.eye(3)):
        change = expm_frechet(turn, _skew(unit), compute_expm=False)
        moved[:, :, number] = ray_point @ (axes.T @ change).T
        moved[:, :, 3 + number] = axes[number]
    across = np.einsum("pj,pjm->pm", flat, moved)
    across /= row_dot(flat, direction)[:, None]
    return moved - direction[:, :, None] * across[:, None]


def _skew(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Matrix of the cross product with a vector."""
    return np.cross(np.eye(3), vector)


def _weight_slopes(
    bodies: Bodies,
    visible: VisiblePoints,
    points: ShapePoints,
    along: Float[np.ndarray, "2 p 3"],
    weights: csr_array,
) -> Float[np.ndarray, "2 n"]:
    """Change of the normalized weights along two directions of the surface [1/m]."""
    shapes = bodies.shapes
    local = points.position
    direction = np.stack(
        [bodies.rotate_back(vectors, visible.body) for vectors in along]
    )
    turned = normal_slopes(
        shapes.vertices,
        faces=shapes.faces,
        face=bodies.face_of(visible.face, visible.body),
        points=local,
        along=direction,
    )
    radius = SMOOTHING_RADIUS * shapes.pitch[points.shape]
    row = np.repeat(np.arange(len(local)), np.diff(weights.indptr))
    position = shapes.fragment_position[weights.indices]
    fragment_normal = shapes.fragment_normal[weights.indices]
    area = shapes.fragment_area[weights.indices]
    away = local[row] - position
    square = radius[row] ** 2
    fade = np.maximum(1 - row_dot(away, away) / square, 0)
    cosine = np.maximum(row_dot(points.normal[row], fragment_normal), 0)
    unnormalized = (fade * cosine) ** 2 * area
    count = len(local)
    total = np.bincount(row, unnormalized, count)
    # A part too thin for fragments shows the nearest one, which does not change.
    alone = (total <= 0)[row]
    total = np.where(total > 0, total, np.inf)[row]
    slopes = []
    for tangent, bend in zip(direction, turned, strict=True):
        closer = -2 * row_dot(away, tangent[row]) / square
        turn = row_dot(bend[row], fragment_normal)
        slope = 2 * fade * cosine * area * (closer * cosine + fade * turn)
        all_slopes = np.bincount(row, slope, count)[row]
        slopes.append((slope - unnormalized * all_slopes / total) / total)
    is_wall = shapes.is_two_sided[points.shape]
    if not is_wall.any():
        return np.stack(slopes)
    # Those of thin walls have been shifted to the mean position of the point.
    of_walls = points.some(np.flatnonzero(is_wall))
    entries = np.flatnonzero(is_wall[row])
    count = np.diff(weights.indptr)[is_wall]
    first, second = tangents(of_walls.normal)
    linear = np.stack(slopes)
    scale = np.where(alone, 0.0, weights.data * total)
    scale /= np.where(alone, 1.0, unnormalized)
    linear[:, entries] = linear_slopes(
        weights.data[entries],
        change=scale[entries] * linear[:, entries],
        offset=offsets(
            of_walls.position,
            normals=of_walls.normal,
            count=count,
            neighbour=position[entries],
        )
        / radius[row[entries]],
        step=np.stack(
            [
                [row_dot(tangent[is_wall], first), row_dot(tangent[is_wall], second)]
                for tangent in direction
            ]
        )
        / radius[is_wall],
        count=count,
    )
    return linear


def _padded(
    pose: np.ndarray,
    rows: np.ndarray,
    weights: csr_array,
    slopes: np.ndarray,
    motion: np.ndarray,
    seen: np.ndarray,
    size: int | None,
    dtype: np.typing.DTypeLike,
) -> LinearizedView:
    counts = np.zeros(len(seen), int)
    counts[rows] = np.diff(weights.indptr)
    # A pixel without a body shows any fragment, so that its temperature is one.
    lost = np.flatnonzero(counts == 0)
    counts[lost] = 1
    needed = int(counts.sum())
    size = needed if size is None else size
    if needed > size:
        raise OverflowError(f"{needed} weights and room for {size}")
    row = np.full(size, len(seen) - 1)
    row[:needed] = np.repeat(np.arange(len(seen)), counts)
    entries = np.flatnonzero(seen[row[:needed]])
    fragment = np.zeros(size, int)
    weight = np.zeros(size)
    slope = np.zeros((2, size))
    weight[np.searchsorted(row[:needed], lost)] = 1
    fragment[entries] = weights.indices
    weight[entries] = weights.data
    slope[:, entries] = slopes

    def real(values: np.ndarray) -> Array:
        return jnp.asarray(np.asarray(values, dtype))

    def as_int32(values: np.ndarray) -> Array:
        return jnp.asarray(np.asarray(values, np.int32))

    moving = MovingWeights(
        row=as_int32(row),
        fragment=as_int32(fragment),
        weight=real(weight),
        slope=real(slope),
        shift=real(np.zeros((len(seen), 2))),
    )
    return LinearizedView(
        pose=real(pose), weights=moving, motion=real(motion), seen=real(seen)
    )
