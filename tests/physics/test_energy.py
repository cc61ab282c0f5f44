"""Energy: the ledger closes, insulated bodies keep their heat (C11), islands (S12)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.geometry.shapes import sphere
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import blocks, single_body_scene
from tests.shallow import SHALLOW


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
OTHER = jt.Material(2.0, density=2000.0, specific_heat=900.0, emissivity=0.5)
RIGHT = jt.Region((0.0, -1.0, -1.0), (1.0, 1.0, 1.0))
PAINTED = jt.MaterialMap(METAL, ((RIGHT, OTHER),))
TOLERANCE = {"float32": 1e-5, "float64": 1e-12}


@pytest.fixture(scope="module")
def ball():
    return voxelize(sphere(0.05, subdivisions=2), 0.01)


def _everything():
    return (
        jt.Sun(direction=(-1.0, 0.2, -0.5), irradiance=jt.Until(5000.0, 60.0)),
        jt.Surroundings(280.0),
        jt.Convection(15.0, jt.Table([0.0, 50.0, 200.0], [280.0, 300.0, 310.0])),
        jt.HeatFlux(300.0, on=jt.Side((0.0, 0.0, 1.0))),
        jt.HeatFlux(-700.0, on=jt.Side((0.0, 0.0, -1.0))),
        jt.FixedTemperature(320.0, on=jt.Side((0.0, 1.0, 0.0), half_angle=0.3)),
    )


@SHALLOW
@pytest.mark.parametrize(
    ("dtype", "stencil", "painted", "solver"),
    [
        # Many steps do not wear the ledger down.
        ("float32", True, True, jt.ForwardEuler(dt=0.04)),
        pytest.param("float64", False, False, None, marks=pytest.mark.slow),
        pytest.param("float32", False, True, None, marks=pytest.mark.slow),
        pytest.param("float64", True, True, None, marks=pytest.mark.slow),
    ],
)
def test_all_mechanisms_at_once(ball, dtype, stencil, painted, solver):
    scene = single_body_scene(
        jt.FullVolume(ball, stencil=stencil),
        PAINTED if painted else METAL,
        293.15,
        *_everything(),
        dtype=dtype,
    )
    run = jt.simulate(scene, 180.0, save_at=[10.0, 60.0, 180.0], solver=solver)
    energy = run.energy
    residual = np.asarray(energy.residual_relative)
    assert list(energy.mechanisms) == [
        "sun", "emission", "convection", "heat_flux", "heat_flux#2", "fixed_temperature"
    ]  # fmt: skip
    assert all(abs(float(heat[-1])) > 1.0 for heat in energy.mechanisms.values())
    assert np.abs(residual).max() < TOLERANCE[dtype]


@pytest.mark.parametrize(
    ("dtype", "painted"),
    [pytest.param("float32", False, marks=pytest.mark.slow), ("float64", True)],
)
def test_insulated_body_evens_out_to_its_mean(ball, dtype, painted):

    def hot(p):
        return 300.0 + 200.0 * (p[:, 2] > 0.02) + 30.0 * (p[:, 0] > 0)

    structure = jt.FullVolume(ball)
    scene = single_body_scene(
        structure, PAINTED if painted else METAL, hot, dtype=dtype
    )
    solution = jt.simulate(scene, 20000.0, save_at=[0.0, 20000.0])
    nodes = structure.nodes()
    materials = [METAL, OTHER] if painted else [METAL, METAL]
    heat = np.array([m.volumetric_heat_capacity for m in materials])
    weight = nodes.volume * heat[(nodes.centre[:, 0] >= 0).astype(int)]
    mean = (weight * hot(nodes.centre)).sum() / weight.sum()
    surface = np.asarray(solution.surface_temperature, float)
    error = np.abs(surface[-1] - mean).max()
    assert np.ptp(surface[0]) > 190.0
    bound = {"float64": 1e-9, "float32": 1e-6 * mean}[dtype]
    assert error < bound
    assert_allclose(solution.mean_temperature[:, 0], mean, atol=bound)
    assert abs(float(solution.energy.residual_relative[-1])) < TOLERANCE[dtype]


@pytest.mark.parametrize(
    ("dtype", "stencil"),
    [("float32", True), pytest.param("float64", False, marks=pytest.mark.slow)],
)
def test_islands_keep_their_temperature_to_the_bit(dtype, stencil):
    solid = np.zeros((5, 5, 5), bool)
    solid[0, 0, 0] = solid[4, 4, 4] = solid[0, 4, 0] = True
    grid = blocks(solid, 0.01)
    scene = single_body_scene(
        jt.FullVolume(grid, stencil=stencil),
        METAL,
        lambda p: 300.0 + 1e3 * p.sum(axis=1),
        dtype=dtype,
    )
    solution = jt.simulate(
        scene, 10.0, save_at=[0.0, 10.0], solver=jt.ForwardEuler(dt=0.1)
    )
    surface = np.asarray(solution.surface_temperature)
    assert_array_equal(surface[0], surface[1])
    assert len(np.unique(surface)) == 3
    assert solution.run.stable_step == np.inf


def test_heat_stays_on_the_island_it_fell_on():
    solid = np.ones((5, 2, 2), bool)
    solid[2] = False
    grid = blocks(solid, 0.01)
    body = jt.Body(
        jt.FullVolume(grid), METAL, temperature=300.0, surface_map=jt.ConstantMap()
    )
    term = jt.HeatFlux(1000.0, on=jt.Side((-1.0, 0.0, 0.0)))
    on_left = grid.fragment_voxel[:, 0] == 0
    scene = jt.Scene((body,), (term,), dtype="float64")
    surface = np.asarray(
        jt.simulate(scene, 20.0, solver=jt.ForwardEuler()).surface_temperature
    )[0]
    right = grid.fragment_voxel[:, 0] > 2
    # The side also selects the far island's face that faces the gap.
    lit = (grid.fragment_normal[:, 0] < -0.9) & right
    assert lit.sum() == 4
    flux = 1000.0 * 20.0 / (METAL.volumetric_heat_capacity * 0.02)
    assert surface[on_left].mean() > 300.0
    layer_means = [surface[grid.fragment_voxel[:, 0] == x].mean() for x in (0, 1, 3, 4)]
    assert layer_means[0] + layer_means[1] == pytest.approx(
        2 * (300.0 + flux), rel=1e-12
    )
    assert layer_means[0] == pytest.approx(layer_means[2], rel=1e-14)
