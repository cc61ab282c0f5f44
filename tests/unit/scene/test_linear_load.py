"""Linear loads summed by nodes are those of the surface cells, to rounding."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.heat_rates import add_loads
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.linear_load import _LinearSurfaceLoad
from jaxthermo.scene.compile.surface_load import SurfaceLoad
from tests.bodies import bar


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
WOOL = jt.Material(0.01, density=100.0, specific_heat=800.0, emissivity=0.9)
GLASS = jt.Material(1.0, density=2500.0, specific_heat=800.0, emissivity=0.9)
BELOW = jt.Side((0.0, 0.0, -1.0))
TERMS = (
    jt.Sun((0.5, 0.3, -1.0), jt.Until(800.0, 4.0)),
    jt.Convection(500.0, jt.Table([0.0, 5.0], [280.0, 310.0])),
    jt.Convection(20.0, 270.0),
    jt.HeatFlux(jt.Table([0.0, 10.0], [100.0, 500.0]), on=jt.Side((1.0, 0.0, 0.0))),
    jt.FixedTemperature(jt.Table([0.0, 5.0], [300.0, 330.0]), on=BELOW),
)


@pytest.fixture(scope="module")
def ball():
    return jt.voxelize(jt.shapes.sphere(0.025), 0.005)


def _scene(structures, terms=TERMS, material=STEEL):
    bodies = tuple(
        jt.Body(
            load, material, temperature=295.0 + n, pose=jt.Pose((0.1 * n, 0.0, 0.0))
        )
        for n, load in enumerate(structures)
    )
    return jt.Scene(bodies, terms, dtype="float64")


@eqx.filter_jit
def _loaded(program, states, time):
    return add_loads(program, states, states, time, jnp.ones(()))


_capacity = eqx.filter_jit(lambda network: network.capacity())


def _by_cell(program):
    return replace(program, surface=program.surface.by_cell)


@pytest.mark.parametrize(
    "material",
    [STEEL, pytest.param(WOOL, marks=pytest.mark.slow)],
    ids=["steel", "wool"],
)
@pytest.mark.parametrize(
    "structures", [(jt.FullVolume,), (jt.Aggregate, jt.Octree)], ids=["lattice", "two"]
)
def test_they_bring_what_the_cells_do(ball, structures, material):
    bodies = [structure(ball) for structure in structures]
    compiled = compile_scene(_scene(bodies, TERMS, material))
    program = compiled.program
    assert isinstance(program.surface, _LinearSurfaceLoad)
    chance = np.random.default_rng(0)
    started = (np.asarray(state) for state in compiled.state)
    states = tuple(s + chance.uniform(-5, 5, s.shape) for s in started)
    for time in map(np.asarray, (0.0, 3.0, 4.5)):
        actual, entries = _loaded(program, states, time)
        expected, told = _loaded(_by_cell(program), states, time)
        for linear, general, state in zip(actual, expected, states, strict=True):
            assert np.abs(linear - state).max() > 1e-4
            np.testing.assert_allclose(linear, general, rtol=0, atol=1e-11)
        np.testing.assert_allclose(entries, told, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("further", [(), (jt.Surroundings(280.0),)])
def test_terms_bring_what_the_half_cells_conduct_at_any_biot_number(further):
    """What the nodes gain and what the ledger says differ by rounding of the gain."""
    half = 2 / 0.01
    terms = [jt.Convection(biot * half, 350.0) for biot in (1.0, 1e3, 1e6, 3.3e7)]
    structure = jt.FullVolume(bar(3, 0.01))
    for term in terms:
        compiled = compile_scene(_scene([structure], (term, *further), GLASS))
        program = compiled.program
        start = np.asarray(compiled.state[0])
        assert isinstance(program.surface, _LinearSurfaceLoad) == (not further)
        theta = start + np.linspace(50.0, 60.0, start.size).reshape(start.shape)
        (state,), entries = _loaded(program, (theta,), np.zeros(()))
        capacity = _capacity(program.bodies[0].network)
        gained = float(((state - theta) * capacity).sum())
        moved = half * 1e-4 * 14 * 60.0
        assert abs(float(entries.sum()) - gained) < 1e-14 * moved


def test_what_is_not_linear_goes_by_cells(ball):
    def load_type(*terms):
        compiled = compile_scene(_scene([jt.Aggregate(ball)], terms))
        return type(compiled.program.surface)

    assert load_type(TERMS[0], TERMS[2]) is _LinearSurfaceLoad
    assert load_type(TERMS[0], jt.Surroundings(280.0)) is SurfaceLoad
    assert load_type(jt.Convection(lambda time: 1.0 + time, 280.0)) is SurfaceLoad
    warm = jt.Surroundings(295.0, linear_within=0.2)
    assert load_type(TERMS[2], warm) is _LinearSurfaceLoad


def test_energy_closes_and_gradients_are_differences(ball):
    structure = jt.Aggregate(ball, factor=2)

    def warmth(values):
        h, k, watts = values
        terms = (
            jt.Sun((0.5, 0.3, -1.0), jt.Until(watts, 4.0)),
            jt.Convection(h, 290.0),
            jt.FixedTemperature(300.0, on=BELOW),
        )
        metal = jt.Material(k, density=8000.0, specific_heat=500.0, emissivity=0.9)
        scene = _scene([structure], terms, metal)
        solved = jt.simulate(scene, 8.0, [4.0, 8.0], solver=jt.ForwardEuler(dt=0.1))
        return solved.surface_temperature.mean(), solved.energy.residual_relative

    at = np.array([30.0, 16.0, 900.0])
    rates = jax.jit(lambda at, along: jax.jvp(warmth, (at,), (along,)))
    for along in np.eye(3):
        (_, residual), (actual, _) = rates(at, along)
        assert np.abs(residual).max() < 1e-12
        step = 1e-4 * at @ along
        ends = [rates(at + sign * step * along, along)[0][0] for sign in (1, -1)]
        expected = float((ends[0] - ends[1]) / (2 * step))
        assert float(actual) == pytest.approx(expected, rel=1e-6)
