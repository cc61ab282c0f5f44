"""A body in sections has every voxel once, and all of its neighbours."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.network.sectioned_stencil import SectionedStencil
from jaxthermo.network.stencil import solid_degree
from jaxthermo.physics.conduction import _assemble_mixed, assemble_uniform
from jaxthermo.voxels import packed_lattice as module
from jaxthermo.voxels.packed_lattice import packed_lattice
from tests.bodies import blocks


PITCH = 0.01


@pytest.fixture(autouse=True)
def free_cuts(monkeypatch):
    """Small bodies are packed too."""
    monkeypatch.setattr(module, "_CUT_COST", 0.0)
    monkeypatch.setattr(module, "_PAIR_COST", 0.0)
    monkeypatch.setattr(module, "_MAX_COST", 1.0)


def staircase(seed: int = 0) -> np.ndarray:
    """Boxes along a diagonal that overlap, with some voxels missing."""
    random = np.random.default_rng(seed)
    solid = np.zeros((11, 9, 14), bool)
    for step in range(5):
        x = 2 * step
        y = step
        z = 2 * step + step // 2
        solid[x : x + 3, y : y + 4, z : z + 4] = True
    return solid & (random.random(solid.shape) < 0.9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_every_voxel_is_there_once_and_loses_no_neighbour(seed, order):
    solid = staircase(seed).transpose(order)
    packed = packed_lattice(solid)
    assert packed is not None
    assert np.prod(np.add(packed.shape, 2)) < solid.size
    voxel = np.argwhere(solid)
    cells = packed.cells(voxel)
    lattice = packed.packed(solid)
    assert lattice.sum() == len(voxel) == len(np.unique(cells, axis=0))
    assert lattice[tuple(cells.T)].all()
    numbers = np.arange(solid.size).reshape(solid.shape)
    assert (packed.packed(numbers)[tuple(cells.T)] == numbers[solid]).all()
    # No neighbours that the body has not, and all others across cuts.
    front, behind = packed.cut_pairs(solid)
    assert (np.abs(behind - front).sum(axis=1) == 1).all()
    degree = solid_degree(lattice).astype(int)
    for end in (front, behind):
        np.add.at(degree, tuple(packed.cells(end).T), 1)
    assert (degree[tuple(cells.T)] == solid_degree(solid)[solid]).all()


def test_full_boxes_and_small_bodies_are_not_packed(monkeypatch):
    assert packed_lattice(np.ones((6, 5, 4), bool)) is None
    assert not jt.FullVolume(blocks(np.ones((6, 5, 4), bool), PITCH)).packed
    monkeypatch.undo()
    assert packed_lattice(staircase()) is None
    large = np.kron(staircase(), np.ones((12, 12, 12), bool))
    packed = packed_lattice(large)
    assert packed is not None
    assert np.prod(np.add(packed.shape, 2)) < 0.7 * large.size


def networks(properties: str) -> list[tuple[jt.FullVolume, object]]:
    """A network of the sections, and that of the whole box."""
    pairs = []
    grid = blocks(staircase(), PITCH)
    for sections in (True, False):
        structure = jt.FullVolume(grid, sections=sections)
        if properties == "mixed":
            number = np.arange(structure.node_count, dtype=np.int32) % 3
            k = jnp.array([16.0, 0.0, 400.0])
            heat = jnp.array([4e6, 1e6, 3e6])
            network = _assemble_mixed(structure, number, k, heat)
        elif properties == "mixed by axis":
            number = np.arange(structure.node_count, dtype=np.int32) % 2
            k = jnp.array([[16.0, 2.0, 9.0], [3.0, 50.0, 1.0]])
            network = _assemble_mixed(structure, number, k, jnp.array([4e6, 1e6]))
        else:
            k = (16.0, 2.0, 9.0) if properties == "by axis" else 16.0
            network = assemble_uniform(structure, k, 4e6, jnp.float64)
        pairs.append((structure, network))
    assert isinstance(pairs[0][1], SectionedStencil)
    return pairs


@eqx.filter_jit
def all_of(network, state, address):
    at = lambda values: values[address]
    return {
        "heat_rate": at(network.heat_rate(state)),
        "face_heat_rate": at(network.face_heat_rate(state)),
        "euler_step": at(network.euler_step(state, jnp.asarray(0.1))),
        "diagonal": at(network.diagonal()),
        "capacity": network.capacity_at(address),
        "max_rate": network.max_rate(),
        "total_capacity": network.total_capacity(),
        "stored": network.stored(state),
        "outside": jnp.abs(network.euler_step(state, jnp.asarray(0.1))).sum()
        - jnp.abs(at(network.euler_step(state, jnp.asarray(0.1)))).sum(),
    }


@pytest.mark.parametrize("properties", ["uniform", "by axis", "mixed", "mixed by axis"])
def test_sections_conduct_as_the_whole_box(properties):
    results = []
    for structure, network in networks(properties):
        address = tuple(map(jnp.asarray, structure.node_address()))
        values = np.random.default_rng(1).normal(size=structure.node_count)
        state = jnp.zeros(structure.state_shape).at[address].set(values)
        results.append(all_of(network, state, address))
    sections, box = results
    for name, values in box.items():
        np.testing.assert_allclose(
            sections[name], values, rtol=1e-12, atol=1e-10, err_msg=name
        )


@functools.cache
def cone(sections: bool) -> jt.FullVolume:
    """A structure with cut voxels; made in a test, where small bodies are packed."""
    grid = jt.voxelize(jt.shapes.cone(0.03, 0.06), 0.004, "crossings")
    return jt.FullVolume(grid, sections=sections)


def scene(sections: bool, conductivity=16.0) -> jt.Scene:
    """A body with cut voxels in the sun and in air, heated inside."""
    material = jt.Material(conductivity, density=8000.0, specific_heat=500.0)
    warm = lambda x: 300.0 + 200.0 * x[:, 0]
    structure = cone(sections)
    body = jt.Body(structure, material, temperature=warm)
    sun = jt.Sun((-1.0, 0.0, -0.4), 900.0)
    air = jt.Convection(20.0, 290.0)
    return jt.Scene((body,), (sun, air, jt.HeatSource(2e5)), dtype="float64")


def run(sections: bool, conductivity=16.0) -> jt.Solution:
    heated = scene(sections, conductivity)
    solver = jt.ForwardEuler(dt=0.5)
    return jt.simulate(heated, 20.0, [10.0, 20.0], solver=solver)


def loss(conductivity, sections):
    """A number of a run, and the run's results."""
    solution = run(sections, conductivity)
    results = (
        solution.surface_temperature,
        solution.mean_temperature,
        solution.energy.stored_J,
    )
    return (solution.surface_temperature[-1] ** 2).mean(), results


traced = jax.jit(jax.value_and_grad(loss, has_aux=True), static_argnums=1)


def test_a_run_in_sections_is_the_run_over_the_box():
    packed = run(True)
    (_, (surface, mean, stored)), _ = traced(16.0, False)
    (body,) = scene(True).bodies
    assert isinstance(body.structure, jt.FullVolume) and body.structure.packed
    np.testing.assert_allclose(packed.surface_temperature, surface, rtol=1e-12)
    np.testing.assert_allclose(packed.mean_temperature, mean, rtol=1e-12)
    np.testing.assert_allclose(packed.energy.stored_J, stored, rtol=1e-10)


def test_gradients_are_those_of_the_box_and_differences():
    slopes = [traced(16.0, sections)[1] for sections in (True, False)]
    difference = (traced(16.01, True)[0][0] - traced(15.99, True)[0][0]) / 0.02
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-9)
    np.testing.assert_allclose(slopes[0], difference, rtol=1e-6)


def test_solves_store_the_links():
    structure = scene(True).bodies[0].structure
    assert len(structure.state_shape) == 3
    assert len(structure.for_solves().state_shape) == 1
