"""View of a solved scene: the geometry of an image, computed once for all frames.

The temperature of a pixel is a weighted mean of the fragments within two voxels. The
weights depend on the view only: a frame costs one sparse product.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_array

from ...geometry.vectors import row_dot, unit_vectors
from ...memo.found import found
from ...memo.stored import stored
from ...physics.term import AbstractTerm
from ...scene.scene import BodyGeometry, SolvedSurface
from .abstract_camera import AbstractCamera
from .background import Background, compute_background
from .camera import OrthographicCamera
from .facets import FacetShading, facet_shading, smooth_normals
from .occlusion import screen_space_occlusion
from .shapes import Bodies, ShapePoints
from .visible import VisiblePoints, visible_points, world_meshes
from .weights import MovingWeights, nearest_weights, smooth_weights, weighted_means


_T = TypeVar("_T")


class LinesOfSight(NamedTuple):
    """Geometry of the p pixels of a view that show a body."""

    point: Float[np.ndarray, "p 3"]
    """Surface points in the world [m]."""
    towards: Float[np.ndarray, "p 3"]
    """Unit vectors to the camera."""
    distance: Float[np.ndarray, " p"]
    """Distance of the camera [m]; from the image plane of an orthographic one."""
    cosine: Float[np.ndarray, " p"]
    """Cosine of the angle from the normal, not negative."""
    mirror: Float[np.ndarray, "p 3"]
    """Unit vectors along which light comes that a mirror would send to the camera."""


class _GeometryFrames(NamedTuple):
    """Geometry that a view shows, the same at all times."""

    depth: Float[np.ndarray, "h w"]
    object_id: Int[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"]
    part_id: Int[np.ndarray, "h w"] | None


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
    terms: tuple[AbstractTerm, ...] = ()
    """Terms of the scene at the time of the view, for where sources are."""
    open_fraction: Float[np.ndarray, " p"] | None = None
    """Fraction of the surroundings that nothing in the image hides; None for all."""
    facets: FacetShading | None = None
    """Reflection on large facets of curved surfaces; None without any."""
    part_id: Int[np.ndarray, " p"] | None = None
    """Number of the part within its body, -1 where it has none; None without any."""
    part_names: tuple[tuple[str, ...], ...] = ()
    """Names of the parts of every body."""
    is_enclosed: Bool[np.ndarray, " s"] | None = None
    """Fragments that nothing from outside reaches; None for none."""
    body_names: tuple[str, ...] = ()
    """Name of every body; empty for one without."""
    _results: dict[Hashable, Any] = field(init=False, repr=False, default_factory=dict)
    _of_geometry: dict[Hashable, Any] = field(
        init=False, repr=False, default_factory=dict
    )
    """Results that do not depend on the terms."""

    def once(self, key: Hashable, compute: Callable[[], _T]) -> _T:
        """Result of `compute`, which all frames of the view share."""
        if key not in self._results:
            self._results[key] = compute()
        return self._results[key]

    def _once(self, key: Hashable, compute: Callable[[], _T]) -> _T:
        """Result of `compute`, which the view of `with_terms` takes over."""
        if key not in self._of_geometry:
            self._of_geometry[key] = compute()
        return self._of_geometry[key]

    def with_terms(self, terms: tuple[AbstractTerm, ...]) -> "View":
        """The same pixels at another time, at which sources are somewhere else."""
        background = compute_background(
            terms, camera=self.camera, pixel=self.pixel, depth=self.depth
        )
        view = replace(self, terms=terms, background=background)
        view._of_geometry.update(self._of_geometry)
        return view

    def means(self, values: Array | np.ndarray) -> Array | np.ndarray:
        """Weighted means of fragments' values at the pixels, [s, ...] to [p, ...]."""
        weights = self.weights
        if isinstance(values, np.ndarray) and isinstance(weights, csr_array):
            return self._in_type(weights, values.dtype) @ values
        return weighted_means(weights, values)

    def _in_type(self, weights: csr_array, dtype: np.dtype) -> csr_array:
        # Half the memory traffic in float32.
        def typed() -> csr_array:
            entries = weights.data.astype(dtype), weights.indices, weights.indptr
            return csr_array(entries, shape=weights.shape)

        return self._once(("weights", dtype), typed)

    def geometry_frames(self, dtype: np.typing.DTypeLike) -> _GeometryFrames:
        """Depth, body, normal and part of every pixel, which cannot be changed."""
        pixel_type = np.dtype(dtype)
        return self._once(("frames", pixel_type), lambda: self._frames(pixel_type))

    def _frames(self, dtype: np.dtype) -> _GeometryFrames:
        def frame(values: np.ndarray, background: float | int) -> np.ndarray:
            image = self.camera.frame_of(self.pixel, values, background)
            image.flags.writeable = False
            return image

        part_id = self.part_id
        return _GeometryFrames(
            depth=frame(self.depth.astype(dtype), np.inf),
            object_id=frame(self.body.astype(np.int32), -1),
            normal=frame(self.normal.astype(dtype), 0),
            part_id=None if part_id is None else frame(part_id.astype(np.int32), -1),
        )

    @property
    def sight(self) -> LinesOfSight:
        """Lines of sight of the pixels."""
        return self._once("sight", self._find_sight)

    def _find_sight(self) -> LinesOfSight:
        origin, step = self.camera.rays(self.pixel)
        length = np.linalg.norm(step, axis=1)
        towards = -step / length[:, None]
        # A smooth normal may look away from the camera at an outline.
        cosine = np.clip(row_dot(towards, self.normal), 0, 1)
        mirror = unit_vectors(2 * cosine[:, None] * self.normal - towards)
        parallel = isinstance(self.camera, OrthographicCamera)
        return LinesOfSight(
            point=origin + step * self.depth[:, None],
            towards=towards,
            distance=self.depth if parallel else self.depth * length,
            cosine=cosine,
            mirror=mirror,
        )


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
    `keep` in the user's cache; of each body only the first view is stored.

    Raises:
        InputError: if the camera is inside a body or sees none.
    """
    # The first view of a body needs most work, which later views share: storing these
    # would cost more than computing them.
    views = [_views_of(s.geometry) for s in surfaces]
    types = (_ViewGeometry, FacetShading)
    keep = keep and not all(view_record["are found"] for view_record in views)

    def find() -> _ViewGeometry:
        for view_record in views:
            view_record["are found"] = True
        return _view_geometry(
            surfaces, camera=camera, smooth=smooth, occlusion=occlusion
        )

    if keep:
        content = camera, smooth, occlusion, [_content(s.geometry) for s in surfaces]
        geometry = stored("view", inputs=content, compute=find, types=types)
    else:
        geometry = find()
    background = compute_background(
        terms, camera=camera, pixel=geometry.pixel, depth=geometry.depth
    )
    return View(
        camera=camera,
        pixel=geometry.pixel,
        body=geometry.body,
        depth=geometry.depth,
        normal=geometry.normal,
        weights=geometry.weights,
        background=background,
        terms=terms,
        open_fraction=geometry.open_fraction,
        facets=geometry.facets,
        part_id=_part_ids(surfaces, geometry.weights),
        part_names=tuple(surface.geometry.part_names for surface in surfaces),
        is_enclosed=_enclosed(surfaces),
        body_names=tuple(surface.geometry.name for surface in surfaces),
    )


def _enclosed(
    surfaces: tuple[SolvedSurface, ...],
) -> Bool[np.ndarray, " s"] | None:
    """Fragments of all bodies that nothing from outside reaches; None for none."""
    geometries = [surface.geometry for surface in surfaces]
    if all(geometry.is_enclosed is None for geometry in geometries):
        return None
    masks = [
        np.zeros(len(geometry.fragment_area), bool)
        if geometry.is_enclosed is None
        else geometry.is_enclosed
        for geometry in geometries
    ]
    return np.concatenate(masks)


def _part_ids(
    surfaces: tuple[SolvedSurface, ...], weights: csr_array
) -> Int[np.ndarray, " p"] | None:
    """Part of the fragment with the largest weight at each pixel."""
    fragment_parts = [s.geometry.fragment_part for s in surfaces]
    if all(numbers is None for numbers in fragment_parts):
        return None
    sizes = [len(s.geometry.fragment_area) for s in surfaces]
    part_numbers = [
        np.full(size, -1, np.int32) if numbers is None else numbers
        for numbers, size in zip(fragment_parts, sizes, strict=True)
    ]
    # The means of pixels have at least one fragment each.
    largest = np.maximum.reduceat(weights.data, weights.indptr[:-1])
    row = np.repeat(np.arange(len(largest)), np.diff(weights.indptr))
    (entry,) = np.nonzero(weights.data == largest[row])
    _, first = np.unique(row[entry], return_index=True)
    return np.concatenate(part_numbers)[weights.indices[entry[first]]]


def _content(geometry: BodyGeometry) -> tuple[Any, ...]:
    """Everything about a body at its pose on which a view depends."""
    fragments = geometry.fragment_position, geometry.fragment_normal
    mesh = geometry.vertices, geometry.surface_faces
    numbers = geometry.pitch, geometry.is_two_sided
    return *mesh, *fragments, geometry.fragment_area, *numbers, geometry.placed


def _views_of(geometry: BodyGeometry) -> dict[str, bool]:
    """Record of a body: whether this process found any view of it."""
    arrays = geometry.vertices, geometry.surface_faces, geometry.fragment_position
    return found(arrays, "views", lambda: {"are found": False})


class _ViewGeometry(NamedTuple):
    """Fields of a `View` that follow from geometry alone."""

    pixel: Int[np.ndarray, " p"]
    body: Int[np.ndarray, " p"]
    depth: Float[np.ndarray, " p"]
    normal: Float[np.ndarray, "p 3"]
    weights: csr_array
    open_fraction: Float[np.ndarray, " p"] | None
    facets: FacetShading | None


def _view_geometry(
    surfaces: tuple[SolvedSurface, ...],
    camera: AbstractCamera,
    smooth: bool,
    occlusion: float | None,
) -> _ViewGeometry:
    visible = visible_points(world_meshes(surfaces), camera)
    bodies = Bodies.of(surfaces)
    body = visible.body
    points = in_bodies(bodies, visible)
    face = bodies.face_of(visible.face, body)
    weights_of = smooth_weights if smooth else nearest_weights
    geometry = _ViewGeometry(
        pixel=visible.pixel,
        body=body,
        depth=visible.depth,
        normal=bodies.rotate(points.normal, body),
        weights=bodies.of_fragments(weights_of(points, bodies.shapes), body),
        open_fraction=None,
        facets=facet_shading(points, face, body, bodies) if smooth else None,
    )
    if occlusion is None:
        return geometry
    return geometry._replace(open_fraction=_open_fraction(geometry, camera, occlusion))


def _open_fraction(
    geometry: _ViewGeometry, camera: AbstractCamera, radius: float
) -> Float[np.ndarray, " p"]:
    open_fraction = screen_space_occlusion(
        camera.frame_of(geometry.pixel, geometry.depth, np.inf),
        normal=camera.frame_of(geometry.pixel, geometry.normal, 0),
        camera=camera,
        radius=radius,
    )
    return open_fraction.reshape(-1)[geometry.pixel]


def in_bodies(bodies: Bodies, visible: VisiblePoints) -> ShapePoints:
    """Visible points in the frames of their bodies, with smooth normals."""
    position = bodies.to_body(visible.position, visible.body)
    normal = smooth_normals(
        bodies.shapes.vertices,
        faces=bodies.shapes.faces,
        face=bodies.face_of(visible.face, visible.body),
        points=position,
    )
    return ShapePoints(bodies.shape[visible.body], position, normal)


_MAX_VIEWS = 4
"""Views of one scene that are kept: about 0.25 kB for a pixel that shows a body."""


class _KeptView(NamedTuple):
    """A view of bodies that do not move, and what it was computed from."""

    key: tuple[Any, ...]
    """Bodies but the first, camera and options."""
    view: View
    """With the terms of the last frame."""


def kept_view(
    surfaces: tuple[SolvedSurface, ...],
    terms: tuple[AbstractTerm, ...],
    camera: AbstractCamera,
    time: float = 0.0,
    smooth: bool = True,
    occlusion: float | None = None,
) -> View:
    """View of bodies and sources where they are at a time [s], as `compute_view`.

    The last four views of a scene in which no body moves are kept, as long as a
    solution of it lives. Sources may move: they do not change what a pixel shows.
    """
    first, *further_bodies = (surface.geometry for surface in surfaces)
    radius = np.asarray(-1.0 if occlusion is None else occlusion, float).tobytes()
    key = (*further_bodies, *_identity(camera), smooth, radius)
    # Released with the geometry of the first body.
    views: list[_KeptView] = found((first,), "kept views", list)
    for number, entry in enumerate(views):
        if _same(entry.key, key):
            # The most recently used view is dropped last.
            view = entry.view
            # What moves is another object at every time.
            if not _same(view.terms, terms):
                view = view.with_terms(tuple(term.at(time) for term in terms))
            del views[number]
            views.append(_KeptView(key, view))
            return view
    bodies_then = tuple(surface.at(time) for surface in surfaces)
    terms_then = tuple(term.at(time) for term in terms)
    view = compute_view(
        bodies_then, terms=terms_then, camera=camera, smooth=smooth, occlusion=occlusion
    )
    if _same(bodies_then, surfaces):
        views.append(_KeptView(key, view))
        del views[:-_MAX_VIEWS]
    return view


def _identity(camera: AbstractCamera) -> tuple[Any, ...]:
    # Users make equal cameras again; their fields are numbers.
    numbers = (getattr(camera, field.name) for field in fields(camera))
    return type(camera), *(np.asarray(value, float).tobytes() for value in numbers)


def _same(first: tuple[Any, ...], second: tuple[Any, ...]) -> bool:
    # Bodies and terms are compared by identity: terms may hold arrays.
    plain = bytes | bool
    return len(first) == len(second) and all(
        a == b if isinstance(a, plain) else a is b
        for a, b in zip(first, second, strict=True)
    )
