"""Differences along faces taken off: exact for linear temperatures; heat is kept."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.accuracy.surface_error import surface_error
from jaxthermo.network.link_operator import RowNetwork
from jaxthermo.network.non_orthogonal import _NonOrthogonalNetwork
from jaxthermo.physics.conduction import assemble_uniform
from jaxthermo.structures.partition.links import _face_normals
from tests.bodies import slanted


K = 16.0
HEAT = 4e6
PITCH = 0.01
SLOPE = np.array([30.0, -20.0, 50.0])
STEEL = jt.Material(K, density=8000.0, specific_heat=500.0)


@pytest.fixture(scope="module", name="slanted")
def slanted_body():
    return slanted(PITCH)


def _structure(grid, structure_name, correction: Any = 1.0):
    weights = jt.ConductionWeights(non_orthogonal=correction)
    if structure_name == "core":
        return jt.ShellOverCore(grid, factor=3, weights=weights)
    return jt.Aggregate(
        grid, factor=3, alignment=0.0, min_time_constant=0.0, weights=weights
    )


def _network(structure):
    return assemble_uniform(structure, K, HEAT, jnp.float64)


@eqx.filter_jit
def _heat_rate(structure, state):
    """Assembled and applied by one program."""
    return _network(structure).heat_rate(state)


@eqx.filter_jit
def _rates_and_bound(structure):
    """Rates of temperatures by temperatures [1/s], and the bound of their modes."""
    network = _network(structure)
    rates = jax.vmap(network.heat_rate)(jnp.eye(structure.node_count)).T
    return rates / network.capacity()[:, None], 2 * network.max_rate()


@pytest.mark.parametrize("structure_name", ["aggregate", "core"])
def test_linear_temperatures_conduct_exactly(slanted, structure_name):
    """Through every face flows k A g . n, whatever lies on its sides."""
    structure = _structure(slanted, structure_name)
    links = structure.links()
    position = structure.nodes().location
    flow = K * links.area * (_face_normals(structure) @ SLOPE)
    exact = np.zeros(structure.node_count)
    np.add.at(exact, links.src, flow)
    np.add.at(exact, links.dst, -flow)
    plain, corrected = (
        np.abs(np.asarray(_heat_rate(networks, position @ SLOPE)) - exact)
        for networks in (_structure(slanted, structure_name, 0.0), structure)
    )
    # Nodes at edges have flat second moments, hence no gradient across.
    assert (corrected < 1e-9 * np.abs(exact).max()).mean() > 0.9
    assert corrected.max() < plain.max()


@pytest.mark.parametrize("structure_name", ["aggregate", "core"])
def test_heat_is_kept_and_uniform_bodies_rest(slanted, structure_name):
    structure = _structure(slanted, structure_name)
    network = eqx.filter_eval_shape(_network, structure)
    assert isinstance(network, _NonOrthogonalNetwork)
    assert not network.is_symmetric
    state = np.random.default_rng(3).normal(size=structure.node_count)
    rates = np.asarray(_heat_rate(structure, state))
    assert abs(rates.sum()) < 1e-10 * np.abs(rates).sum()
    at_rest = _heat_rate(structure, np.full_like(state, 7.0))
    np.testing.assert_allclose(at_rest, 0, atol=1e-11)


def test_no_weight_is_the_two_point_flux(slanted):
    structure = _structure(slanted, "core", 0.0)
    plain = eqx.filter_eval_shape(_network, structure)
    assert isinstance(plain, RowNetwork)
    state = np.random.default_rng(4).normal(size=structure.node_count)
    state = jax.device_put(state)

    @jax.jit
    def rates(weight):
        return _network(_structure(slanted, "core", weight)).heat_rate(state)

    np.testing.assert_allclose(rates(0.0), _heat_rate(structure, state), rtol=1e-12)
    full = eqx.filter_eval_shape(_network, jt.FullVolume(slanted))
    assert plain.is_symmetric and full.is_symmetric


def test_nothing_apart_needs_nothing(slanted):
    straight = jt.SingleShell(slanted, weights=jt.ConductionWeights(non_orthogonal=1.0))
    assert isinstance(eqx.filter_eval_shape(_network, straight), RowNetwork)


@pytest.mark.parametrize(
    ("structure_name", "weight"),
    [
        ("aggregate", 0.5),
        ("aggregate", 1.0),
        ("aggregate", 2.0),
        pytest.param("core", 0.5, marks=pytest.mark.slow),
        pytest.param("core", 1.0, marks=pytest.mark.slow),
        pytest.param("core", 2.0, marks=[pytest.mark.slow, pytest.mark.slice]),
    ],
)
def test_all_modes_decay_and_the_stable_step_is_safe(slanted, structure_name, weight):
    # Traced, so that one program serves every weight.
    structure = _structure(slanted, structure_name, jnp.asarray(weight))
    matrix, fastest = _rates_and_bound(structure)
    modes = np.linalg.eigvals(np.asarray(matrix))
    fastest = float(fastest)
    assert modes.real.max() < 1e-9 * fastest
    assert np.abs(modes).max() <= fastest
    # A step of many stages damps modes near the real axis.
    modes = modes[np.abs(modes) > 1e-6 * fastest]
    turning = 0.02 if weight <= 1 else 0.2
    assert (np.abs(modes.imag) <= turning * np.abs(modes.real)).all()


def test_slopes_by_the_weight_are_finite_differences(slanted):
    count = _structure(slanted, "core").node_count
    state = jax.device_put(np.random.default_rng(5).normal(size=count))

    def rates(weight):
        return _network(_structure(slanted, "core", weight)).heat_rate(state)

    both_rates = jax.jit(lambda weight: jax.jvp(rates, (weight,), (jnp.ones(()),)))
    at = 0.7
    step = 1e-5
    along = np.asarray(both_rates(at)[1])
    difference = (both_rates(at + step)[0] - both_rates(at - step)[0]) / (2 * step)
    np.testing.assert_allclose(along, difference, atol=1e-6 * np.abs(along).max())
    back = jax.jit(jax.grad(lambda weight: (rates(weight) * state).sum()))(at)
    assert float(back) == pytest.approx(float(along @ state), rel=1e-9)


def _scene(structure):
    sun = jt.Sun(direction=(-1.0, 0.0, -1.0), irradiance=5000.0)
    body = jt.Body(structure, STEEL, temperature=293.15)
    return jt.Scene(bodies=(body,), terms=(sun,), dtype="float64")


@pytest.mark.slow
def test_it_is_nearer_to_the_full_volume(slanted):
    times = [60.0, 240.0]

    def run(structure):
        return jt.simulate(_scene(structure), 240.0, times)

    reference = run(jt.FullVolume(slanted))
    plain, corrected = (
        surface_error(run(_structure(slanted, "core", w)), reference).rms_percent
        for w in (0.0, 1.0)
    )
    assert (np.asarray(corrected) < np.asarray(plain)).all()
    assert float(corrected[-1]) < 0.85 * float(plain[-1])


def test_what_solves_refuses_it_in_a_line(slanted):
    body = jt.Body(_structure(slanted, "core"), STEEL, temperature=293.15)
    cooled = jt.Convection(heat_transfer_coefficient=10.0, temperature=300.0)
    scene = jt.Scene((body,), (cooled,), dtype="float64")
    for solver in (jt.TRBDF2(), jt.BackwardEuler(dt=10.0)):
        with pytest.raises(jt.InputError, match="not symmetric") as actual:
            jt.simulate(scene, 60.0, solver=solver)
        assert "\n" not in str(actual.value)
    with pytest.raises(jt.InputError, match="non_orthogonal"):
        jt.steady(scene)
    solution = jt.simulate(scene, 60.0, solver=jt.SuperTimeStepping(dt=10.0))
    assert np.isfinite(np.asarray(solution.surface_temperature)).all()
