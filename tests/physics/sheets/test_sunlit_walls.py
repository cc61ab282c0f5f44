"""Walls of a cylinder and of a sphere in the sun, against their series."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.geometry.vectors import triangle_normals, unit_vectors
from jaxthermo.reference.sheets import sunlit_sphere
from tests.fin_forms import sunlit_cylinder
from tests.sheet_bodies import FRONT, at_nodes, open_cylinder


RADIUS = 0.05
THICKNESS = 0.5e-3
STEEL = jt.Material(
    16.0, density=8000.0, specific_heat=500.0, emissivity=0.3, absorptivity=1.0
)
LAYERS = (jt.Layer(STEEL, THICKNESS),)
AIR = 300.0
TERMS = (jt.Sun((-1.0, 0.0, 0.0), 800.0), jt.Convection(15.0, AIR, on=FRONT))
LAW = {
    "radius": RADIUS,
    "sheet_conductance": 16.0 * THICKNESS,
    "heat_transfer_coefficient": 15.0,
    "heat_flux": 800.0,
}

CYLINDERS = {24: 0.015, 48: 0.007, 96: 0.0035}
"""Pitch by the number of facets [m]."""
PROTOTYPE_NODES = {24: 392, 48: 1764, 96: 6704}
PROTOTYPE_RMS = {24: 0.24, 48: 0.087, 96: 0.020}


def steady_wall(mesh, pitch):
    """Nodes of a wall in the sun, and their excess over the air [K]."""
    sheet = jt.Sheet(mesh, LAYERS, pitch=pitch)
    scene = jt.Scene((jt.Body(sheet, temperature=AIR),), TERMS, dtype="float64")
    solution = jt.steady(scene)
    reading = at_nodes(sheet, solution.surface_temperature[0])
    return reading._replace(temperature=reading.temperature - AIR)


def cylinder_error(facets):
    """Number of nodes, and the rms of their temperature [K]."""
    reading = steady_wall(open_cylinder(RADIUS, 0.2, facets), CYLINDERS[facets])
    angle = np.arctan2(reading.position[:, 1], reading.position[:, 0])
    return len(angle), reading.rms(sunlit_cylinder(angle, **LAW))


def sphere_error(subdivisions, pitch):
    """Rms of the temperature of a sphere over its range [-]."""
    reading = steady_wall(jt.shapes.sphere(RADIUS, subdivisions), pitch)
    direction = reading.position / np.linalg.norm(reading.position, axis=1)[:, None]
    exact = sunlit_sphere(np.arccos(np.clip(direction[:, 0], -1, 1)), **LAW)
    return reading.rms(exact) / np.ptp(exact)


@pytest.mark.parametrize(
    "facets", [24, *(pytest.param(n, marks=pytest.mark.slow) for n in (48, 96))]
)
def test_open_cylinder_follows_its_series(facets):
    nodes, rms = cylinder_error(facets)
    assert nodes <= 1.1 * PROTOTYPE_NODES[facets]
    assert rms <= PROTOTYPE_RMS[facets]


@pytest.mark.slow
def test_open_cylinder_converges_at_second_order():
    coarse, fine = cylinder_error(48)[1], cylinder_error(96)[1]
    assert np.log(coarse / fine) / np.log(7 / 3.5) >= 1.8


def test_spherical_shell_follows_its_series():
    assert sphere_error(3, 0.0075) < 0.002


@pytest.mark.slow
def test_spherical_shell_converges_at_second_order():
    sizes = ((2, 0.015), (3, 0.0075), (4, 0.00375))
    coarse, middle, fine = (sphere_error(*size) for size in sizes)
    assert np.log2(middle / fine) >= 1.8
    assert np.log2(coarse / fine) / 2 >= 1.8


def test_curved_fragments_receive_the_light_of_their_faces():
    """Also those of which only a part is lit, at the terminator."""
    sheet = jt.Sheet(jt.shapes.sphere(RADIUS, 3), LAYERS, pitch=0.02)
    grid = sheet.grid
    cells = grid.cells
    count = len(cells.fragments.area)
    towards = np.array([0.36, 0.48, 0.8])
    vectors = grid.pieces.facing(towards[None], 2 * count)
    received = grid.fragment_area * (vectors @ towards)
    normal = unit_vectors(triangle_normals(cells.vertices[cells.faces]))
    node = cells.vertex_node[cells.faces].ravel()
    for face, sign in enumerate((1.0, -1.0)):
        cosine = np.maximum(sign * (normal @ towards), 0.0)
        exact = np.bincount(node, np.repeat(cells.face_area * cosine / 3, 3))
        fragments = np.arange(count) + face * count
        of_node = np.bincount(cells.fragments.node, received[fragments])
        assert_allclose(of_node, exact, rtol=1e-12, atol=1e-12 * exact.max())
        mean_normal = np.maximum(sign * (cells.fragments.normal @ towards), 0.0)
        by_mean = np.bincount(
            cells.fragments.node, cells.fragments.area * mean_normal, len(exact)
        )
        assert np.abs(by_mean - exact).max() > 1e-4 * exact.max()
