"""Triangle mesh: geometry, connectivity, a report of its quality, and placement."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from equinox import Module
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import in_sorted, linear_map, numbered, static_numbers
from ..errors import InputError, require, shortened
from ..shown import html_of
from .rotation import Turn, Way, relative_key, shortest_way, way_by_angle
from .vectors import triple, unit_vector


_ROUNDING = 1e-7
"""Area over the square of an extent, or volume over area and extent, that rounding of
float32 positions gives to what has none [-]."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in metres, z up, counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "v 3"]
    """Positions [m]."""
    faces: Int[np.ndarray, "f 3"]
    name: str = "mesh"
    axes: tuple[str, str, str] = ("x", "y", "z")
    """Names of our axes in the file, e.g. ("x", "-z", "y") for a file with y up."""
    repairs: dict[str, int] = field(default_factory=dict)
    """Number of repaired defects by kind."""

    def __post_init__(self):
        try:
            vertices = np.asarray(self.vertices)
            faces = np.asarray(self.faces)
        except ValueError as error:  # rows of different lengths
            raise InputError(f"Mesh: give rows of three numbers: {error}") from error
        if vertices.dtype.kind not in "fiu" or vertices.shape[1:] != (3,):
            raise InputError(
                f"Mesh(vertices=): got {vertices.dtype} of shape {vertices.shape}: "
                "give three numbers for each vertex, in metres"
            )
        if not np.isfinite(vertices).all():
            raise InputError("Mesh(vertices=): some are NaN or infinite: remove them")
        if faces.dtype.kind not in "iu" or faces.shape[1:] != (3,):
            raise InputError(
                f"Mesh(faces=): got {faces.dtype} of shape {faces.shape}: give three "
                "whole numbers for each face, the numbers of its vertices from 0"
            )
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise InputError(
                f"Mesh(faces=): its numbers are {faces.min()} to {faces.max()}, and "
                f"there are {len(vertices)} vertices: count from 0"
            )
        # Lists, and whole numbers as positions, are taken as arrays.
        positions = vertices.astype(np.result_type(vertices, np.float32), copy=False)
        object.__setattr__(self, "vertices", positions)
        object.__setattr__(self, "faces", faces)

    def _repr_html_(self) -> str:
        return html_of(self)

    @property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Corner positions of each face [m]."""
        return self.vertices.take(self.faces, axis=0)

    @property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box [m]."""
        # Only of vertices that a face uses: scans have stray vertices far away.
        is_used = np.zeros(len(self.vertices), bool)
        is_used[self.faces] = True
        used = self.vertices[is_used].T
        lower = [axis.min() for axis in used]
        upper = [axis.max() for axis in used]
        return np.array([lower, upper])

    @property
    def area_vectors(self) -> Float[np.ndarray, "f 3"]:
        """Outward normal times area of each face [m^2]."""
        # Component by component: numpy is slow along an axis of length three.
        points = np.ascontiguousarray(self.vertices.T)
        corners = [
            points.take(corner, axis=1) for corner in np.ascontiguousarray(self.faces.T)
        ]
        return np.stack(area_components(*corners), axis=1)

    @property
    def area(self) -> float:
        """Surface area [m^2]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem [m^3]; meaningful if watertight."""
        # About the centre: far from the origin the terms would cancel digits.
        centred = self.triangles - self.bounds.mean(0)
        return float((centred.mean(1) * self.area_vectors).sum() / 3.0)

    @property
    def has_extent(self) -> bool:
        """True if the faces have an area: they are no point and no line."""
        extent = float(np.ptp(self.bounds, axis=0).max())
        return self.area > _ROUNDING * extent**2

    @property
    def encloses_volume(self) -> bool:
        """True if the surface is closed and not flattened."""
        extent = float(np.ptp(self.bounds, axis=0).max())
        return self.is_watertight and self.volume > _ROUNDING * self.area * extent

    @property
    def is_watertight(self) -> bool:
        """True if every edge is used equally often in both directions."""
        return self.open_edges == 0

    @property
    def open_edges(self) -> int:
        """Number of directed edges without an opposite partner."""
        return int(np.abs(edges_of(self.faces).balance).sum())

    def moved(self, offset: tuple[float, float, float] | np.ndarray) -> "Mesh":
        """Translate by `offset` [m]."""
        return replace(self, vertices=self.vertices + np.asarray(offset, float))

    def placed(self, pose: "Pose") -> "Mesh":
        """Rotate and translate by a pose."""
        return replace(self, vertices=pose.to_world(self.vertices))


def joined(
    meshes: Sequence[tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, "_ 3"]]],
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices and faces of several meshes, one after the other, as of a single one."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + n for (_, faces), n in zip(meshes, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def area_components(
    a: Float[np.ndarray, "3 f"],
    b: Float[np.ndarray, "3 f"],
    c: Float[np.ndarray, "3 f"],
) -> list[Float[np.ndarray, " f"]]:
    """Components of normal times area, from the components of the three corners."""
    ux, uy, uz = b - a
    vx, vy, vz = c - a
    return [
        (uy * vz - uz * vy) / 2,
        (uz * vx - ux * vz) / 2,
        (ux * vy - uy * vx) / 2,
    ]


def part_volumes(
    mesh: Mesh, labels: Int[np.ndarray, "f"], count: int
) -> Float[np.ndarray, "parts"]:
    """Signed volume of each connected part [m^3]."""
    # About each part's own centre, so that open parts get a volume near their bulge
    # and not one that depends on the origin.
    centre = mesh.triangles.mean(1)
    weight = np.bincount(labels, minlength=count)
    origin = np.stack(
        [np.bincount(labels, axis, count) / weight for axis in centre.T], axis=1
    )
    cone = ((centre - origin[labels]) * mesh.area_vectors).sum(1) / 3.0
    return np.bincount(labels, cone, count)


def winding_number(
    triangles: Float[np.ndarray, "f 3 3"], point: Float[np.ndarray, "3"]
) -> float:
    """Winding number of a surface around a point [-]: solid angle over 4 pi.

    1 inside a closed surface, 0 outside. Near a whole number also for surfaces with
    small holes, where counting the hits of one ray fails.

    Source: Van Oosterom and Strackee, "The solid angle of a plane triangle" (1983).
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    triple = (a * np.cross(b, c)).sum(1)
    ab = (a * b).sum(1)
    bc = (b * c).sum(1)
    ca = (c * a).sum(1)
    base = la * lb * lc + ab * lc + bc * la
    base += ca * lb
    # arctan2 gives half the solid angle, with its sign and beyond pi / 2.
    return float(np.arctan2(triple, base).sum() / (2.0 * np.pi))


def describe_mesh(mesh: Mesh) -> dict:
    """Facts about a mesh as plain types, ready for JSON.

    `area` [m^2], `volume` [m^3] (None if the mesh is open), `size` along x, y, z [m];
    `bodies` counts the connected parts that point outward or are open, `cavities` the
    closed ones that point inward.
    """
    labels = part_labels(mesh.faces)
    part_count = int(labels.max(initial=-1)) + 1
    closed = is_closed(edges_of(mesh.faces), labels, part_count)
    inward = part_volumes(mesh, labels=labels, count=part_count) < 0.0
    cavities = int((closed & inward).sum())
    return {
        "name": mesh.name,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "watertight": mesh.is_watertight,
        "open_edges": mesh.open_edges,
        "volume": mesh.volume if mesh.is_watertight else None,
        "area": mesh.area,
        "size": [float(side) for side in np.ptp(mesh.bounds, axis=0)],
        "bodies": part_count - cavities,
        "cavities": cavities,
        "axes": list(mesh.axes),
        "repairs": dict(mesh.repairs),
    }


def mesh_summary(mesh: Mesh) -> str:
    """One line for the terminal: watertight or open, size, parts and repairs."""
    facts = describe_mesh(mesh)
    width, depth, height = facts["size"]
    if facts["watertight"]:
        state = f"watertight, volume {facts['volume']:.4g} m^3"
    else:
        state = f"open ({_count(facts['open_edges'], 'open edge')}), no volume"
    bodies = _count(facts["bodies"], "body", "bodies")
    if facts["cavities"]:
        bodies += f" with {_count(facts['cavities'], 'cavity', 'cavities')}"
    repairs = ", ".join(
        f"{number} {defect.replace('_', ' ')}"
        for defect, number in facts["repairs"].items()
    )
    return (
        f"{facts['name']}: {facts['faces']:,} faces, {state}, area {facts['area']:.4g} "
        f"m^2, {width:.4g} x {depth:.4g} x {height:.4g} m, {bodies}; "
        f"repaired: {repairs or 'nothing'}"
    )


def _count(number: int, singular: str, plural: str | None = None) -> str:
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


@dataclass(frozen=True)
class Edges:
    """Edge table of a mesh; half-edge `3 f + i` leaves corner i of face f."""

    start: Int[np.ndarray, "h"]
    end: Int[np.ndarray, "h"]
    edge: Int[np.ndarray, "h"]
    """Number of the undirected edge of each half-edge."""
    uses: Int[np.ndarray, "e"]
    """Half-edges along each edge: 2 on a closed surface."""
    first: Int[np.ndarray, "e"]
    """First half-edge of each edge."""
    low: Int[np.ndarray, "e"]
    """Vertex of each edge with the lower number; sorted, those of one by `high`."""
    high: Int[np.ndarray, "e"]
    order: Int[np.ndarray, "h"]
    """Half-edges, sorted by their edges."""

    @property
    def balance(self) -> Int[np.ndarray, "e"]:
        """Half-edges towards the higher vertex minus those towards the lower one."""
        upward = np.where(self.start < self.end, 1.0, -1.0)
        sums = np.bincount(self.edge, weights=upward, minlength=len(self.uses))
        return sums.astype(np.int64)

    @property
    def pairs(self) -> Int[np.ndarray, "p 2"]:
        """Both half-edges of the edges that have two."""
        return self.order[np.repeat(self.uses == 2, self.uses)].reshape(-1, 2)

    @property
    def border(self) -> Int[np.ndarray, " b"]:
        """Half-edges of the free border, along which there is no other face."""
        return np.flatnonzero(self.uses[self.edge] == 1)

    def joins(self, ends: Int[np.ndarray, "p 2"]) -> Bool[np.ndarray, " p"]:
        """Flag pairs of vertices that an edge joins."""
        width = int(max(self.high.max(initial=0), ends.max(initial=0))) + 1
        key = self.low * width + self.high
        return in_sorted(ends.min(axis=1) * width + ends.max(axis=1), key)


def edges_of(faces: Int[np.ndarray, "f 3"]) -> Edges:
    """Build the edge table of a mesh."""
    start = faces.reshape(-1).astype(np.int64, copy=False)
    end = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64, copy=False)
    # One integer per edge, which sorts faster than rows of two.
    bits = int(faces.max(initial=0)).bit_length()
    edges = numbered(np.minimum(start, end) << bits | np.maximum(start, end))
    return Edges(
        start=start,
        end=end,
        edge=edges.number,
        uses=np.bincount(edges.number, minlength=len(edges.first)),
        first=edges.first,
        low=edges.value >> bits,
        high=edges.value & ((1 << bits) - 1),
        order=edges.order,
    )


def part_labels(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f"]:
    """Label the faces from 0 by connected part, connected over edges."""
    if not len(faces):
        return np.zeros(0, np.int64)
    edges = edges_of(faces)
    # All faces along an edge link to the first one there: a star is enough.
    links = np.stack([np.arange(len(edges.edge)), edges.first[edges.edge]], 1) // 3
    roots = connected_labels(len(faces), links)
    _, labels = np.unique(roots, return_inverse=True)
    return labels.astype(np.int64)


def connected_labels(
    count: int, links: Int[np.ndarray, "l 2"]
) -> Int[np.ndarray, "count"]:
    """Label each node of a graph with the lowest node of its connected part."""
    # Truth values, since a link may occur often: sums of its numbers could wrap to 0.
    linked = np.ones(len(links), bool)
    graph = coo_array((linked, tuple(links.T)), shape=(count, count))
    parts, component = connected_components(graph, directed=False)
    lowest_node = np.empty(parts, np.int64)
    # The last one that is written stays.
    lowest_node[component[::-1]] = np.arange(count)[::-1]
    return lowest_node[component]


def is_closed(
    edges: Edges, labels: Int[np.ndarray, "f"], count: int
) -> Bool[np.ndarray, "parts"]:
    """Flag the parts in which every edge is used equally often in both directions."""
    open_edge = edges.balance[edges.edge] != 0
    touched = np.bincount(np.repeat(labels, 3)[open_edge], minlength=count)
    return touched == 0


if TYPE_CHECKING:
    from trimesh import Trimesh

    AnyMesh = Mesh | Trimesh
else:
    # Checked by `as_mesh`, which says what to give instead.
    AnyMesh = Any


def as_mesh(mesh: Any, argument: str = "voxelize(mesh=)") -> Mesh:
    """Convert anything with vertices [m] and triangular faces, as a `trimesh.Trimesh`.

    Raises:
        InputError: for anything else, or faces with vertices that do not exist.
    """
    if isinstance(mesh, Mesh):
        return mesh
    # By attributes, not by class: trimesh is slow to import, and only files need it.
    arrays = [getattr(mesh, name, None) for name in ("vertices", "faces")]
    if isinstance(mesh, type) or any(array is None for array in arrays):
        require(
            mesh,
            classes=Mesh,
            argument=argument,
            give="a mesh: load_mesh(...), or one of trimesh",
        )
    # Copies as plain arrays: those of trimesh track changes.
    vertices, faces = (np.array(array) for array in arrays)
    return Mesh(vertices, faces)


def _are_finite(numbers: Any, shape: tuple[int, ...]) -> bool:
    try:
        array = np.asarray(numbers, float)
    except (TypeError, ValueError):
        return False
    return array.shape == shape and bool(np.isfinite(array).all())


class Pose(Module):
    """Rigid placement of a body in the world: x -> rotation x + translation."""

    translation: tuple[float, float, float] = static_numbers((0.0, 0.0, 0.0))
    """Position of the body's origin in the world [m]."""
    rotation: tuple[tuple[float, float, float], ...] = static_numbers(
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    """Rows of a rotation matrix [-]."""
    turn: Turn | None = eqx.field(static=True, default=None, kw_only=True)
    """The same rotation by axis and angle, which counts full turns; see `about`."""

    @staticmethod
    def about(
        axis: object,
        angle: float,
        translation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> "Pose":
        """Return a pose turned right-handed about an axis through the body's origin.

        Between two such poses of one axis a body in motion turns by the difference of
        their angles [rad], also by full turns.

        Raises:
            InputError: if the axis has no direction, or the angle is not finite.
        """
        x, y, z = unit_vector(axis, "Pose.about(axis=)").tolist()
        if not np.isfinite(angle):
            raise InputError(f"Pose.about(angle={angle!r}): give a finite angle [rad]")
        turn = Turn((x, y, z), float(angle))
        return Pose(translation, turn.rotation, turn=turn)

    def way_to(self, pose: "Pose") -> Way:
        """Return the rotation by which a body turns from this pose to another one."""
        first = _turn_of(self)
        second = _turn_of(pose)
        by_angle = None
        if first is not None and second is not None:
            by_angle = way_by_angle(first, second)
        return by_angle or shortest_way(self.rotation, pose.rotation)

    def __check_init__(self):
        if not _are_finite(self.translation, (3,)):
            raise InputError(
                f"Pose(translation={shortened(self.translation)}): give three finite "
                "numbers, in metres"
            )
        rotation = self.rotation
        matrix = np.asarray(rotation if _are_finite(rotation, (3, 3)) else 0.0, float)
        if matrix.shape != (3, 3) or not (
            np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6)
            and np.linalg.det(matrix) > 0
        ):
            raise InputError(
                f"Pose(rotation={shortened(rotation)}): give a 3 x 3 rotation matrix"
            )

    @property
    def key(self) -> tuple[tuple, tuple]:
        """Its numbers, by which equal poses are recognized."""
        return self.translation, self.rotation

    def relative_key(self, other: "Pose", length: float) -> tuple[tuple, tuple]:
        """Place of another body in the frame of this one, as numbers to compare.

        They are in steps of a millionth of a length [m], which rounding does not reach:
        bodies that move together keep them.
        """
        return relative_key(self.key, other.key, length)

    def after(self, first: "Pose") -> "Pose":
        """The pose that places a body by another pose first, then by this one."""
        if first == Pose():
            return self
        if self == Pose():
            return first
        shift = triple(self.to_world(np.asarray(first.translation, float)))
        rotation = np.asarray(self.rotation) @ np.asarray(first.rotation)
        return Pose(shift, tuple(map(tuple, rotation.tolist())))

    def to_world(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform points from the body to the world [m]."""
        return self.rotate(points) + np.asarray(self.translation, float)

    def rotate(self, vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Rotate directions from the body to the world."""
        return linear_map(vectors, np.asarray(self.rotation, float).T)

    def to_body(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Transform points from the world to the body [m]."""
        return self.rotate_back(points - np.asarray(self.translation, float))

    def rotate_back(
        self, vectors: Float[np.ndarray, "*n 3"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Rotate directions from the world to the body."""
        return linear_map(vectors, np.asarray(self.rotation, float))

    def at(self, time: float) -> "Pose":
        """Pose at a time [s], here always the same."""
        del time
        return self


def _turn_of(pose: Pose) -> Turn | None:
    """The turn of a pose; without a rotation it is 0 about any axis."""
    if pose.turn is None and pose.rotation == Pose().rotation:
        return Turn((0.0, 0.0, 1.0), 0.0)
    return pose.turn
