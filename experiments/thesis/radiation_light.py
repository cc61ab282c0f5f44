"""Claim C04: light and shadow by shadow maps and Lambert's cosine, to 1 % (5.1)."""

from typing import Any

import numpy as np

from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.radiation.area_source import AreaSource
from jaxthermo.physics.radiation.source import AbstractSource, PointSource, Sun
from jaxthermo.reference.view_factor import element_to_rectangle
from jaxthermo.report.table import Cell, Table
from jaxthermo.voxels.grid import VoxelGrid
from jaxthermo.voxels.voxelize import voxelize


RADIUS, PITCH = 0.2, 0.01
"""Radius of the ball and edge of a voxel [m]."""
WITHIN = 0.01
"""The error that passes."""

Check = dict[str, Any]


def _exposure(grid: VoxelGrid, source: AbstractSource, *others: Mesh) -> np.ndarray:
    triangles = np.concatenate([grid.mesh.triangles, *(m.triangles for m in others)])
    return source.exposure(
        triangles, grid.fragment_position, grid.fragment_normal, grid.pitch
    )


def _check(what: str, found: float, exact: float) -> Check:
    error = found / exact - 1
    return {
        "what": what,
        "found": float(found),
        "exact": float(exact),
        "error": float(error),
        "passes": bool(abs(error) <= WITHIN),
    }


def measure_light() -> dict[str, Any]:
    """C04: what a ball, a plate and hollows catch, and where a ball's night begins."""
    ball = voxelize(sphere(RADIUS, subdivisions=4), PITCH)
    rays = (-1.0, 0.4, -0.7)
    away = -np.array(rays) / np.linalg.norm(rays)
    sun, lamp = Sun(rays, 1.0), PointSource(tuple((0.5 * away).tolist()), 1.0)
    disc = np.pi * RADIUS**2
    cone = 2 * np.pi * (1 - np.sqrt(1 - (RADIUS / 0.5) ** 2))
    caught = lambda source: float(_exposure(ball, source) @ ball.fragment_area)
    checks = [
        _check("ball in the sun: its disc [m²]", caught(sun), disc),
        _check("ball by a lamp: its solid angle [sr]", caught(lamp), cone),
        *_hollow(),
        _panel(),
        *(_shadow(angle) for angle in (0.0, 30.0, 60.0)),
    ]
    return {"checks": checks, "terminator": _terminator(ball, sun, away)}


def _terminator(ball: VoxelGrid, sun: Sun, away: np.ndarray) -> dict[str, float]:
    """Angles from the sun: the first fragment that is dark and the last that is lit."""
    exposure = _exposure(ball, sun)
    angle = np.rad2deg(np.arccos(np.clip(ball.fragment_normal @ away, -1, 1)))
    # A fragment that is lit in full has the whole of its cosine.
    lit = exposure / np.maximum(np.cos(np.deg2rad(angle)), 1e-9)
    return {
        "last_lit_degrees": float(angle[exposure > 0].max()),
        "first_shaded_degrees": float(angle[lit < 1 - 1e-9].min()),
        "exact_degrees": 90.0,
    }


def _hollow() -> list[Check]:
    """A lamp and a panel in a hollow ball: all they send out is caught."""
    hole, hull = sphere(RADIUS, 3), sphere(1.2 * RADIUS, 3)
    faces = [hull.faces, hole.faces[:, ::-1] + len(hull.vertices)]
    vertices = np.concatenate([hull.vertices, hole.vertices])
    hollow = voxelize(Mesh(vertices, np.concatenate(faces), "hollow"), 2 * PITCH)
    lamp = PointSource((0.1, -0.05, 0.08), 1.0)
    panel = AreaSource((0.02, 0.0, 0.05), (1.0, 0.5, 0.2), (0.1, 0.06), radiance=1.0)
    sums = [float(_exposure(hollow, s) @ hollow.fragment_area) for s in (lamp, panel)]
    return [
        _check("lamp in a hollow ball: 4 pi [sr]", sums[0], 4 * np.pi),
        _check("panel in a hollow ball: pi A [m² sr]", sums[1], np.pi * 0.1 * 0.06),
    ]


def _panel() -> Check:
    """A14: a black plate, 2 x 2 m at 1000 degC, 1 m above an element."""
    plate = AreaSource((0, 0, 1.0), (0, 0, -1.0), (2.0, 2.0), temperature=1273.15)
    here, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    exposure = plate.exposure(np.zeros((0, 3, 3)), here, up, PITCH)
    exact = STEFAN_BOLTZMANN * 1273.15**4 * 4 * element_to_rectangle(1.0, 1.0, 1.0)
    found = float(plate.strength * exposure[0])
    return _check("hot plate over an element, A14 [W/m²]", found, exact)


def _shadow(degrees: float) -> Check:
    """Light on a plate of 40 x 40 voxels, 3 cm below a box 2 cm thick."""
    plate = voxelize(box((0.4, 0.4, 0.02)), PITCH)
    cover = box((0.12, 0.16, 0.02)).moved((0.03, 0.01, 0.05))
    slope = float(np.tan(np.deg2rad(degrees)))
    sun = Sun((-slope, 0.0, -1.0), 1.0)
    top = plate.fragment_normal[:, 2] > 0.9
    cosine = 1 / np.hypot(1.0, slope)
    found = float(_exposure(plate, sun, cover)[top] @ plate.fragment_area[top])
    shadow = (0.12 + 0.02 * slope) * 0.16
    exact = (0.4 * 0.4 - shadow) * cosine
    return _check(f"plate below a box, sun at {degrees:g}° [m²]", found, exact)


def light_table(result: dict[str, Any]) -> Table:
    """Every check with its exact value; it passes within 1 %."""
    rows = [
        [
            check["what"],
            f"{check['found']:.6g}",
            f"{check['exact']:.6g}",
            f"{check['error']:+.2%}",
            Cell("1 %" if check["passes"] else "over", check["passes"]),
        ]
        for check in result["checks"]
    ]
    columns = ("", "found", "exact", "error", "within")
    return Table(columns, rows, "C04: shadow maps and Lambert's cosine")
