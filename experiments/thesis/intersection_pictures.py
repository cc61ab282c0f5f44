"""Pictures of two balls that overlap, and of rays through the overlap (figure 5.3)."""

from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.report.sheet import Legend, Tile, sheet

from .exhibit import Picture
from .intersection import Balls, Bounds
from .shaded import (
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


_EDGE = 340
_DIRECTION = (-0.9, 0.25, -0.4)
# Thesis: red, green and blue are bounds along x, y and z.
_AXES: tuple[Colour, ...] = ((222, 72, 62), (66, 168, 72), (62, 104, 222))
_SURFACES: tuple[Colour, Colour] = (226, 120, 40), (0, 114, 178)
_RAY = (196, 200, 208)
# Part of the caps that the bodies around them hide in the picture.
_VEIL = 0.35
# Width of a ray inside of both bodies times the number of rays [px].
_THICK = 48


def _inside(balls: Balls, body: int) -> jt.Mesh:
    """The part of a ball's surface that lies in the other one."""
    mesh, other = balls.meshes[body], balls.meshes[1 - body]
    away = mesh.triangles.mean(axis=1) - other.bounds.mean(axis=0)
    is_inside = np.linalg.norm(away, axis=1) < balls.radii[1 - body]
    return jt.Mesh(mesh.vertices, mesh.faces[is_inside], mesh.name)


def _collision_surfaces(balls: Balls) -> np.ndarray:
    points = np.concatenate([mesh.vertices for mesh in balls.meshes])
    camera = camera_on(points, _DIRECTION, _EDGE)
    bodies, _ = shaded([*zip(balls.meshes, BODIES, strict=True)], camera)
    caps = [(_inside(balls, body), _SURFACES[body]) for body in (0, 1)]
    surfaces, is_cap = shaded(caps, camera)
    seen = np.where(is_cap[..., None], blended(bodies, surfaces, _VEIL), bodies)
    return with_box(seen, camera, balls.box)


def _blocks(bounds: Bounds) -> jt.Mesh:
    """A block at every bound, as wide as a pixel: its three sides that are seen."""
    middle = bounds.position[bounds.is_dominant]
    half = bounds.cell / 2
    sides = []
    for axis in range(3):
        corners = np.zeros((4, 3))
        corners[:, axis] = -np.sign(_DIRECTION[axis]) * half[axis]
        corners[:, (axis + 1) % 3] = half[(axis + 1) % 3] * np.array([-1, 1, 1, -1])
        corners[:, (axis + 2) % 3] = half[(axis + 2) % 3] * np.array([-1, -1, 1, 1])
        sides.append((middle[:, None] + corners).reshape(-1, 3))
    first = 4 * np.arange(3 * len(middle))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return jt.Mesh(np.concatenate(sides), faces, "bounds")


def _volume_picture(balls: Balls, bounds: Sequence[Bounds]) -> np.ndarray:
    camera = camera_on(box_corners(balls.box), _DIRECTION, _EDGE)
    parts = [(_blocks(each), _AXES[each.axis]) for each in bounds]
    return with_box(shaded(parts, camera)[0], camera, balls.box)


def _rays_picture(balls: Balls, bounds: Bounds, rays: int) -> np.ndarray:
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

    (left, bottom), (right, top) = at(low[along], low[up]), at(high[along], high[up])
    for row in range(rays):
        _, y = at(0.0, low[up] + (row + 0.5) * bounds.cell[up])
        draw.line((left, y, right, y), fill=_RAY)
    cut = np.abs(bounds.position[:, across] - middle) < bounds.cell[across] / 4
    shown, enters = bounds.position[cut], bounds.enters[cut]
    ends = zip(shown[enters], shown[~enters], strict=True)
    for start, end in ends:
        line = (*at(start[along], start[up]), *at(end[along], end[up]))
        draw.line(line, fill=_AXES[bounds.axis], width=max(1, int(_THICK / rays)))
    draw.rectangle((left, top, right, bottom), outline=BOX)
    for mesh, radius, colour in zip(balls.meshes, balls.radii, _SURFACES, strict=True):
        ball = mesh.bounds.mean(axis=0)
        reach = scale * float(np.sqrt(radius**2 - (middle - ball[across]) ** 2))
        x, y = at(ball[along], ball[up])
        circle = (x - reach, y - reach, x + reach, y + reach)
        draw.ellipse(circle, outline=colour, width=2)
    return np.asarray(image)


def pictures(
    balls: Balls, cast: Mapping[int, Sequence[Bounds]]
) -> tuple[Picture, Picture]:
    """The figure's three pictures, and sections with the rays.

    Args:
        balls: the bodies.
        cast: bounds along each axis at the two resolutions that are shown.
    """
    coarse, fine = cast
    surfaces = Tile(_collision_surfaces(balls), "collision surfaces")
    volumes = [
        Tile(_volume_picture(balls, cast[rays]), f"volume, {rays} x {rays} rays")
        for rays in cast
    ]
    names = ("bounds along x", "along y", "along z", "A inside of B", "B inside of A")
    legend = Legend(tuple(zip(names, (*_AXES, *_SURFACES), strict=True)))
    title = "Intersection of two balls, A on the left and B on the right"
    rows = [
        Tile(
            _rays_picture(balls, each, rays),
            f"{rays} rays along {'xyz'[each.axis]}",
            f"section with {'yzx'[each.axis]} upwards",
        )
        for rays in cast
        for each in cast[rays]
    ]
    names = ("in both, along x", "along y", "along z", "ball A", "ball B", "ray")
    of_rays = Legend(tuple(zip(names, (*_AXES, *_SURFACES, _RAY), strict=True)))
    return (
        Picture(
            "figure-5.3",
            sheet([surfaces, *volumes], legend, title, 3),
            "As in the figure. Left: the collision surfaces, seen through the bodies, "
            f"and the overlap of their boxes. Middle: {coarse} x {coarse} rays along "
            f"each axis. Right: {fine} x {fine}. A block stands for a ray's first or "
            "last point in both bodies, of the axis that sees the surface best.",
        ),
        Picture(
            "figure-5.3-rays",
            sheet(rows, of_rays, "Rays cast through the overlap of two boxes", 3),
            "One plane of rays along each axis: coloured where a ray is in both balls. "
            "The exact circles are drawn over them.",
        ),
    )
