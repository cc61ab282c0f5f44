"""Seams between bodies: where the free border of a sheet meets another body.

A free border is sampled by four points on each edge of the cells' triangles. A point
within a distance of another body, across the border and not along it, belongs to a
seam: with the border of a sheet that is as near, with a face of a sheet, or with the
surface of a solid on which the sheet ends. The seam of two borders is counted once.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from ...arrays import Scalar
from ...errors import InputError
from ...geometry.mesh import edges_of
from ...geometry.nearby import NearestTriangles, nearest_triangles, overlapping_boxes
from ...geometry.vectors import row_dot, triangle_normals, unit_vectors
from ...memo.stored import stored_search
from ...sheets.sheet_grid import SheetGrid
from ...sheets.surface import proper_faces
from ..together import found_between
from .rays import PlacedGrid
from .search import SHEET_GAP
from .shares import fragment_shares


_SAMPLES = 4
"""Points on each edge of a border."""

_MAX_COSINE = 0.7
"""Cosine over which two lines are along each other."""

_NEIGHBOURS = 8
"""Points of a border among which the nearest one along another border is searched."""

_ROUNDING = 1e-6
"""Length of a way that rounding makes, over the gap [-]."""


class SeamPairs(NamedTuple):
    """Pieces of a seam of a body A and a body B, one for each pair of fragments.

    At its border a sheet has the fragment of the face from which its depth counts, so
    that equal depths meet.
    """

    fragment_a: Int[np.ndarray, " p"]
    fragment_b: Int[np.ndarray, " p"]
    on_face_a: Bool[np.ndarray, " p"]
    """True where the seam is on a face or a solid, False at the border of a sheet."""
    on_face_b: Bool[np.ndarray, " p"]
    length: Float[np.ndarray, " p"]
    """[m]; 0 in the padding."""

    @classmethod
    def none(cls) -> "SeamPairs":
        """No seam."""
        no_fragments = np.zeros(0, np.int64)
        no_faces = np.zeros(0, bool)
        return cls(no_fragments, no_fragments, no_faces, no_faces, np.zeros(0))

    @classmethod
    def joined(cls, parts: "list[SeamPairs]") -> "SeamPairs":
        """Pieces of all parts, those of the same two ends as one."""
        rows = np.concatenate([np.stack(part[:4], axis=1) for part in parts])
        ends, piece = np.unique(rows, axis=0, return_inverse=True)
        length = np.concatenate([part.length for part in parts])
        return cls(
            fragment_a=ends[:, 0],
            fragment_b=ends[:, 1],
            on_face_a=ends[:, 2] > 0,
            on_face_b=ends[:, 3] > 0,
            length=np.bincount(piece.reshape(-1), length, len(ends)),
        )

    @property
    def rows(self) -> int:
        """Number of pieces, with the padding."""
        return len(self.length)

    def swapped(self) -> "SeamPairs":
        """Same pieces with A and B exchanged."""
        return SeamPairs(
            fragment_a=self.fragment_b,
            fragment_b=self.fragment_a,
            on_face_a=self.on_face_b,
            on_face_b=self.on_face_a,
            length=self.length,
        )

    def shifted(self, first_a: int, first_b: int) -> "SeamPairs":
        """Same pieces with fragments counted from others before those of A and of B."""
        return self._replace(
            fragment_a=self.fragment_a + first_a, fragment_b=self.fragment_b + first_b
        )

    def padded(self, capacity: int, names: str) -> "SeamPairs":
        """Same pieces in arrays of `capacity` rows, padded with the length 0.

        Raises:
            InputError: naming the bodies, if there are more pieces.
        """
        spare = capacity - self.rows
        if spare < 0:
            raise InputError(
                f"seam of {names}: {self.rows} pieces and room for {capacity}; give a "
                "larger capacity or a coarser pitch"
            )
        return SeamPairs(*(np.pad(column, (0, spare)) for column in self))


class _Samples(NamedTuple):
    """Points on the free border of a sheet, in the world."""

    point: Float[np.ndarray, "k 3"]
    """[m]"""
    length: Float[np.ndarray, " k"]
    """Length of the border that each stands for [m]."""
    fragment: Int[np.ndarray, " k"]
    """Fragment of the front."""
    normal: Float[np.ndarray, "k 3"]
    """Normal of the front."""
    inward: Float[np.ndarray, "k 3"]
    """Vector from the border into the sheet."""
    along: Float[np.ndarray, "k 3"]
    """Unit vector along the border."""

    def of(self, which: Int[np.ndarray, " n"]) -> "_Samples":
        """Some of the points."""
        return _Samples(*(column[which] for column in self))


@dataclass(frozen=True, eq=False)
class _Outline:
    """A placed body with its free border and its triangles in the world."""

    body: PlacedGrid

    @cached_property
    def samples(self) -> _Samples | None:
        """Points on the free border; None without one."""
        grid = self.body.grid
        if not isinstance(grid, SheetGrid) or not grid.cells.border:
            return None
        proper = np.flatnonzero(proper_faces(grid.cells.faces))
        edges = edges_of(grid.cells.faces[proper])
        alone = edges.border
        triangle = proper[alone // 3]
        corner = alone % 3
        corners = self.triangles[triangle]
        rows = np.arange(len(alone))
        start = corners[rows, corner]
        along = corners[rows, (corner + 1) % 3] - start
        fraction = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        point = start[:, None] + fraction[:, None] * along[:, None]
        of_corner = grid.cells.fragments.of_corner[triangle]
        ends = np.stack(
            [of_corner[rows, corner], of_corner[rows, (corner + 1) % 3]], axis=1
        )
        inward = corners[rows, (corner + 2) % 3] - start
        return _Samples(
            point=point.reshape(-1, 3),
            length=np.repeat(np.linalg.norm(along, axis=1) / _SAMPLES, _SAMPLES),
            fragment=np.repeat(ends, _SAMPLES // 2, axis=1).reshape(-1),
            normal=np.repeat(triangle_normals(corners), _SAMPLES, axis=0),
            inward=np.repeat(inward, _SAMPLES, axis=0),
            along=np.repeat(unit_vectors(along), _SAMPLES, axis=0),
        )

    @cached_property
    def triangles(self) -> Float[np.ndarray, "t 3 3"]:
        """Triangles of the surface [m]."""
        grid = self.body.grid
        mesh = grid.cells if isinstance(grid, SheetGrid) else grid.mesh
        return self.body.pose.to_world(mesh.vertices)[mesh.faces]


@stored_search("seams", (SeamPairs,))
def seams_between(
    bodies: tuple[PlacedGrid, ...], threshold: Scalar | None = None
) -> dict[tuple[int, int], SeamPairs]:
    """Seams of all pairs i < j of bodies; those of two that move together once.

    `threshold` is the largest gap of a seam [m]; None for a tenth of a cell of the
    finer body.
    """
    outlines = [_Outline(body) for body in bodies]
    gaps = np.array(
        [SHEET_GAP * body.pitch if threshold is None else threshold for body in bodies]
    )
    bounds = np.stack([body.world_bounds for body in bodies])
    seams = {}
    for i, j in overlapping_boxes(
        bounds[:, 0] - gaps[:, None], bounds[:, 1] + gaps[:, None]
    ).tolist():
        gap = float(gaps[[i, j]].min())
        pairs = found_between(
            (bodies[i].grid, bodies[j].grid),
            poses=(bodies[i].pose, bodies[j].pose),
            by=("seam", gap),
            find=partial(_both_seams, outlines[i], outlines[j], gap),
            search="seams of bodies",
        )
        if pairs.rows:
            seams[i, j] = pairs
    return seams


def _both_seams(a: _Outline, b: _Outline, gap: float) -> SeamPairs:
    """Seams of the borders of both bodies."""
    parts = [
        _seam(a, b, gap, counts_borders=True),
        _seam(b, a, gap, counts_borders=False).swapped(),
    ]
    return SeamPairs.joined(parts)


def _seam(a: _Outline, b: _Outline, gap: float, counts_borders: bool) -> SeamPairs:
    """Seam of the border of A with B, with B's border too if that counts here."""
    if a.samples is None:
        return SeamPairs.none()
    low, high = b.body.world_bounds
    near = (a.samples.point >= low - gap) & (a.samples.point <= high + gap)
    samples = a.samples.of(np.flatnonzero(near.all(axis=1)))
    hits = nearest_triangles(samples.point, b.triangles, gap)
    # Beyond the end of a seam the way to B goes along the border.
    way = hits.point - samples.point[hits.sample]
    along = np.abs(row_dot(way, samples.along[hits.sample]))
    is_across = along <= _MAX_COSINE * np.linalg.norm(way, axis=1) + _ROUNDING * gap
    hits = hits.of(np.flatnonzero(is_across))
    if not len(hits.sample):
        return SeamPairs.none()
    touching = samples.of(hits.sample)
    at_border, fragment_b = _on_border(touching, b, gap)
    parts = [_on_surface(touching, b, hits, np.flatnonzero(~at_border))]
    if counts_borders:
        on_face = np.zeros(int(at_border.sum()), bool)
        parts.append(
            SeamPairs(
                fragment_a=touching.fragment[at_border],
                fragment_b=fragment_b[at_border],
                on_face_a=on_face,
                on_face_b=on_face,
                length=touching.length[at_border],
            )
        )
    return SeamPairs.joined(parts)


def _on_border(
    samples: _Samples, b: _Outline, gap: float
) -> tuple[Bool[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Samples at the border of B, and the fragment of B next to each.

    Of the face that turns the same way as the front of the sample's sheet.
    """
    if b.samples is None:
        return np.zeros(len(samples.point), bool), np.zeros(len(samples.point), int)
    neighbours = min(_NEIGHBOURS, len(b.samples.point))
    distances, numbers = KDTree(b.samples.point).query(samples.point, k=neighbours)
    # One neighbour has no column of its own.
    distance = np.reshape(distances, (-1, neighbours))
    near = np.reshape(numbers, (-1, neighbours))
    # Points between two samples of a border are up to half their distance from one.
    is_near = distance <= np.hypot(gap, b.samples.length[near] / 2)
    # A border that crosses is beside the seam.
    along = np.einsum("ki,kni->kn", samples.along, b.samples.along[near])
    is_near &= np.abs(along) > _MAX_COSINE
    rows = np.arange(len(samples.point))
    nearest = near[rows, is_near.argmax(axis=1)]
    assert isinstance(b.body.grid, SheetGrid)
    count = len(b.body.grid.cells.fragments.area)
    is_opposite = row_dot(samples.normal, b.samples.normal[nearest]) < 0
    return is_near.any(axis=1), b.samples.fragment[nearest] + count * is_opposite


def _on_surface(
    touching: _Samples,
    b: _Outline,
    hits: NearestTriangles,
    which: Int[np.ndarray, " n"],
) -> SeamPairs:
    """Seam of some of the samples with the surface of B."""
    if not len(which):
        return SeamPairs.none()
    samples = touching.of(which)
    on_b = hits.of(which)
    normal = triangle_normals(b.triangles[on_b.triangle])
    shares = fragment_shares(
        b.body.grid,
        point=b.body.pose.to_body(on_b.point),
        triangle=on_b.triangle,
        is_back=row_dot(samples.inward, normal) < 0,
    )
    parts = []
    for fragment, share in shares:
        exists = fragment >= 0
        count = int(exists.sum())
        parts.append(
            SeamPairs(
                fragment_a=samples.fragment[exists],
                fragment_b=fragment[exists],
                on_face_a=np.zeros(count, bool),
                on_face_b=np.ones(count, bool),
                length=(samples.length * share)[exists],
            )
        )
    return SeamPairs.joined(parts)
