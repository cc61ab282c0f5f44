"""`probe`: temperatures of a solution at points, as a thermocouple reads them."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...arrays import Points
from ...errors import InputError, shortened
from ...geometry.vectors import unit_vectors
from .abstract_solution import AbstractSolution
from .surface_reading import SurfaceReading, surface_reading


def probe(
    solution: AbstractSolution,
    points: Points | None = None,
    normals: Points | None = None,
) -> Float[Array | np.ndarray, "t p"]:
    """Temperatures at points over time [K], one column for each point.

    On a surface any point can be read after a run, by a plane through the temperatures
    of the nearest fragments that face the same way: of second order in the pitch.
    Inside a body those points can be read that the scene names before the run, in
    `Scene(probes=)`: a solution does not store what is inside.

    Args:
        solution: from `simulate`, `steady` or `load_run`.
        points: positions in the world at the start [m], three numbers each; a point
            stays where it is on its body as that moves. None for those of the scene.
        normals: outward normals of the surface at the points, such as those of
            `mesh_sample`: on parts of a voxel's thickness they tell the sides apart.
            None: a point is on the side of the nearest fragment.

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
    stored = solution.probe_temperature
    if points is None:
        if stored is None:
            raise InputError(
                "probe(points=None): the scene has no probes: give points, or "
                "Scene(probes=) before the run"
            )
        return stored
    positions = _vectors(points, "points")
    facing = None if normals is None else _vectors(normals, "normals")
    if facing is not None:
        if facing.shape != positions.shape:
            raise InputError(
                f"probe: {len(positions)} points and {len(facing)} normals: give one "
                "normal for each point"
            )
        facing = unit_vectors(facing)
    number = _scene_probe(solution, positions)
    xp = np if isinstance(solution.surface_temperature, np.ndarray) else jnp
    columns = []
    on_surfaces = np.flatnonzero(number < 0)
    if stored is not None:
        columns.append(stored[:, number[number >= 0]])
    if len(on_surfaces):
        side = None if facing is None else facing[on_surfaces]
        columns.append(
            _on_surface(
                solution,
                number=on_surfaces,
                points=positions[on_surfaces],
                normals=side,
            )
        )
    # Back into the order of the points.
    column_of_point = np.argsort(np.argsort(number < 0, kind="stable"), kind="stable")
    return xp.concatenate(columns, axis=1)[:, column_of_point]


def _vectors(values: Points, name: str) -> Float[np.ndarray, "p 3"]:
    try:
        vectors = np.asarray(values, float)
    except (TypeError, ValueError):
        vectors = np.zeros(0)
    lengths = (
        np.linalg.norm(vectors, axis=1) if vectors.shape[1:] == (3,) else np.zeros(0)
    )
    if not len(lengths) or not np.isfinite(vectors).all():
        raise InputError(
            f"probe({name}={shortened(values)}): give three finite numbers for each "
            "point, [n 3]"
        )
    if name == "normals" and not lengths.all():
        raise InputError("probe(normals=): some have no length: give unit vectors")
    return vectors


def _scene_probe(
    solution: AbstractSolution, points: Float[np.ndarray, "p 3"]
) -> Int[np.ndarray, " p"]:
    """Number of the scene's probe at each point; -1 where there is none."""
    if solution.probe_temperature is None:
        return np.full(len(points), -1)
    probe_positions = np.array(
        [scene_probe.position for scene_probe in solution.probes]
    )
    # Equal numbers, apart from the rounding of a caller who computes them again.
    size = 1e-9 * (1 + np.abs(points).max(axis=1))
    apart = np.abs(probe_positions[None] - points[:, None]).max(axis=2)
    nearest = apart.argmin(axis=1)
    return np.where(apart.min(axis=1) <= size, nearest, -1)


def _on_surface(
    solution: AbstractSolution,
    number: Int[np.ndarray, " p"],
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"] | None,
) -> Float[Array | np.ndarray, "t p"]:
    """Temperatures of points on the nearest surface of any body [K]."""
    geometries = [surface.geometry for surface in solution.surfaces]
    readings = [
        surface_reading(
            geometry,
            geometry.placed.to_body(points),
            None if normals is None else geometry.placed.rotate_back(normals),
        )
        for geometry in geometries
    ]
    gaps = [np.where(reading.is_lost, np.inf, reading.distance) for reading in readings]
    body = np.argmin(gaps, axis=0)
    is_readable = np.isfinite(gaps).any(axis=0)
    if not is_readable.all():
        first = int(np.argmin(is_readable))
        x, y, z = points[first]
        where = f"probe: point {number[first]}, ({x:g}, {y:g}, {z:g}) m, is"
        at_first = [reading.at(np.arange(len(points)) == first) for reading in readings]
        raise _lost(where, at_first, is_facing=normals is not None)
    xp = np if isinstance(solution.surface_temperature, np.ndarray) else jnp
    read = []
    order = []
    for index, reading in enumerate(readings):
        on_body = np.flatnonzero(body == index)
        order.append(on_body)
        read.append(reading.at(body == index).read(solution.of_body(index)))
    return xp.concatenate(read, axis=1)[:, np.argsort(np.concatenate(order))]


def _lost(where: str, readings: list[SurfaceReading], is_facing: bool) -> InputError:
    """Say why a point cannot be read, from its reading on each body."""
    body = int(np.argmin([reading.distance[0] for reading in readings]))
    distance = readings[body].distance[0]
    height = readings[body].height[0]
    if is_facing:
        return InputError(
            f"{where} {distance:.3g} m from the surface of body {body}, which has none "
            "nearby that faces as its normal does: give a point of the surface, or a "
            "finer pitch if the part is lost in the voxels"
        )
    if height < 0:
        return InputError(
            f"{where} {-height:.3g} m below the surface of body {body}, and a solution "
            "stores its surfaces alone: give the point to Scene(probes=) before the run"
        )
    return InputError(
        f"{where} on no body: the nearest, body {body}, is {distance:.3g} m away; "
        "give points in the world, where the bodies are at the start"
    )
