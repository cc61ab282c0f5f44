"""Maps give back fields that they can hold, and read where they say."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.structures.surface_map import gradient_at
from tests.bodies import bar, blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0)
SLOPE = np.array([30.0, -20.0, 50.0])
PITCH = 0.01


@pytest.fixture(scope="module")
def grid():
    solid = np.ones((9, 8, 10), bool)
    # Whatever the factor, no node is cut off from all neighbours along an axis.
    solid[1:3, 3:5, 4:6] = False
    solid[0, 0, 0] = solid[8, 7, 9] = False
    return blocks(solid, PITCH)


def _start(points):
    return 300.0 + points @ SLOPE


def _read(structure, surface_map, field=_start):
    """Surface temperatures of a field that has just been given to the nodes."""
    body = jt.Body(structure, METAL, temperature=field, surface_map=surface_map)
    scene = jt.Scene((body,), dtype="float64")
    return np.asarray(jt.simulate(scene, 0.0).surface_temperature)[0]


@pytest.mark.parametrize("factor", [3, 4])
def test_a_linear_field_is_exact_under_the_linear_map(grid, factor):
    structure = jt.Aggregate(grid, factor=factor)
    voxel = grid.lattice.centres(grid.fragment_voxel)
    surface = _read(structure, jt.LinearMap(at="voxel"))
    np.testing.assert_allclose(surface, _start(voxel), atol=1e-9)
    surface = _read(structure, jt.LinearMap())
    np.testing.assert_allclose(surface, _start(grid.fragment_position), atol=1e-9)


def test_the_constant_map_is_the_node(grid):
    structure = jt.Aggregate(grid, factor=4)
    node = structure.nodes().location[structure.fragment_node()]
    np.testing.assert_allclose(_read(structure, jt.ConstantMap()), _start(node))


@pytest.mark.parametrize(
    "surface_map", [jt.ConstantMap(), jt.FluxCorrectedMap("voxel")]
)
def test_a_full_volume_reads_its_voxels(grid, surface_map):
    voxel = grid.lattice.centres(grid.fragment_voxel)
    for structure in (jt.FullVolume(grid), jt.FullVolume(grid, stencil=False)):
        np.testing.assert_allclose(_read(structure, surface_map), _start(voxel))


@pytest.mark.parametrize("factor", [1, 4])
@pytest.mark.parametrize("at", ["surface", "voxel"])
def test_a_steady_flux_through_a_bar_is_read_at_its_depth(factor, at):
    """T = T_far + q'' x / k exactly, at rest, whatever the size of the nodes."""
    grid = bar(8, PITCH)
    flux = 1600.0
    front = jt.Side((1.0, 0.0, 0.0))
    back = jt.Side((-1.0, 0.0, 0.0))
    body = jt.Body(
        jt.Aggregate(grid, factor=factor),
        METAL,
        temperature=300.0,
        surface_map=jt.FluxCorrectedMap(at=at),
    )
    terms = (jt.HeatFlux(flux, on=front), jt.FixedTemperature(300.0, on=back))
    scene = jt.Scene((body,), terms, dtype="float64")
    surface = np.asarray(jt.simulate(scene, 2e5).surface_temperature)[0]
    depth = 0.0 if at == "surface" else PITCH / 2
    lit = grid.fragment_normal[:, 0] > 0.9
    exact = 300.0 + flux / 16.0 * (8 * PITCH - depth)
    assert surface[lit] == pytest.approx(exact, abs=1e-6)
    held = grid.fragment_normal[:, 0] < -0.9
    assert surface[held] == pytest.approx(300.0 + flux / 16.0 * depth, abs=1e-6)


def test_the_weight_of_the_distance_scales_what_the_flux_adds():
    grid = bar(4, PITCH)
    front = jt.Side((1.0, 0.0, 0.0))
    lit = grid.fragment_normal[:, 0] > 0.9

    def lift(weight):
        weights = jt.ConductionWeights(surface_distance=weight)
        body = jt.Body(jt.FullVolume(grid, weights=weights), METAL, temperature=300.0)
        scene = jt.Scene((body,), (jt.HeatFlux(1000.0, on=front),), dtype="float64")
        return float(np.asarray(jt.simulate(scene, 1.0).surface_temperature)[0, lit][0])

    lifts = [lift(w) for w in (0.0, 1.0, 2.0)]
    assert lifts[1] - lifts[0] == pytest.approx(1000.0 * PITCH / 2 / 16.0, rel=1e-9)
    assert lifts[2] - lifts[1] == pytest.approx(lifts[1] - lifts[0], rel=1e-9)


def test_no_gradient_where_nodes_are_the_voxels(grid):
    for structure in (jt.FullVolume(grid), jt.SingleShell(grid), jt.Octree(grid)):
        bound = jt.FluxCorrectedMap().bind(structure, jnp.float64)
        assert bound.gradient is None


def test_a_lone_node_has_no_gradient():
    structure = jt.Aggregate(blocks(np.ones((2, 2, 2), bool), PITCH), factor=2)
    gradient = gradient_at(structure, np.unique(structure.fragment_node()), jnp.float64)
    assert gradient.weight[0].shape == (0, 1)
    surface = _read(structure, jt.LinearMap(), field=lambda p: np.full(len(p), 311.0))
    np.testing.assert_array_equal(surface, 311.0)
