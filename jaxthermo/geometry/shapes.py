"""Procedural bodies and open surfaces, centred at the origin.

Bodies are watertight and wound outward. Round ones are widened slightly so that their
volume, and with it their heat capacity, is exact; their vertices lie just outside the
given radius. Surfaces, which have an area and no volume, are for sheets: `rectangle`,
`disc`, `polygon`, `pipe` and `tray`. The area of the round ones is exact.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, positive_length
from .booleans import difference, union
from .figurine import figurine
from .files.file_mesh import FileFault
from .files.polygons import Polygons, triangulated
from .mesh import Mesh, joined as joined_triangles
from .vectors import unit_vectors


__all__ = [
    "box",
    "capsule",
    "cone",
    "cylinder",
    "difference",
    "disc",
    "figurine",
    "hemisphere",
    "joined",
    "pipe",
    "polygon",
    "prism",
    "rectangle",
    "slab",
    "sphere",
    "tray",
    "tube",
    "union",
]

_Size = float | int | tuple[float | int, float | int, float | int]

# Corner number 4 i + 2 j + k of the unit cube is at (i, j, k).
_BOX_QUADS = np.array([
    [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
])  # fmt: skip


def box(size: _Size) -> Mesh:
    """Box of 12 triangles with edges `size` along x, y, z [m]; one number: a cube."""
    edges = size if isinstance(size, tuple) else (size, size, size)
    lengths = [positive_length("size", edge) for edge in edges]
    corners = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    first_halves = _BOX_QUADS[:, [0, 1, 2]]
    second_halves = _BOX_QUADS[:, [0, 2, 3]]
    faces = np.concatenate([first_halves, second_halves])
    return Mesh(vertices=corners * np.array(lengths), faces=faces, name="box")


def slab(thickness: float | int, width: float | int, length: float | int) -> Mesh:
    """Box `thickness` thick along x, `width` along y, `length` along z [m]."""
    plate = box((thickness, width, length))
    return Mesh(vertices=plate.vertices, faces=plate.faces, name="slab")


def sphere(radius: float | int, subdivisions: int = 4) -> Mesh:
    """Sphere of `radius` [m]: an icosahedron with its faces repeatedly cut in four.

    It has 20 * 4^subdivisions faces. The volume is exact; the area is too large by
    0.1 % at 3 subdivisions, and by a quarter of that with each further one.
    """
    radius = positive_length("radius", radius)
    points, faces = _icosahedron()
    for _ in range(subdivisions):
        points, faces = _cut_in_four(points, faces)
    # Widened so that the volume is that of the sphere.
    unit = Mesh(vertices=points, faces=faces, name="sphere")
    widening = (4.0 / 3.0 * np.pi / unit.volume) ** (1.0 / 3.0)
    vertices = points * radius * widening
    return Mesh(vertices=vertices, faces=faces, name="sphere")


def cylinder(radius: float | int, height: float | int, sections: int = 64) -> Mesh:
    """Cylinder along z of `radius` and `height` [m] with `sections` sides [-]."""
    radius = positive_length("radius", radius)
    half = 0.5 * positive_length("height", height)
    rings = [(radius, -half), (radius, half)]
    return _revolved("cylinder", rings=rings, sections=sections)


def tube(
    radius: float | int,
    inner_radius: float | int,
    height: float | int,
    sections: int = 64,
) -> Mesh:
    """Tube along z, open at both ends: a cylinder less one of `inner_radius` [m].

    Raises:
        InputError: unless the inner radius is less than the outer one.
    """
    outer = positive_length("radius", radius)
    inner = positive_length("inner_radius", inner_radius)
    half = 0.5 * positive_length("height", height)
    if not inner < outer:
        raise InputError(
            f"inner_radius={inner:g} leaves no wall: give less than the outer radius, "
            f"{outer:g} m"
        )
    rings = [(inner, -half), (outer, -half), (outer, half), (inner, half)]
    return _revolved("tube", rings=rings, sections=sections, has_ends=False)


def cone(
    radius: float | int,
    height: float | int,
    top_radius: float | int = 0.0,
    sections: int = 64,
) -> Mesh:
    """Cone along z with its tip up; cut off where it has `top_radius`, if given [m]."""
    radius = positive_length("radius", radius)
    half = 0.5 * positive_length("height", height)
    rings = [(radius, -half)]
    if top_radius != 0.0:
        upper_radius = positive_length("top_radius", top_radius)
        rings.append((upper_radius, half))
    ends = (-half, half)
    return _revolved("cone", rings=rings, sections=sections, ends=ends)


def hemisphere(radius: float | int, sections: int = 64) -> Mesh:
    """Half of a ball of `radius` [m], its flat side down at z = -radius / 2."""
    radius = positive_length("radius", radius)
    middle = 0.5 * radius
    quarter = _quarter(radius, sections)
    inscribed = [(r, z - middle) for r, z in quarter]
    ends = (-middle, middle)
    volume = 2.0 / 3.0 * np.pi * radius**3
    rings = _with_volume(inscribed, ends=ends, volume=volume)
    return _revolved("hemisphere", rings=rings, sections=sections, ends=ends)


def capsule(radius: float | int, height: float | int, sections: int = 64) -> Mesh:
    """Rod along z with round ends: `height` from tip to tip, diameter 2 `radius` [m].

    Raises:
        InputError: if the height is less than the diameter.
    """
    radius = positive_length("radius", radius)
    straight = positive_length("height", height) - 2.0 * radius
    if straight < 0.0:
        raise InputError(
            f"height={height:g} is less than the diameter of a capsule's ends: give at "
            f"least {2.0 * radius:g} m, or a smaller radius"
        )
    half = 0.5 * straight
    upper = _quarter(radius, sections)
    # Without a straight part both ends share their widest ring.
    lower = upper[::-1] if straight else upper[:0:-1]
    lower_rings = [(r, -z - half) for r, z in lower]
    upper_rings = [(r, z + half) for r, z in upper]
    inscribed = lower_rings + upper_rings
    ends = (-half - radius, half + radius)
    volume = np.pi * radius**2 * (straight + 4.0 / 3.0 * radius)
    rings = _with_volume(inscribed, ends=ends, volume=volume)
    return _revolved("capsule", rings=rings, sections=sections, ends=ends)


def rectangle(width: float | int, length: float | int) -> Mesh:
    """Flat surface `width` along x and `length` along y [m], its front up."""
    x = 0.5 * positive_length("width", width)
    y = 0.5 * positive_length("length", length)
    corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(vertices=corners, faces=faces, name="rectangle")


def disc(radius: float | int, sections: int = 64) -> Mesh:
    """Flat round surface of `radius` [m], its front up, with `sections` corners [-]."""
    radius = positive_length("radius", radius)
    circle = _circle("disc", sections) * _area_widening(sections)
    rim = np.column_stack([radius * circle, np.zeros(sections)])
    vertices = np.concatenate([rim, np.zeros((1, 3))])
    index = np.arange(sections)
    pole = np.full(sections, sections)
    faces = np.stack([pole, index, np.roll(index, -1)], axis=1)
    return Mesh(vertices=vertices, faces=faces, name="disc")


def pipe(radius: float | int, height: float | int, sections: int = 64) -> Mesh:
    """Side of a cylinder along z, open at both ends, its front outside [m]."""
    radius = positive_length("radius", radius)
    half = 0.5 * positive_length("height", height)
    circle = _circle("pipe", sections)
    # Widened so that the sides together are as long as the circle.
    half_section = np.pi / sections
    ring = radius * half_section / np.sin(half_section) * circle
    level = np.full(sections, half)
    lower = np.column_stack([ring, -level])
    upper = np.column_stack([ring, level])
    faces = _side_faces(sections)
    return Mesh(vertices=np.concatenate([lower, upper]), faces=faces, name="pipe")


def tray(size: _Size) -> Mesh:
    """Box without its top, its front outside, with edges along x, y, z [m]."""
    closed = box(size)
    # Two triangles of the top, whose normal is up.
    is_top = closed.area_vectors[:, 2] > 0.0
    return Mesh(vertices=closed.vertices, faces=closed.faces[~is_top], name="tray")


def polygon(points: Sequence[Sequence[float | int]]) -> Mesh:
    """Flat surface between corners in space [m], counter-clockwise seen from the front.

    The position is that of the corners. A concave polygon may need mapbox_earcut.

    Raises:
        InputError: for fewer than three points, for points that are not in a plane, or
            for a polygon that crosses itself.
    """
    corners = _points("polygon", points, coordinates=3)
    sides = corners - corners[0]
    area_vector = 0.5 * np.cross(sides[1:-1], sides[2:]).sum(axis=0)
    area = float(np.linalg.norm(area_vector))
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    if not area > _FLAT * size**2:
        raise InputError("polygon(points=): they lie on a line and enclose no area")
    height = float(np.ptp(sides @ area_vector) / area)
    if height > _FLAT * size:
        raise InputError(
            f"polygon(points=): they differ by {height:g} m from a plane: give points "
            "in a plane, or several polygons"
        )
    return Mesh(vertices=corners, faces=_polygon_faces(corners), name="polygon")


def prism(points: Sequence[Sequence[float | int]], height: float | int) -> Mesh:
    """Body between two equal polygons: an outline in x, y along z for a `height` [m].

    Its outline has the position of the points. A concave one may need mapbox_earcut.

    Args:
        points: corners [x, y] of the outline, either way round [m].
        height: extent along z, half of it to each side of z = 0 [m].

    Raises:
        InputError: as `polygon`.
    """
    half = 0.5 * positive_length("height", height)
    outline = _points("prism", points, coordinates=2)
    x, y = outline.T
    if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0.0:
        outline = outline[::-1]
    level = np.full(len(outline), half)
    lower = np.column_stack([outline, -level])
    upper = np.column_stack([outline, level])
    top = polygon(upper.tolist()).faces
    faces = [_side_faces(len(outline)), top[:, ::-1], top + len(outline)]
    vertices = np.concatenate([lower, upper])
    return Mesh(vertices=vertices, faces=np.concatenate(faces), name="prism")


def joined(*meshes: Mesh) -> Mesh:
    """Meshes side by side as one, whose triangles stay as they are.

    Nothing is cut or closed, other than by `union`. Panels become a surface whose edges
    meet; a sheet of it welds them.

    Raises:
        InputError: without a mesh.
    """
    if not meshes:
        raise InputError("joined(): give at least one mesh")
    triangles = [(mesh.vertices, mesh.faces) for mesh in meshes]
    vertices, faces = joined_triangles(triangles)
    return Mesh(vertices=vertices, faces=faces, name="joined")


_FLAT = 1e-6
"""Distance from a plane that rounding may cause, over the size of a polygon [-]."""


def _points(
    name: str, points: Sequence[Sequence[float | int]], coordinates: int
) -> Float[np.ndarray, "p k"]:
    try:
        corners = np.asarray(points, float)
    except (TypeError, ValueError):
        corners = np.zeros((0, 0))
    is_table = corners.ndim == 2 and corners.shape[1] == coordinates
    if not is_table or len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(
            f"{name}(points=): give three or more points of {coordinates} coordinates "
            "each [m]"
        )
    return corners


def _polygon_faces(corners: Float[np.ndarray, "p 3"]) -> Int[np.ndarray, "t 3"]:
    count = len(corners)
    outline = Polygons(corners=np.arange(count), counts=np.array([count]))
    try:
        return triangulated(corners, outline).faces
    except FileFault as fault:
        reason = str(fault).replace("face 1", "the outline")
        raise InputError(f"polygon(points=): {reason}") from None


def _side_faces(sections: int) -> Int[np.ndarray, "t 3"]:
    """Triangles between two rings, the lower one first, with their front outside."""
    index = np.arange(sections)
    next_index = np.roll(index, -1)
    upper = index + sections
    next_upper = next_index + sections
    one_half = np.stack([index, next_index, next_upper], axis=1)
    other_half = np.stack([index, next_upper, upper], axis=1)
    return np.concatenate([one_half, other_half])


def _circle(name: str, sections: int) -> Float[np.ndarray, "s 2"]:
    """Corners of a regular polygon on a circle of radius 1."""
    if sections < 3:
        raise InputError(f"sections={sections} make no {name}: give 3 or more")
    angle = 2.0 * np.pi * np.arange(sections) / sections
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _area_widening(sections: int) -> float:
    """Factor by which a regular polygon gets the area of the circle around it."""
    section_angle = 2.0 * np.pi / sections
    return float(np.sqrt(section_angle / np.sin(section_angle)))


_Rings = list[tuple[float, float]]
"""Radii and heights of circles about z [m], upwards on the outside."""


def _quarter(radius: float, sections: int) -> _Rings:
    # The widest ring first; the pole is no ring.
    ring_count = max(sections // 4, 1)
    latitude = 0.5 * np.pi * np.arange(ring_count) / ring_count
    radii = radius * np.cos(latitude)
    heights = radius * np.sin(latitude)
    return list(zip(radii.tolist(), heights.tolist(), strict=True))


def _with_volume(rings: _Rings, ends: tuple[float, float], volume: float) -> _Rings:
    """Widen rings so that the cones between them, up to both ends, have a volume."""
    bottom, top = ends
    r, z = np.array([(0.0, bottom), *rings, (0.0, top)]).T
    lower = r[:-1]
    upper = r[1:]
    between = np.diff(z) * (upper**2 + upper * lower + lower**2)
    cone_volume = np.pi / 3.0 * between.sum()
    factor = float(np.sqrt(volume / cone_volume))
    return [(factor * radius, height) for radius, height in rings]


def _revolved(
    name: str,
    rings: _Rings,
    sections: int,
    has_ends: bool = True,
    ends: tuple[float, float] | None = None,
) -> Mesh:
    """Body of revolution about z, through the rings and to its axis at both ends.

    The `ends` [m] are flat at the first and last ring if not given; without them the
    rings close on themselves, around a hole.
    """
    circle = _circle(name, sections) * _area_widening(sections)
    points = []
    for radius, height in rings:
        level = np.full(sections, height)
        ring = np.column_stack([radius * circle, level])
        points.append(ring)
    index = np.arange(sections)
    next_index = np.roll(index, -1)
    starts = sections * np.arange(len(rings))
    faces = []
    for low, high in zip(starts, np.roll(starts, -1), strict=True):
        if high > low or not has_ends:
            a = low + index
            b = low + next_index
            c = high + next_index
            d = high + index
            faces.append(np.stack([a, b, c], axis=1))
            faces.append(np.stack([a, c, d], axis=1))
    if has_ends:
        bottom, top = ends or (rings[0][1], rings[-1][1])
        points.append(np.array([[0.0, 0.0, bottom], [0.0, 0.0, top]]))
        pole = np.full(sections, sections * len(rings))
        last = starts[-1]
        faces.append(np.stack([pole, next_index, index], axis=1))
        faces.append(np.stack([pole + 1, last + index, last + next_index], axis=1))
    return Mesh(vertices=np.concatenate(points), faces=np.concatenate(faces), name=name)


def _icosahedron() -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Icosahedron of radius 1: two poles and two rings of five at z = +-1/sqrt(5)."""
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    z = 1.0 / np.sqrt(5.0)
    turned = angle + np.pi / 5
    upper = np.column_stack([2 * z * np.cos(angle), 2 * z * np.sin(angle)])
    lower = np.column_stack([2 * z * np.cos(turned), 2 * z * np.sin(turned)])
    points = np.zeros((12, 3))
    points[0, 2] = 1.0
    points[11, 2] = -1.0
    points[1:6, :2] = upper
    points[1:6, 2] = z
    points[6:11, :2] = lower
    points[6:11, 2] = -z
    u = np.arange(1, 6)
    n = np.roll(u, -1)
    faces = [
        np.stack([np.zeros(5, int), u, n], axis=1),
        np.stack([u, u + 5, n], axis=1),
        np.stack([n, u + 5, n + 5], axis=1),
        np.stack([np.full(5, 11), n + 5, u + 5], axis=1),
    ]
    return points, np.concatenate(faces)


def _cut_in_four(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    next_corners = np.roll(faces, -1, axis=1)
    directed_sides = np.stack([faces, next_corners], axis=-1)
    sides = np.sort(directed_sides, axis=-1)
    ends, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    middles = unit_vectors(points[ends].mean(1))
    ab, bc, ca = (number.reshape(-1, 3) + len(points)).T
    a, b, c = faces.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    cut = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return np.concatenate([points, middles]), cut
