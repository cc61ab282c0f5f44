"""View of a solved scene: the geometry of an image, computed once for all frames.

The temperature of a pixel is a weighted mean of the fragments within two voxels. The
weights depend on the view only: a frame costs one sparse product.
"""

from dataclasses import dataclass, fields
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from ..findings import found
from ..physics.term import AbstractTerm
from ..scene.scene import BodyGeometry, SolvedSurface
from ..stored_findings import stored
from .background import Background, compute_background
from .camera import AbstractCamera
from .facets import FacetShading, facet_shading, joined_shadings, smooth_normals
from .fragment_cells import CHUNK, block_matrix, cells_of
from .moving_weights import MovingWeights
from .ssao import screen_space_occlusion
from .visible import VisiblePoints, visible_points, world_meshes


SMOOTHING_RADIUS = 2.0
"""Radius of the weights [voxels]; from 1.4 it includes a fragment of any surface."""


def _nearest_fragments(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> Int[np.ndarray, " p"]:
    # With any normal. Only points without a fragment in range search twice as far.
    found = np.full(len(points), -1, np.int64)
    radius = geometry.pitch
    while (missing := np.flatnonzero(found < 0)).size:
        radius *= 2
        cells = cells_of(geometry, radius)
        for part in np.array_split(missing, len(missing) // CHUNK + 1):
            owner, fragment, _ = cells.pairs(points[part])
            offset = points[part][owner] - geometry.fragment_position[fragment]
            distance = np.einsum("ij,ij->i", offset, offset)
            order = np.lexsort([distance, owner])
            owners, first = np.unique(owner[order], return_index=True)
            found[part[owners]] = fragment[order][first]
    return found


def smooth_weights(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    geometry: BodyGeometry,
) -> csr_array:
    """Weights [p, s] of a body's fragments at each point."""
    # Parts too thin to have fragments show the nearest ones.
    nearest = lambda alone: _nearest_fragments(points[alone], geometry)
    cells = cells_of(geometry, SMOOTHING_RADIUS * geometry.pitch)
    return cells.means(points, normals, otherwise=nearest)


def _block_weights(
    points: Float[np.ndarray, "p 3"], geometry: BodyGeometry
) -> csr_array:
    # The nearest fragment alone: the image shows the voxels.
    nearest, starts = _nearest_fragments(points, geometry), np.arange(len(points) + 1)
    size = len(points), len(geometry.fragment_area)
    return csr_array((np.ones(len(points)), nearest, starts), size)


@dataclass(frozen=True, eq=False)
class View:
    """Time-independent data of the p pixels that show a body."""

    camera: AbstractCamera
    pixel: Int[np.ndarray, " p"]
    """Index of each pixel, rows first."""
    body: Int[np.ndarray, " p"]
    """Number of the body."""
    depth: Float[np.ndarray, " p"]
    """Depth along the optical axis [m]."""
    normal: Float[np.ndarray, "p 3"]
    """Outward normal in the world, of the smooth surface that the mesh approximates."""
    weights: csr_array | MovingWeights
    """Weights [p, s] of the concatenated fragments of all bodies."""
    background: Background
    open_fraction: Float[np.ndarray, " p"] | None = None
    """Fraction of the surroundings that nothing in the image hides; None for all."""
    facets: FacetShading | None = None
    """Reflection on large facets of curved surfaces; None without any."""
    part: Int[np.ndarray, " p"] | None = None
    """Number of the part within its body, -1 where it has none; None without any."""
    part_names: tuple[tuple[str, ...], ...] = ()
    """Names of the parts of every body."""


def at_time(
    surfaces: tuple[SolvedSurface, ...], terms: tuple[AbstractTerm, ...], time: float
) -> tuple[tuple[SolvedSurface, ...], tuple[AbstractTerm, ...]]:
    """Bodies and sources at their positions at a time [s]."""
    return tuple(s.at(time) for s in surfaces), tuple(t.at(time) for t in terms)


def compute_view(
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    camera: AbstractCamera,
    smooth: bool = True,
    occlusion: float | None = None,
    keep: bool = True,
) -> View:
    """Compute the surface point and the interpolation weights of each pixel.

    With `occlusion` [m], surfaces in the image hide the surroundings from others that
    are not farther away. A view that no other process will ask for is not worth to
    `keep` in the user's cache, and only the first one of a body is.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    given = camera, smooth, occlusion, [_content(s.geometry) for s in surfaces]
    # The first view of a body takes longer, by what is found once for all. Others are
    # found in the time in which their 20 MB are hashed and written.
    views, known = [_views_of(s.geometry) for s in surfaces], (_Shown, FacetShading)
    keep = keep and not all(each["are found"] for each in views)

    def find() -> _Shown:
        for each in views:
            each["are found"] = True
        return _shown(surfaces, camera=camera, smooth=smooth, occlusion=occlusion)

    shown = stored("view", given=given, find=find, types=known) if keep else find()
    background = compute_background(
        terms, camera=camera, pixel=shown.pixel, depth=shown.depth
    )
    return View(
        camera,
        *(shown.pixel, shown.body, shown.depth, shown.normal, shown.weights),
        background,
        shown.open_fraction,
        shown.facets,
        _parts(surfaces, shown.weights),
        tuple(surface.geometry.part_names for surface in surfaces),
    )


def _parts(
    surfaces: tuple[SolvedSurface, ...], weights: csr_array
) -> Int[np.ndarray, " p"] | None:
    """Part of the fragment with the largest weight at each pixel."""
    given = [s.geometry.fragment_part for s in surfaces]
    if all(part is None for part in given):
        return None
    sizes = [len(s.geometry.fragment_area) for s in surfaces]
    parts = [
        np.full(size, -1, np.int32) if part is None else part
        for part, size in zip(given, sizes, strict=True)
    ]
    # The means of pixels have at least one fragment each.
    largest = np.maximum.reduceat(weights.data, weights.indptr[:-1])
    row = np.repeat(np.arange(len(largest)), np.diff(weights.indptr))
    (entry,) = np.nonzero(weights.data == largest[row])
    _, first = np.unique(row[entry], return_index=True)
    return np.concatenate(parts)[weights.indices[entry[first]]]


def _content(geometry: BodyGeometry) -> tuple[Any, ...]:
    """All that a view depends on of a body, at its pose."""
    fragments = geometry.fragment_position, geometry.fragment_normal
    mesh = geometry.vertices, geometry.faces
    return *mesh, *fragments, geometry.fragment_area, geometry.pitch, geometry.placed


def _views_of(geometry: BodyGeometry) -> dict[str, bool]:
    """Record of a body: whether this process found any view of it."""
    of = geometry.vertices, geometry.faces, geometry.fragment_position
    return found(of, "views", lambda: {"are found": False})


class _Shown(NamedTuple):
    """Pixels that show a body: the fields of a `View` that follow from geometry."""

    pixel: Int[np.ndarray, " p"]
    body: Int[np.ndarray, " p"]
    depth: Float[np.ndarray, " p"]
    normal: Float[np.ndarray, "p 3"]
    weights: csr_array
    open_fraction: Float[np.ndarray, " p"] | None
    facets: FacetShading | None


def _shown(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    smooth: bool,
    occlusion: float | None,
) -> _Shown:
    found = visible_points(world_meshes(surfaces), camera)
    local, normal = in_bodies(surfaces, found)
    pixel, body, depth = found.pixel, found.body, found.depth
    weights = all_weights(
        surfaces, body=body, local=local, normal=normal, smooth=smooth
    )
    facets = _all_facets(surfaces, found, local) if smooth else None
    shown = _Shown(
        pixel=pixel,
        body=body,
        depth=depth,
        normal=normal,
        weights=weights,
        open_fraction=None,
        facets=facets,
    )
    if occlusion is None:
        return shown
    return shown._replace(open_fraction=_open_fraction(shown, camera, occlusion))


def _open_fraction(
    shown: _Shown, camera: AbstractCamera, radius: float
) -> Float[np.ndarray, " p"]:
    width, height = camera.size
    depth, normal = np.full(height * width, np.inf), np.zeros((height * width, 3))
    depth[shown.pixel], normal[shown.pixel] = shown.depth, shown.normal
    shape = (height, width)
    found = screen_space_occlusion(
        depth.reshape(shape),
        normal=normal.reshape(*shape, 3),
        camera=camera,
        radius=radius,
    )
    return found.reshape(-1)[shown.pixel]


def in_bodies(
    surfaces: tuple[SolvedSurface, ...], found: VisiblePoints
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """Points in the frames of their bodies [m], and smooth normals in the world."""
    local, normal = np.empty_like(found.position), np.empty_like(found.position)
    for shown, surface in zip(_of_bodies(surfaces, found.body), surfaces, strict=True):
        geometry, placed = surface.geometry, surface.geometry.placed
        local[shown] = placed.to_body(found.position[shown])
        given = geometry.vertices, geometry.faces, found.face[shown], local[shown]
        normal[shown] = placed.rotate(smooth_normals(*given))
    return local, normal


def _of_bodies(
    surfaces: tuple[SolvedSurface, ...], body: Int[np.ndarray, " p"]
) -> list[Any]:
    """Index of the points of each body."""
    # Without a copy where there is only one.
    one = len(surfaces) == 1
    return [slice(None)] if one else [body == n for n in range(len(surfaces))]


def all_weights(
    surfaces: tuple[SolvedSurface, ...],
    body: Int[np.ndarray, " p"],
    local: Float[np.ndarray, "p 3"],
    normal: Float[np.ndarray, "p 3"],
    smooth: bool = True,
) -> csr_array:
    """Weights [p, s] of all fragments at points in the frames of their bodies [m].

    The normals are those in the world.
    """
    parts, shown = [], _of_bodies(surfaces, body)
    for here, surface in zip(shown, surfaces, strict=True):
        geometry = surface.geometry
        rotated = geometry.placed.rotate_back(normal[here])
        parts.append(
            smooth_weights(local[here], rotated, geometry)
            if smooth
            else _block_weights(local[here], geometry)
        )
    if len(parts) == 1:
        return parts[0]
    rows = np.concatenate([np.flatnonzero(each) for each in shown])
    # Back into the order of the pixels.
    return block_matrix(parts)[np.argsort(rows)]


def _all_facets(
    surfaces: tuple[SolvedSurface, ...],
    found: VisiblePoints,
    local: Float[np.ndarray, "p 3"],
) -> FacetShading | None:
    shown = [np.flatnonzero(found.body == index) for index in range(len(surfaces))]
    parts = [
        facet_shading(local[here], found.face[here], surface.geometry)
        for here, surface in zip(shown, surfaces, strict=True)
    ]
    return joined_shadings(shown, parts)


_MAX_VIEWS = 4
"""Views of one scene that are kept: about 0.25 kB for a pixel that shows a body."""


class _KeptView(NamedTuple):
    """A view with all that it was computed from but the first body."""

    given: tuple[Any, ...]
    view: View


# By the geometry of the first body, with which they are released.
_kept_views: WeakKeyDictionary[BodyGeometry, list[_KeptView]] = WeakKeyDictionary()


def kept_view(
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    camera: AbstractCamera,
    smooth: bool = True,
    occlusion: float | None = None,
) -> View:
    """Compute a view as `compute_view`, or return the one that was kept.

    The last four views of a scene are kept as long as a solution of it exists. A body
    or a source that moves is another one at every time.
    """
    first, *others = (surface.geometry for surface in surfaces)
    radius = np.asarray(-1.0 if occlusion is None else occlusion, float).tobytes()
    given = (*others, *terms, *_identity(camera), smooth, radius)
    kept = _kept_views.setdefault(first, [])
    for number, each in enumerate(kept):
        if _same(each.given, given):
            # The one that was used last is dropped last.
            kept.append(kept.pop(number))
            return each.view
    view = compute_view(
        surfaces, terms=terms, camera=camera, smooth=smooth, occlusion=occlusion
    )
    kept.append(_KeptView(given, view))
    del kept[:-_MAX_VIEWS]
    return view


def _identity(camera: AbstractCamera) -> tuple[Any, ...]:
    # Users make equal cameras again; their fields are numbers.
    each = (getattr(camera, field.name) for field in fields(camera))
    return type(camera), *(np.asarray(value, float).tobytes() for value in each)


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    # Bodies and terms are compared by identity: terms may hold arrays.
    plain = bytes | bool
    return len(one) == len(other) and all(
        a == b if isinstance(a, plain) else a is b
        for a, b in zip(one, other, strict=True)
    )
