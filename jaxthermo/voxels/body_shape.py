"""Shape of a body for its convection: a plate, a sphere, or cylinders.

The proportions of the convex hull of the mesh decide:

| shape | rule |
|---|---|
| plate | the smallest extent is at most 1/4 of both others |
| sphere | the largest extent is at most 1.2 times the smallest (a cube: 1.73 times) |
| cylinders | all others, and bodies that fill less than 0.8 of their hull |

The smallest extent is that along the normal of a facet of the hull, the two others are
the sides of the smallest rectangle around the silhouette along that normal, the largest
one is the largest distance of two corners. Closed cavities count as filled.
"""

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

from ..errors import InputError
from ..geometry.vectors import unit_vector
from ..memo.found import found
from ..memo.stored import stored_search
from .cylinders import Cylinder
from .grid import VoxelGrid


if TYPE_CHECKING:
    BodyShape = Literal["plate", "cylinder", "sphere"]
else:
    # The annotation is for editors: terms refuse a wrong value with a remedy.
    BodyShape = Any

BODY_SHAPES = ("plate", "cylinder", "sphere")
"""Shapes for which a body has its laws of convection."""

# Largest ratio of the smallest extent of a plate to the next one.
_MAX_THICKNESS = 0.25

# Largest ratio of the extents of a sphere.
_MAX_ROUND_RATIO = 1.2

# Least part of its hull that a plate or a sphere fills.
_MIN_SOLIDITY = 0.8

# Hulls of more corners are those of the outermost points in this many directions.
_MAX_CORNERS = 1000
_DIRECTIONS = 500

# Steps of the angle at which the width of a silhouette is tabulated, over half a turn.
_ANGLES = 180

# Digits to which normals of the facets of one plane are equal.
_NORMAL_DIGITS = 6


class Plate(NamedTuple):
    """Flat body: the convex silhouette along its normal, and its thickness."""

    normal: Float[np.ndarray, "3"]
    """Unit vector across its faces, in the body's frame."""
    long_axis: Float[np.ndarray, "3"]
    """Unit vector along the long side of its silhouette."""
    thickness: float
    """[m]"""
    long_side: float
    """[m]"""
    short_side: float
    """[m]"""
    area: float
    """Area of the silhouette [m^2]."""
    perimeter: float
    """Perimeter of the silhouette [m]."""
    width: Float[np.ndarray, " a"]
    """Width of the silhouette across directions in its plane, by equal steps of their
    angle from the long axis, over half a turn [m]."""

    @property
    def length(self) -> float:
        """Length A / P of its faces in still air [m]."""
        return self.area / self.perimeter

    @property
    def hydraulic_length(self) -> float:
        """Length 4 A / P of its faces across the wind [m]."""
        return 4 * self.length

    def mean_length(
        self, direction: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n"]:
        """Mean length of its faces along a direction, A / width across it [m].

        The part of the direction in the plane counts; across the plate, the long axis.
        """
        along = direction @ self.long_axis
        across = direction @ np.cross(self.normal, self.long_axis)
        step = (np.arctan2(across, along) % np.pi) * (_ANGLES / np.pi)
        width = np.interp(step, np.arange(_ANGLES + 1), self.width)
        return np.asarray(self.area / width)


class Plates(NamedTuple):
    """Plates, and the one that each surface fragment is on."""

    plates: tuple[Plate, ...]
    member: Int[np.ndarray, " s"]

    @classmethod
    def of_one(cls, plate: Plate, count: int) -> "Plates":
        """One plate with all of a number of fragments."""
        return cls((plate,), np.zeros(count, np.int64))


class Sphere(NamedTuple):
    """Round body."""

    diameter: float
    """Diameter of the sphere of the body's volume, or its hull's if larger [m]."""


class _Hull(NamedTuple):
    """Convex hull of a body."""

    corners: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "3"]
    """Normal of the facet across which it is thinnest."""
    thickness: float
    """Extent along that normal [m]."""
    largest_extent: float
    """Largest distance of two corners [m]."""
    volume: float
    """[m^3]"""


def check_body_shape(
    body_shape: object, cylinders: tuple[Cylinder, ...], term: str
) -> None:
    """Check the name of a shape, or None, and that no cylinders contradict it.

    Raises:
        InputError: for any other value, or cylinders of a plate or a sphere.
    """
    if body_shape is None or body_shape == "cylinder":
        return
    if body_shape not in BODY_SHAPES:
        raise InputError(
            f"{term}(body_shape={body_shape!r}): give one of {', '.join(BODY_SHAPES)}, "
            "or None for the shape by the proportions of each body"
        )
    if cylinders:
        raise InputError(
            f"{term}(body_shape={body_shape!r}, cylinders=): give one of the two, or "
            "use another term with `on` for the bodies that are cylinders"
        )


def shape_of(
    grid: VoxelGrid,
    body_shape: BodyShape | None = None,
    cylinders: tuple[Cylinder, ...] = (),
    body: int = 0,
) -> Plate | Sphere | None:
    """The plate or sphere that a body is; None for cylinders.

    Args:
        grid: voxels of the body.
        body_shape: its shape, whatever its proportions; None to go by these.
        cylinders: a user's cylinders, of the bodies that they name.
        body: number of the body.

    Raises:
        InputError: if a body without a volume is to be a plate or a sphere.
    """
    if body_shape == "cylinder" or any(c.body == body for c in cylinders):
        return None
    return found(
        (grid,), ("body shape", body_shape), lambda: _shape_of(grid, body_shape)
    )


def _shape_of(grid: VoxelGrid, body_shape: BodyShape | None) -> Plate | Sphere | None:
    corners = _outermost(grid.mesh.vertices[np.unique(grid.mesh.faces)])
    try:
        hull = _hull(corners)
    except scipy.spatial.QhullError as error:
        if body_shape is None:
            return None
        raise InputError(
            f"body_shape={body_shape!r}: the mesh {grid.mesh.name!r} is flat and has "
            "no volume: leave body_shape out"
        ) from error
    plate = plate_across(hull.normal, hull.corners)
    volume = _filled_volume(grid)
    # The hull of few of the corners is a little smaller than the body.
    sphere = Sphere(float(np.cbrt(6 / np.pi * max(volume, hull.volume))))
    if body_shape is not None:
        return plate if body_shape == "plate" else sphere
    if volume < _MIN_SOLIDITY * hull.volume:
        return None
    if plate.thickness <= _MAX_THICKNESS * plate.short_side:
        return plate
    is_round = hull.largest_extent <= _MAX_ROUND_RATIO * hull.thickness
    return sphere if is_round else None


def _filled_volume(grid: VoxelGrid) -> float:
    """Volume of a body with its closed cavities [m^3]."""
    # The voxels of a thin part may be lost, and parts of a mesh may overlap: the larger
    # of the two volumes.
    volume = grid.body_volume
    if grid.mesh.is_watertight:
        volume = max(volume, grid.mesh.volume)
    cavities = grid.cavities
    if cavities is None:
        return volume
    return volume + int((cavities.stop - cavities.start).sum()) * grid.pitch**3


@stored_search("outermost")
def _outermost(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 3"]:
    """Points that may be corners of the hull; few of many."""
    if len(points) <= _MAX_CORNERS:
        return points
    # Directions that are spread evenly: a spiral by the golden angle.
    number = np.arange(_DIRECTIONS) + 0.5
    height = 1 - 2 * number / _DIRECTIONS
    angle = np.pi * (1 + 5**0.5) * number
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], 1)
    chosen = [int((points @ direction).argmax()) for direction in directions]
    box = [int(points[:, axis].argmin()) for axis in range(3)]
    box += [int(points[:, axis].argmax()) for axis in range(3)]
    return points[np.unique(chosen + box)]


def _hull(points: Float[np.ndarray, "n 3"]) -> _Hull:
    hull = scipy.spatial.ConvexHull(points)
    corners = points[hull.vertices]
    facets = np.unique(np.round(hull.equations[:, :3], _NORMAL_DIGITS), axis=0)
    normals = facets / np.linalg.norm(facets, axis=1, keepdims=True)
    extents = np.ptp(corners @ normals.T, axis=0)
    thinnest = int(extents.argmin())
    return _Hull(
        corners=corners,
        normal=normals[thinnest],
        thickness=float(extents[thinnest]),
        largest_extent=float(scipy.spatial.distance.pdist(corners).max()),
        volume=float(hull.volume),
    )


def plate_across(
    normal: Float[np.ndarray, "3"], corners: Float[np.ndarray, "n 3"]
) -> Plate:
    """Plate around points, which may lie in a plane, with the given unit normal."""
    # Any two axes of the plane, which the sides of the silhouette replace.
    first = unit_vector(np.cross(normal, np.eye(3)[np.abs(normal).argmin()]))
    second = np.cross(normal, first)
    flat = np.stack([corners @ first, corners @ second], axis=1)
    silhouette = scipy.spatial.ConvexHull(flat)
    outline = flat[silhouette.vertices]
    sides = np.roll(outline, -1, axis=0) - outline
    # A side of the smallest rectangle lies along one of the silhouette.
    along = sides / np.linalg.norm(sides, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    lengths = np.ptp(outline @ along.T, axis=0)
    widths = np.ptp(outline @ across.T, axis=0)
    smallest = int((lengths * widths).argmin())
    length = float(lengths[smallest])
    width = float(widths[smallest])
    long_axis = along[smallest] if length >= width else across[smallest]
    angle = np.linspace(0, np.pi, _ANGLES + 1)
    short_axis = np.array([-long_axis[1], long_axis[0]])
    crossing = np.outer(np.cos(angle), short_axis) - np.outer(np.sin(angle), long_axis)
    return Plate(
        normal=normal,
        long_axis=long_axis[0] * first + long_axis[1] * second,
        thickness=float(np.ptp(corners @ normal)),
        long_side=max(length, width),
        short_side=min(length, width),
        # In a plane scipy's volume is an area, and its area a perimeter.
        area=float(silhouette.volume),
        perimeter=float(silhouette.area),
        width=np.ptp(outline @ crossing.T, axis=0),
    )
