"""A full volume in runs of voxels, in loops of numba, is the network of its links."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.network.run_stencil import RunStencil
from jaxthermo.physics import run_conduction
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.voxelize import voxelize
from tests.networks import outputs_of


pytest.importorskip("numba")
# numba compiles for some seconds.
pytestmark = pytest.mark.slow

HEAT = 4e6
CONDUCTIVITY = 16.0
CUT = voxelize(shapes.sphere(0.1, subdivisions=3), 0.0131, "crossings")
WHOLE = voxelize(shapes.cylinder(0.05, 0.2), 0.0171, "dominant_axis")


def network(grid, dtype=jnp.float64, **options):
    return assemble_uniform(FullVolume(grid, **options), CONDUCTIVITY, HEAT, dtype)


def both(grid):
    return network(grid, kernels="numba"), network(grid, stencil=False)


@pytest.fixture(params=[30_000, 400], ids=["one block", "several blocks"])
def block(request, monkeypatch):
    monkeypatch.setattr(run_conduction, "_BLOCK", request.param)
    return request.param


@pytest.mark.parametrize(
    "grid",
    [
        pytest.param(CUT, id="cut voxels", marks=pytest.mark.slice),
        pytest.param(WHOLE, id="whole voxels"),
    ],
)
def test_every_operator_is_that_of_the_links(grid, block):
    runs, _ = run_conduction._voxel_runs(grid.solid, grid.cut, np.dtype(float))
    assert (len(runs.block) > 2) == (block == 400)
    fast, plain = both(grid)
    # Not the findings of the other number of blocks.
    fast = eqx.tree_at(
        lambda structure: structure.runs, fast, jax.tree.map(jnp.asarray, runs)
    )
    assert type(fast) is RunStencil
    theta = jnp.asarray(np.random.default_rng(1).normal(size=grid.solid_count))
    address = (jnp.arange(grid.solid_count),)
    actual = outputs_of(fast, theta, address, jnp.array(0.1))
    expected = outputs_of(plain, theta, address, jnp.array(0.1))
    for name, exact in expected.items():
        np.testing.assert_allclose(
            actual[name], exact, rtol=1e-11, atol=1e-9, err_msg=name
        )
    rate = np.asarray(actual["heat_rate"])
    assert abs(rate.sum()) < 1e-13 * np.abs(rate).sum()


def test_a_uniform_temperature_stays_to_the_bit():
    fast = network(CUT, kernels="numba")
    same = jnp.full(CUT.solid_count, 12.3)
    assert np.array_equal(fast.euler_step(same, jnp.array(0.1)), same)
    assert not np.asarray(fast.heat_rate(same)).any()


def test_single_precision():
    theta = np.random.default_rng(2).normal(size=CUT.solid_count)
    dt = 0.1
    exact = network(CUT, stencil=False).euler_step(jnp.asarray(theta), jnp.array(dt))
    single = network(CUT, jnp.float32, kernels="numba")
    actual = single.euler_step(jnp.asarray(theta, jnp.float32), jnp.float32(dt))
    np.testing.assert_allclose(actual, exact, atol=2e-6)


@partial(jax.jit, static_argnames="options")
def _moved(conductivity, theta, options):
    structure = FullVolume(CUT, **dict(options))
    operator = assemble_uniform(structure, conductivity, HEAT, jnp.float64)
    step = operator.euler_step(theta, jnp.array(0.2))
    return (jnp.sin(step) + 1e-3 * operator.heat_rate(step)).sum()


@pytest.mark.slice
def test_derivatives_are_those_of_the_links_and_of_differences():
    theta = jnp.asarray(np.random.default_rng(3).normal(size=CUT.solid_count))
    gradient = jax.grad(_moved, argnums=(0, 1))
    conductivity = jnp.array(CONDUCTIVITY)
    actual = gradient(conductivity, theta, (("kernels", "numba"),))
    expected = gradient(conductivity, theta, (("stencil", False),))
    jax.tree.map(
        partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-10), actual, expected
    )

    def moved(k):
        return _moved(jnp.asarray(k), theta, (("kernels", "numba"),))

    difference = (moved(16.001) - moved(15.999)) / 0.002
    np.testing.assert_allclose(actual[0], difference, rtol=1e-6)
    along = jax.jvp(moved, (conductivity,), (jnp.ones(()),))
    np.testing.assert_allclose(along[1], actual[0], rtol=1e-12)


def test_several_states_at_once():
    fast, plain = both(WHOLE)
    states = jnp.asarray(np.random.default_rng(4).normal(size=(3, WHOLE.solid_count)))
    dts = jnp.array([0.1, 0.2, 0.3])

    def step(structure):
        return jax.vmap(structure.euler_step)(states, dts)

    np.testing.assert_allclose(step(fast), step(plain), rtol=1e-11, atol=1e-11)


def _scene(kernels):
    # Bodies in contact, one with a conductivity that varies; a source, sun and wind.
    grids = [jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), pitch=0.005), CUT]
    steel = jt.Material(16.0, density=8000.0, specific_heat=500.0)
    varies = jt.Property((290.0, 400.0), (1.0, 1.3))
    clay = jt.Material(varies, density=1700.0, specific_heat=900.0)
    poses = jt.Pose(translation=(0.0, 0.0, 0.1205)), jt.Pose()
    bodies = tuple(
        jt.Body(
            jt.FullVolume(grid, kernels=kernels), material, temperature=start, pose=pose
        )
        for grid, material, start, pose in zip(
            grids, (steel, clay), (350.0, 300.0), poses, strict=True
        )
    )
    terms = (
        jt.Sun((1.0, 0.0, -1.0), 800.0),
        jt.Convection(10.0, 290.0),
        jt.Contact(500.0, (0, 1)),
        jt.HeatSource(1e5),
    )
    return jt.Scene(bodies, terms, dtype="float64")


@pytest.mark.parametrize(
    "solver", [jt.ForwardEuler(), jt.SuperTimeStepping(dt=4.0)], ids=["euler", "rkl2"]
)
def test_a_scene_of_everything_is_that_of_the_stencil(solver):
    actual, expected = (
        jt.simulate(_scene(kernels), 20.0, solver=solver) for kernels in ("numba", None)
    )
    surface = actual.surface_temperature
    np.testing.assert_allclose(surface, expected.surface_temperature, rtol=0, atol=1e-9)
    assert np.ptp(surface) > 20
    assert abs(float(actual.energy.residual_relative[-1])) < 1e-11


def test_implicit_steps_solve_links():
    actual, expected = (
        jt.simulate(_scene(kernels), 20.0, solver=jt.BackwardEuler(dt=10.0))
        for kernels in ("numba", None)
    )
    np.testing.assert_allclose(
        actual.surface_temperature, expected.surface_temperature, rtol=0, atol=1e-6
    )
