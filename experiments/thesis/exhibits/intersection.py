"""5.3: the intersection of two bodies on rays through the overlap of their boxes.

Faure et al. (2008) render both bodies along three axes into a box around what their
bounding boxes have in common. Every ray gives the depths at which it enters and leaves
both; where it is inside both, its two ends bound the intersection.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.geometry.vectors import unit_vectors
from jaxthermo.raster.fragments import peel
from jaxthermo.report.chart import Chart
from jaxthermo.report.sheet import Legend, Tile, sheet
from jaxthermo.voxels.lattice import pixel_axes

from ...harness.line_chart import CurvePoint, log_chart
from ...harness.power_law import power
from ..exhibit import Finding, exhibit, judged
from ..shaded import (
    BODIES,
    BOX,
    PAPER,
    Colour,
    blended,
    box_corners,
    camera_on,
    shaded,
    with_box,
)


# Radii and offset of the second ball [m], along none of the axes.
_RADII = (0.1, 0.08)
_OFFSET = (0.075, 0.07, 0.06)
_COARSE = 16
_FINE = 256
_RAYS = (8, _COARSE, 32, 64, 128, _FINE)
# Largest error at the fine resolution [%].
_MAX_ERROR_PERCENT = 1.0
_EDGE = 340
_DIRECTION = (-0.9, 0.25, -0.4)
# Thesis: red, green and blue are bounds along x, y and z.
_AXES: tuple[Colour, ...] = ((222, 72, 62), (66, 168, 72), (62, 104, 222))
_SURFACES: tuple[Colour, Colour] = ((226, 120, 40), (0, 114, 178))
_RAY = (196, 200, 208)
# Corners of a square of edge 2, in turn.
_SQUARE = np.array(
    [
        (-1, -1),
        (1, -1),
        (1, 1),
        (-1, 1),
    ]
)
# Fraction of the caps' light that the bodies around them take in the picture.
_VEIL = 0.35
# Width of a ray inside of both bodies times the number of rays [px].
_THICK = 48


@exhibit("figure-5.3", "5.3, figure 5.3")
def _intersection_of_balls(_: bool) -> Finding:
    """Find volume and areas of an intersection on few and on many rays."""
    balls = two_balls(_RADII, _OFFSET)
    bounds = {
        rays: [bounds_along(balls, axis, rays) for axis in range(3)] for rays in _RAYS
    }
    errors = {rays: _errors(balls, on_axes) for rays, on_axes in bounds.items()}
    worst = {rays: max(map(abs, error.values())) for rays, error in errors.items()}
    is_right = worst[_FINE] < min(_MAX_ERROR_PERCENT, worst[_COARSE])
    return Finding(
        judged(is_right),
        {
            "exact_volume_m3": balls.volume,
            "exact_areas_m2": balls.areas,
            "distance_cm": 100 * balls.distance,
            "error_percent": errors,
            "worst_percent": worst,
            "order": -power(_RAYS, [*worst.values()]),
        },
        {
            **pictures(balls, {rays: bounds[rays] for rays in (_COARSE, _FINE)}),
            "figure-5.3-error": _error_chart(errors),
        },
    )


class _Bounds(NamedTuple):
    """Crossings that bound the intersection on rays along one axis."""

    axis: int
    position: Float[np.ndarray, "k 3"]
    """Positions of the crossings [m]."""
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
        is_seen = self.is_dominant & (self.body == body)
        along = np.abs(self.normal[is_seen, self.axis])
        return self.cell_area * float((1.0 / along).sum())


class _Balls(NamedTuple):
    """Two balls that overlap."""

    meshes: tuple[jt.Mesh, jt.Mesh]
    radii: tuple[float, float]
    """Radii [m]."""
    distance: float
    """Distance between their centres [m]."""

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of what their bounding boxes share [m]."""
        bounds = np.stack([mesh.bounds for mesh in self.meshes])
        lowest = bounds[:, 0].max(axis=0)
        highest = bounds[:, 1].min(axis=0)
        return np.stack([lowest, highest])

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
        a, b = 2 * np.pi * np.array(self.radii) * self.cap_heights
        return float(a), float(b)

    @property
    def volume(self) -> float:
        """Volume of both caps, pi h^2 (R - h / 3) each [m^3]."""
        radius = np.array(self.radii)
        height = np.array(self.cap_heights)
        caps = np.pi * height**2 * (radius - height / 3)
        return float(caps.sum())


def two_balls(
    radii: tuple[float, float],
    offset: tuple[float, float, float],
    subdivisions: int = 6,
) -> _Balls:
    """Balls of two radii [m], the second one with its centre at `offset` [m]."""
    # So fine by default that facets are no part of the error at any resolution here.
    a, b = (sphere(radius, subdivisions) for radius in radii)
    moved = jt.Mesh(b.vertices + np.array(offset), b.faces, "B")
    return _Balls((a, moved), radii, float(np.linalg.norm(offset)))


def bounds_along(balls: _Balls, axis: int, rays: int) -> _Bounds:
    """Cast `rays` x `rays` rays along an axis of the overlap box."""
    low, high = balls.box
    row_axis, column_axis = pixel_axes(axis)
    views = [column_axis, row_axis]
    triangles = np.concatenate([mesh.triangles for mesh in balls.meshes])
    frame = triangles[..., [*views, axis]].copy()
    size = high[views] - low[views]
    frame[..., :2] = (frame[..., :2] - low[views]) / size * rays
    layers = peel(frame, rays, rays)
    body = (layers.triangle >= len(balls.meshes[0].faces)).astype(int)
    step = np.where(layers.entering, 1, -1)
    # Rays are sorted by pixel, then depth, and leave a closed body as often as they
    # enter it: one sum over all of them counts the bodies that each is inside of.
    steps_of_bodies = [np.where(body == number, step, 0) for number in (0, 1)]
    within = np.cumsum(steps_of_bodies, axis=1)
    bounding = np.flatnonzero(within[1 - body, np.arange(len(body))] > 0)
    row, column = np.divmod(layers.pixel[bounding], rays)
    cell = (high - low) / rays
    a, b, c = np.moveaxis(triangles[layers.triangle[bounding]], 1, 0)
    position = np.empty((len(bounding), 3))
    position[:, axis] = layers.depth[bounding]
    position[:, column_axis] = low[column_axis] + (column + 0.5) * cell[column_axis]
    position[:, row_axis] = low[row_axis] + (row + 0.5) * cell[row_axis]
    return _Bounds(
        axis=axis,
        position=position,
        body=body[bounding],
        normal=unit_vectors(np.cross(b - a, c - a)),
        enters=layers.entering[bounding],
        cell=cell,
    )


def _inside(balls: _Balls, body: int) -> jt.Mesh:
    """The part of a ball's surface that lies in the other one."""
    mesh = balls.meshes[body]
    other_ball = balls.meshes[1 - body]
    offset = mesh.triangles.mean(axis=1) - other_ball.bounds.mean(axis=0)
    is_inside = np.linalg.norm(offset, axis=1) < balls.radii[1 - body]
    return jt.Mesh(mesh.vertices, mesh.faces[is_inside], mesh.name)


def _collision_surfaces(balls: _Balls) -> np.ndarray:
    points = np.concatenate([mesh.vertices for mesh in balls.meshes])
    camera = camera_on(points, _DIRECTION, _EDGE)
    bodies = shaded([*zip(balls.meshes, BODIES, strict=True)], camera)
    caps = [(_inside(balls, body), _SURFACES[body]) for body in (0, 1)]
    surfaces = shaded(caps, camera)
    is_cap = (surfaces != PAPER).any(axis=-1, keepdims=True)
    seen = np.where(is_cap, blended(bodies, surfaces, _VEIL), bodies)
    return with_box(seen, camera, balls.box)


def _blocks(bounds: _Bounds) -> jt.Mesh:
    """A block at every bound, as wide as a pixel: its three sides that are seen."""
    middle = bounds.position[bounds.is_dominant]
    half = bounds.cell / 2
    sides = []
    for axis in range(3):
        next_axis = (axis + 1) % 3
        last_axis = (axis + 2) % 3
        corners = np.zeros((4, 3))
        corners[:, axis] = -np.sign(_DIRECTION[axis]) * half[axis]
        corners[:, next_axis] = half[next_axis] * _SQUARE[:, 0]
        corners[:, last_axis] = half[last_axis] * _SQUARE[:, 1]
        sides.append((middle[:, None] + corners).reshape(-1, 3))
    first = 4 * np.arange(3 * len(middle))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return jt.Mesh(np.concatenate(sides), faces, "bounds")


def _volume_picture(balls: _Balls, bounds: Sequence[_Bounds]) -> np.ndarray:
    camera = camera_on(box_corners(balls.box), _DIRECTION, _EDGE)
    blocks = [(_blocks(on_axis), _AXES[on_axis.axis]) for on_axis in bounds]
    return with_box(shaded(blocks, camera), camera, balls.box)


def _rays_picture(balls: _Balls, bounds: _Bounds, rays: int) -> np.ndarray:
    """Section through the middle of the box along an axis, with the rays in it."""
    along, up, across = ((bounds.axis + k) % 3 for k in range(3))
    low, high = balls.box
    middle = low[across] + (rays // 2 + 0.5) * bounds.cell[across]
    scale = 0.7 * _EDGE / float((high - low)[[along, up]].max())
    centre = (low + high) / 2
    image = Image.new("RGB", (_EDGE, _EDGE), PAPER)
    draw = ImageDraw.Draw(image)

    def at(u: float, v: float) -> tuple[float, float]:
        return (
            _EDGE / 2 + scale * (u - centre[along]),
            _EDGE / 2 - scale * (v - centre[up]),
        )

    left, bottom = at(low[along], low[up])
    right, top = at(high[along], high[up])
    for row in range(rays):
        _, y = at(0.0, low[up] + (row + 0.5) * bounds.cell[up])
        draw.line((left, y, right, y), fill=_RAY)
    cut = np.abs(bounds.position[:, across] - middle) < bounds.cell[across] / 4
    crossings = bounds.position[cut]
    enters = bounds.enters[cut]
    for start, end in zip(crossings[enters], crossings[~enters], strict=True):
        entry = at(start[along], start[up])
        exit_ = at(end[along], end[up])
        width = max(1, int(_THICK / rays))
        draw.line((*entry, *exit_), fill=_AXES[bounds.axis], width=width)
    draw.rectangle((left, top, right, bottom), outline=BOX)
    for mesh, radius, colour in zip(balls.meshes, balls.radii, _SURFACES, strict=True):
        ball = mesh.bounds.mean(axis=0)
        reach = scale * float(np.sqrt(radius**2 - (middle - ball[across]) ** 2))
        x, y = at(ball[along], ball[up])
        circle = (x - reach, y - reach, x + reach, y + reach)
        draw.ellipse(circle, outline=colour, width=2)
    return np.asarray(image)


def pictures(
    balls: _Balls, bounds: Mapping[int, Sequence[_Bounds]]
) -> dict[str, Image.Image]:
    """The figure's three pictures, and sections with the rays.

    Args:
        balls: the bodies.
        bounds: along each axis, by the number of rays.
    """
    tiles = [Tile(_collision_surfaces(balls), "collision surfaces")]
    sections = []
    for rays, on_axes in bounds.items():
        volume = _volume_picture(balls, on_axes)
        tiles.append(Tile(volume, f"volume, {rays} x {rays} rays"))
        for on_axis in on_axes:
            sections.append(
                Tile(
                    _rays_picture(balls, on_axis, rays),
                    f"{rays} rays along {'xyz'[on_axis.axis]}",
                    f"section with {'yzx'[on_axis.axis]} upwards",
                )
            )
    names = ("bounds along x", "along y", "along z", "A inside of B", "B inside of A")
    legend = Legend(tuple(zip(names, (*_AXES, *_SURFACES), strict=True)))
    names = ("in both, along x", "along y", "along z", "ball A", "ball B", "ray")
    of_rays = Legend(tuple(zip(names, (*_AXES, *_SURFACES, _RAY), strict=True)))
    title = "Intersection of two balls, A on the left and B on the right"
    return {
        "figure-5.3": sheet(tiles, legend, title, columns=3),
        "figure-5.3-rays": sheet(
            sections, of_rays, "Rays cast through the overlap of two boxes", columns=3
        ),
    }


def _errors(balls: _Balls, bounds: Sequence[_Bounds]) -> dict[str, float]:
    """Relative errors of volume, worst of three axes, and of both areas [%]."""
    volume_errors = [on_axis.volume / balls.volume - 1 for on_axis in bounds]
    areas = [sum(on_axis.area_of(body) for on_axis in bounds) for body in (0, 1)]
    return {
        "volume": 100 * max(volume_errors, key=abs),
        "area of A inside of B": 100 * (areas[0] / balls.areas[0] - 1),
        "area of B inside of A": 100 * (areas[1] / balls.areas[1] - 1),
    }


def _error_chart(errors: Mapping[int, Mapping[str, float]]) -> Chart:
    points = [
        CurvePoint(name, x=rays, y=abs(error))
        for rays, by_name in errors.items()
        for name, error in by_name.items()
    ]
    return log_chart(
        points=points,
        x_title="rays along an edge of the box",
        y_title="error against the closed form [%]",
        title="Two balls",
    )
