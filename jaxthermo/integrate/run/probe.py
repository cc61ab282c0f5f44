"""`probe`: temperatures of a solution at points, as a thermocouple reads them."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from ...arrays import Points
from ...errors import InputError
from ...scene.scene import BodyGeometry
from .solution import AbstractSolution


_NEIGHBOURS = 9
"""Fragments through whose temperatures a plane is laid."""

_MAX_HEIGHT = 0.25
"""Largest distance of a point from the plane of its fragment [pitches]."""

_SAME_SIDE = 0.5
"""Smallest cosine between normals of fragments of one side [-]."""


def probe(
    solution: AbstractSolution, points: Points | None = None
) -> Float[Array | np.ndarray, "t p"]:
    """Temperatures at points over time [K], one column for each point.

    On a surface any point can be read after a run, by a plane through the temperatures
    of the nearest fragments: of second order in the pitch. Inside a body those points
    can be read that the scene names before the run, in `Scene(probes=)`: a solution
    does not store what is inside.

    Args:
        solution: from `simulate` or `steady`.
        points: positions in the world at the start [m], three numbers each; a point
            stays where it is on its body as that moves. None for those of the scene.

    Raises:
        InputError: for a point in or on no body, naming the nearest and its distance,
            or inside a body and not in `Scene(probes=)`.

    Example:
        >>> import jaxthermo as jt
        >>> grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.01)
        >>> steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
        >>> body = jt.Body(jt.FullVolume(grid), steel, temperature=350.0)
        >>> terms = (jt.Convection(10.0, 290.0),)
        >>> scene = jt.Scene((body,), terms, probes={"middle": (0.0, 0.0, 0.0)})
        >>> solution = jt.simulate(scene, 60.0, save_at=[30.0, 60.0])
        >>> jt.probe(solution, [(0.0, 0.0, 0.0), (0.0, 0.0, 0.02)]).shape
        (2, 2)
    """
    if points is None:
        if solution.probe_temperature is None:
            raise InputError(
                "probe(points=None): the scene has no probes: give points, or "
                "Scene(probes=) before the run"
            )
        return solution.probe_temperature
    columns = [
        _column(solution, number, np.asarray(point, float))
        for number, point in enumerate(points)
    ]
    own = np if isinstance(solution.surface_temperature, np.ndarray) else jnp
    return own.stack(columns, axis=1)


def _column(
    solution: AbstractSolution, number: int, point: Float[np.ndarray, "3"]
) -> Float[Array | np.ndarray, " t"]:
    if solution.probe_temperature is not None:
        given = np.array([each.position for each in solution.probes])
        # The same numbers, but for the rounding of whoever computed them twice.
        size = 1e-9 * (1 + np.abs(point).max())
        same = np.flatnonzero(np.abs(given - point).max(axis=1) <= size)
        if len(same):
            return solution.probe_temperature[:, same[0]]
    chosen, weight = _on_surface(solution, number, point)
    temperature = solution.surface_temperature
    # Differences to the nearest: weights of a sum would lose digits in float32.
    first = temperature[:, chosen[0]]
    excess = temperature[:, chosen] - first[:, None]
    return first + (excess * weight.astype(temperature.dtype)[None]).sum(axis=1)


class _Place(NamedTuple):
    """A point relative to the fragments of one body."""

    height: float
    """Above the plane of the nearest fragment [m]; negative inside."""
    distance: float
    """To the nearest fragment [m]."""
    nearest: Int[np.ndarray, " k"]
    """Fragments of the body, the nearest first."""
    point: Float[np.ndarray, "3"]
    """In the body's frame [m]."""


def _place(geometry: BodyGeometry, point: Float[np.ndarray, "3"]) -> _Place:
    own = geometry.placed.to_body(point)
    count = min(_NEIGHBOURS, len(geometry.fragment_area))
    found, nearest = KDTree(geometry.fragment_position).query(own, k=count)
    distance, nearest = np.atleast_1d(found), np.atleast_1d(nearest)
    normal = geometry.fragment_normal[nearest[0]]
    height = (own - geometry.fragment_position[nearest[0]]) @ normal
    return _Place(float(height), float(distance[0]), nearest, own)


def _on_surface(
    solution: AbstractSolution, number: int, point: Float[np.ndarray, "3"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Fragments of a point on a surface, and the weights of their temperatures."""
    geometries = [surface.geometry for surface in solution.surfaces]
    places = [_place(geometry, point) for geometry in geometries]
    body = min(range(len(places)), key=lambda n: places[n].distance)
    geometry, place = geometries[body], places[body]
    pitch = geometry.pitch
    if abs(place.height) > _MAX_HEIGHT * pitch or place.distance > 1.5 * pitch:
        where = f"({', '.join(f'{x:g}' for x in point)}) m"
        if place.height < 0:
            raise InputError(
                f"probe: point {number}, {where}, is {-place.height:.3g} m below the "
                f"surface of body {body}, and a solution stores its surfaces alone: "
                "give the point to Scene(probes=) before the run"
            )
        raise InputError(
            f"probe: point {number}, {where}, is on no body: the nearest, body {body}, "
            f"is {place.distance:.3g} m away; give points in the world, where the "
            "bodies are at the start"
        )
    chosen, weight = _plane_weights(geometry, place)
    return chosen + _first_fragment(geometries, body), weight


def _first_fragment(geometries: Sequence[BodyGeometry], body: int) -> int:
    return sum(len(each.fragment_area) for each in geometries[:body])


def _plane_weights(
    geometry: BodyGeometry, place: _Place
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Weights of the value at a point of the plane nearest to the values around it."""
    nearest, normals = place.nearest, geometry.fragment_normal
    normal = normals[nearest[0]]
    chosen = nearest[normals[nearest] @ normal > _SAME_SIDE]
    offset = (geometry.fragment_position[chosen] - place.point) / geometry.pitch
    # Two directions along the surface; the singular vectors after the normal.
    along = offset @ np.linalg.svd(normal[None])[2][1:].T
    # Nearer fragments count more, so that a distant one is no lever.
    part = np.exp(-(along**2).sum(axis=1) / 2)
    mean = part**2 / (part**2).sum()
    centre = mean @ along
    # By the pseudo-inverse: no slope across fragments that lie in a row.
    slope = np.linalg.pinv(part[:, None] * (along - centre), rcond=1e-3) * part
    return chosen, mean - centre @ slope
