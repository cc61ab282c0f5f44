"""Figure 5.3: the intersection of two bodies on 16 x 16 and 256 x 256 rays."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

import jaxthermo as jt
from jaxthermo.report.sheet import Legend, Tile, sheet

from ..exhibit import Exhibit, Finding, Picture, Plot, Row, Verdict
from ..intersection import Balls, Bounds, bounds_along, two_balls
from ..line_chart import log_chart, point
from ..shaded import PAPER, Colour, blended, camera_on, shaded, with_box


# Radii and offset of the second ball [m], along none of the axes.
_RADII, _OFFSET = (0.1, 0.08), (0.075, 0.07, 0.06)
_COARSE, _FINE = 16, 256
_RAYS = (8, _COARSE, 32, 64, 128, _FINE)
# Largest error at the fine resolution [%].
_WITHIN = 1.0
_EDGE = 340
_DIRECTION = (-0.9, 0.25, -0.4)
# Thesis: red, green and blue are bounds along x, y and z.
_AXES: tuple[Colour, ...] = ((222, 72, 62), (66, 168, 72), (62, 104, 222))
_BODIES: tuple[Colour, Colour] = (206, 200, 188), (150, 184, 208)
_SURFACES: tuple[Colour, Colour] = (226, 120, 40), (0, 114, 178)
_BOX, _RAY = (90, 96, 108), (196, 200, 208)
# Part of the caps that the bodies around them hide in the picture.
_VEIL = 0.35


def _errors(balls: Balls, bounds: Sequence[Bounds]) -> dict[str, float]:
    """Relative errors of volume, worst of three axes, and of both areas [%]."""
    area = lambda body: sum(each.area_of(body) for each in bounds)
    off = [each.volume / balls.volume - 1 for each in bounds]
    return {
        "volume": 100 * max(off, key=abs),
        "area of A inside of B": 100 * (area(0) / balls.areas[0] - 1),
        "area of B inside of A": 100 * (area(1) / balls.areas[1] - 1),
    }


def _inside(balls: Balls, body: int) -> jt.Mesh:
    """The part of a ball's surface that lies in the other one."""
    mesh, other = balls.meshes[body], balls.meshes[1 - body]
    away = mesh.triangles.mean(axis=1) - other.bounds.mean(axis=0)
    is_inside = np.linalg.norm(away, axis=1) < balls.radii[1 - body]
    return jt.Mesh(mesh.vertices, mesh.faces[is_inside], mesh.name)


def _collision_surfaces(balls: Balls) -> np.ndarray:
    points = np.concatenate([mesh.vertices for mesh in balls.meshes])
    camera = camera_on(points, _DIRECTION, _EDGE)
    bodies, _ = shaded([*zip(balls.meshes, _BODIES, strict=True)], camera)
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
    corners = np.indices((2, 2, 2)).reshape(3, -1).T
    camera = camera_on(np.where(corners, balls.box[1], balls.box[0]), _DIRECTION, _EDGE)
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
        draw.line(line, fill=_AXES[bounds.axis], width=3 if rays == _COARSE else 1)
    draw.rectangle((left, top, right, bottom), outline=_BOX)
    for mesh, radius, colour in zip(balls.meshes, balls.radii, _SURFACES, strict=True):
        ball = mesh.bounds.mean(axis=0)
        reach = scale * float(np.sqrt(radius**2 - (middle - ball[across]) ** 2))
        x, y = at(ball[along], ball[up])
        circle = (x - reach, y - reach, x + reach, y + reach)
        draw.ellipse(circle, outline=colour, width=2)
    return np.asarray(image)


def _pictures(balls: Balls, cast: dict[int, list[Bounds]]) -> tuple[Picture, Picture]:
    shown = (_COARSE, _FINE)
    surfaces = Tile(_collision_surfaces(balls), "collision surfaces")
    volumes = [
        Tile(_volume_picture(balls, cast[rays]), f"volume, {rays} x {rays} rays")
        for rays in shown
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
        for rays in shown
        for each in cast[rays]
    ]
    names = ("in both, along x", "along y", "along z", "ball A", "ball B", "ray")
    of_rays = Legend(tuple(zip(names, (*_AXES, *_SURFACES, _RAY), strict=True)))
    return (
        Picture(
            "figure-5.3",
            sheet([surfaces, *volumes], legend, title, 3),
            "As in the figure. Left: the collision surfaces, seen through the bodies, "
            f"and the overlap of their boxes. Middle: {_COARSE} x {_COARSE} rays along "
            "each axis. Right: 256 x 256. A block stands for a ray's first or last "
            "point in both bodies, of the axis that sees the surface best.",
        ),
        Picture(
            "figure-5.3-rays",
            sheet(rows, of_rays, "Rays cast through the overlap of two boxes", 3),
            "One plane of rays along each axis: coloured where a ray is in both balls. "
            "The exact circles are drawn over them.",
        ),
    )


def _chart(wrong: dict[int, dict[str, float]]) -> Plot:
    points = [
        point(name, rays, abs(error), f"{name}, {rays} rays: {error:+.2g} %")
        for rays, errors in wrong.items()
        for name, error in errors.items()
    ]
    y = "error against the closed form [%]"
    chart = log_chart(points, "rays along an edge of the box", y, "Two balls")
    return Plot(
        "figure-5.3-error",
        chart,
        "Magnitude of the error; that of the volume is the worst of the three axes. "
        "Its sign changes from one resolution to another.",
    )


def _measure(_: bool) -> Finding:
    balls = two_balls(_RADII, _OFFSET)
    cast = {
        rays: [bounds_along(balls, axis, rays) for axis in range(3)] for rays in _RAYS
    }
    wrong = {rays: _errors(balls, each) for rays, each in cast.items()}
    worst = {rays: max(map(abs, each.values())) for rays, each in wrong.items()}
    order = np.log(worst[_COARSE] / worst[_FINE]) / np.log(_FINE / _COARSE)
    right = worst[_FINE] < min(_WITHIN, worst[_COARSE])
    reason = (
        f"On {_COARSE} x {_COARSE} rays volume and areas of the intersection are up to "
        f"{worst[_COARSE]:.2g} % off the closed form, on {_FINE} x {_FINE} "
        f"{worst[_FINE]:.2g} %: the error falls with the pixel to the power of "
        f"{order:.1f}. Rays find the surfaces of contact without a voxel inside; but "
        "bodies that overlap so much are refused as bodies in contact, since their "
        "common volume has the heat capacity of both."
    )
    rows = tuple(
        Row(
            f"{name} on {rays} x {rays} rays, error [%]",
            "shown at both resolutions" if name == "volume" else None,
            error,
            "worst of three axes" if name == "volume" else "",
        )
        for rays in (_COARSE, _FINE)
        for name, error in wrong[rays].items()
    )
    big, small = (100 * radius for radius in _RADII)
    chosen = (
        (
            "bodies",
            f"balls of {big:g} and {small:g} cm, {100 * balls.distance:.3g} cm apart "
            "along none of the axes: their caps have closed forms",
        ),
        ("rays", "parallel to x, y and z through the overlap of both bounding boxes"),
        ("area", "a pixel over the normal's largest component, as of voxels"),
    )
    numbers = {
        "exact_volume_m3": balls.volume,
        "exact_areas_m2": list(balls.areas),
        "error_percent": wrong,
        "order": float(order),
    }
    parts = (*_pictures(balls, cast), _chart(wrong))
    verdict = Verdict.REPRODUCED if right else Verdict.CONTRADICTED
    return Finding(verdict, reason, rows, {}, chosen, parts, numbers)


EXHIBIT = Exhibit(
    name="figure-5.3",
    title="intersection of two bodies on 16 x 16 and 256 x 256 rays",
    place="5.3, figure 5.3",
    claims=("C18",),
    measure=_measure,
)
