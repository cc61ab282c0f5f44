"""Probes read linear fields exactly, and others to second order of the pitch."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.errors import InputError
from tests.bodies import bar, single_body_scene
from tests.slopes import check_gradient


CLAY = jt.Material(conductivity=1.0, density=2000.0, specific_heat=1000.0)
STEEL = jt.Material(conductivity=20.0, density=2000.0, specific_heat=1000.0)
PITCH = 0.01
CELLS = 8
LENGTH = PITCH * CELLS
LOW = jt.Side((-1.0, 0.0, 0.0))
HIGH = jt.Side((1.0, 0.0, 0.0))
RIGHT = jt.Region(lower=(0.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))


def linear(x):
    """A temperature along the bar [K]."""
    return 350.0 + 100.0 * np.asarray(x) / LENGTH


# Per area of the bar: air, clay and steel [m^2 K/W], and the flux from air at 400 K.
R_AIR = 1 / 25.0
R_CLAY = LENGTH / 2 / 1.0
R_STEEL = LENGTH / 2 / 20.0
FLUX = 100.0 / (R_AIR + R_CLAY + R_STEEL)


def layers(x):
    """Steady temperature of clay on the left and steel on the right [K]."""
    x = np.asarray(x)
    clay = 300.0 + FLUX * (x + LENGTH / 2) / 1.0
    return np.where(x < 0, clay, 300.0 + FLUX * (R_CLAY + x / 20.0))


# In cells, between them, at both ends, on a side, and beside the middle on either side.
X = np.array([-0.035, -0.0312, -0.04, 0.04, 0.0101, -0.0007, 0.0007, 0.0])
POINTS = np.column_stack([X, 0.002 * np.sin(X * 1e3), np.where(X == 0.0101, 0.005, 0)])


@pytest.fixture(scope="module")
def wall():
    """Clay and steel between two convections and a prescribed temperature."""
    materials = jt.MaterialMap(CLAY, ((RIGHT, STEEL),))
    structure = jt.FullVolume(bar(CELLS, PITCH), stencil=False)
    terms = (
        jt.FixedTemperature(300.0, on=LOW),
        jt.Convection(10.0, 400.0, on=HIGH),
        jt.Convection(15.0, 400.0, on=HIGH),
    )
    scene = jt.Scene(
        (jt.Body(structure, materials, temperature=350.0),),
        terms,
        dtype="float64",
        probes=POINTS,
        surface_outputs=("heat_flux", "heat_transfer_coefficient"),
    )
    return jt.steady(scene)


def test_layers_are_read_exactly_inside_and_on_the_surface(wall):
    read = jt.probe(wall)
    assert read.shape == (1, len(X))
    assert_allclose(read[0], layers(X), atol=1e-6)


def test_heat_flux_and_coefficient_of_the_wall(wall):
    normal = bar(CELLS, PITCH).fragment_normal[:, 0]
    assert_allclose(wall.heat_flux[0], FLUX * np.round(normal), atol=1e-5)
    h = wall.heat_transfer_coefficient[0]
    assert_allclose(h, np.where(normal > 0.9, 25.0, 0.0), rtol=1e-12)


def test_after_a_run_any_point_of_a_surface_can_be_read(wall):
    # Beside the given ones: on the side, between the fragments of one material.
    side = [(x, 0.001, 0.005) for x in (-0.0333, -0.02, 0.0211)]
    read = jt.probe(wall, [*side, POINTS[1], (0.04, 0.001, 0.0)])
    expected = layers([-0.0333, -0.02, 0.0211, X[1], 0.04])
    assert_allclose(read[0], expected, atol=1e-6)


def test_points_that_cannot_be_read(wall):
    with pytest.raises(InputError) as caught:
        jt.probe(wall, [(0.0, 0.0, 0.0012)])
    assert "below the surface of body 0" in str(caught.value)
    assert "Scene(probes=)" in str(caught.value)
    with pytest.raises(InputError, match="is on no body: the nearest, body 0, is 0.06"):
        jt.probe(wall, [(0.1, 0.0, 0.0)])
    body = jt.Body(jt.FullVolume(bar(CELLS, PITCH)), CLAY, temperature=350.0)
    outside = jt.Scene((body,), probes={"air": (0.0, 0.0, 0.055)})
    with pytest.raises(InputError) as caught:
        jt.simulate(outside, 0.0)
    message = str(caught.value)
    assert "probe air at (0, 0, 0.055) m is in no body" in message
    assert "body 0, is 0.05 m away" in message and "\n" not in message
    with pytest.raises(InputError, match="probe 0 is 3: give three numbers"):
        jt.Scene((body,), probes=[3])
    with pytest.raises(InputError, match="the scene has no probes"):
        jt.probe(jt.simulate(jt.Scene((body,)), 0.0))


@pytest.mark.slow
def test_a_probe_moves_with_its_body():
    """A body that turns about z takes its hot end, and the probe on it, along."""
    quarter = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    poses = [jt.Pose((0.0, 0.0, 1.0)), jt.Pose((5.0, 0.0, 0.0), quarter)]
    path = jt.PoseTable([0.0, 1.0], poses)
    structure = jt.FullVolume(bar(CELLS, PITCH))

    def along(points):
        return linear(points[:, 0])

    moving = jt.Body(structure, CLAY, temperature=along, pose=jt.Motion(path))
    second = jt.Body(structure, CLAY, temperature=500.0)
    points = [(0.03, 0.0, 1.0), (0.0312, 0.0, 0.001)]
    scene = jt.Scene((moving, second), dtype="float64", probes=points)
    solution = jt.simulate(scene, 1.5, [0.0, 1.5])
    read = jt.probe(solution)
    assert read[0] == pytest.approx([linear(0.03), 500.0], abs=1e-9)
    # In 1.5 s heat has not spread over a fifth of a cell.
    assert read[1] == pytest.approx([linear(0.03), 500.0], abs=0.1)


def field(points):
    """A smooth field that no plane fits [K]."""
    x, y, z = 20.0 * points.T
    return 300.0 + 20.0 * np.sin(x + 0.3) * np.cos(1.1 * y) + 10.0 * z * z


STRUCTURES = {
    "full volume": jt.FullVolume,
    "octree": lambda grid: jt.Octree(grid, levels=2),
    "aggregate": lambda grid: jt.Aggregate(grid, 2),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURES)
def test_a_smooth_field_is_read_to_second_order(name):
    """Nodes that have the field: probes inside a ball, at twice the resolution."""
    points = 0.03 * np.random.default_rng(0).normal(size=(40, 3)).clip(-0.8, 0.8)
    worst = []
    for pitch in (0.01, 0.005):
        grid = jt.voxelize(jt.shapes.box(0.12), pitch)
        scene = single_body_scene(STRUCTURES[name](grid), CLAY, field, probes=points)
        read = np.asarray(jt.probe(jt.simulate(scene, 0.0, [0.0])))[0]
        worst.append(np.abs(read - field(points)).max())
    assert worst[1] < 0.35 * worst[0] < 2.0


@pytest.mark.slow
def test_gradients_reach_a_probe():
    """d T(probe) / dk in reverse mode against a finite difference."""
    grid = bar(CELLS, PITCH)

    def core(k):
        material = jt.Material(k, 2000.0, 1000.0)
        scene = single_body_scene(
            grid,
            material,
            300.0,
            jt.HeatFlux(1e4, on=HIGH),
            probes=[(0.022, 0.0, 0.001)],
        )
        solver = jt.ForwardEuler(dt=20.0)
        return jt.probe(jt.simulate(scene, 200.0, solver=solver))[0, 0]

    value_and_slope = check_gradient(core, 2.0, step=1e-4, rtol=1e-6)
    assert abs(float(value_and_slope(2.0)[1])) > 0.1


def test_a_hollow_structure_has_nothing_to_read_inside():
    grid = jt.voxelize(jt.shapes.box(0.1), 0.01)
    body = jt.Body(jt.SingleShell(grid), CLAY, temperature=300.0)
    with pytest.raises(InputError) as caught:
        jt.simulate(jt.Scene((body,), probes={"core": (0, 0, 0)}), 0.0)
    assert "probe core at (0, 0, 0) m is inside body 0" in str(caught.value)
    assert "SingleShell has no nodes" in str(caught.value)
    surface = jt.Scene((body,), probes={"top": (0, 0, 0.05)})
    assert float(jt.probe(jt.simulate(surface, 0.0, [0.0]))[0, 0]) == 300.0
