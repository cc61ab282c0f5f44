"""The balance of all bodies at once is that of every body alone, to rounding."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.heat_rates import (
    _net_irradiation,
    _surface_nodes,
    add_loads,
)
from jaxthermo.physics.half_cells import varying_half_cells
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.surface_load import SurfaceLoad


PITCH = 0.01
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
WOOD = jt.Material(0.2, density=600.0, specific_heat=1500.0, emissivity=0.6)
MIRROR = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.0)
MELTING = jt.Material(
    jt.Property([250.0, 350.0], [10.0, 30.0]),
    density=8000.0,
    specific_heat=jt.Property([250.0, 350.0], [400.0, 600.0]),
    emissivity=0.5,
)
TOP = jt.Side((0.0, 0.0, 1.0), body=1)


def turning(time):
    return (np.sin(time), 0.3, -1.0)


ALL = (
    jt.Sun((0.5, 0.3, -1.0), jt.Until(800.0, 4.0)),
    jt.Wind((0.0, 3.0, 0.0), 283.0, speed=lambda time: 1.0 + time),
    jt.Surroundings(268.0, ground=288.0),
    jt.Convection(20.0, jt.Table([0.0, 5.0], [280.0, 290.0]), on=TOP),
    jt.HeatFlux(200.0, on=jt.Side((0.0, 1.0, 0.0), body=2)),
    jt.FixedTemperature(310.0, on=jt.Side((0.0, 0.0, -1.0))),
)
MUTUAL = (
    jt.RadiativeExchange(280.0, max_patches=24, directions=24),
    jt.FreeConvection(285.0, length=0.05),
    jt.Sun((0.5, 0.3, -1.0), 800.0),
)
SCENES = {
    "everything": (ALL, (STEEL, WOOD, STEEL)),
    "properties": (ALL[2:], (STEEL, MELTING, WOOD)),
    "motion": ((jt.Sun(turning, 800.0), jt.Surroundings(268.0)), (STEEL, WOOD, STEEL)),
    "mutual radiation": (MUTUAL, (STEEL, MIRROR, WOOD)),
}


@pytest.fixture(scope="module")
def grids():
    box = jt.voxelize(jt.shapes.box((0.03, 0.04, 0.05)), PITCH)
    return box, jt.voxelize(jt.shapes.sphere(0.025), PITCH)


def _scene(grids, terms, materials, starts=(300.0, 290.0, 320.0)):
    box, ball = grids
    structures = jt.FullVolume(box), jt.SingleShell(ball), jt.Octree(ball)
    places = (0.0, 0.04, -0.08)
    return jt.Scene(
        tuple(
            jt.Body(structure, material, temperature=start, pose=jt.Pose((x, 0.0, 0.0)))
            for structure, material, start, x in zip(
                structures, materials, starts, places, strict=False
            )
        ),
        terms,
        dtype="float64",
    )


@eqx.filter_jit
def _together(program, states, time):
    """Heat rates of all cells, body by body, and of the ledger entries."""
    nodes = _surface_nodes(program, states)
    received = _net_irradiation(program, nodes, time)
    networks = [program.bodies[c.body].network for c in program.surface.cells]
    return program.surface.heat(time, nodes, networks, received)


@eqx.filter_jit
def _alone(program, states, time):
    """The same from the balance of one body after the other: the simple form."""
    load = program.surface
    entries = jnp.zeros(len(program.entries))
    heat = []
    nodes = _surface_nodes(program, states)
    received = _net_irradiation(program, nodes, time)
    for index, cells in enumerate(load.cells):
        at_cells = cells.cells_of(nodes[index])
        network = program.bodies[cells.body].network
        varying = varying_half_cells(
            [network], fractions=[cells.conductivity_parts], counts=[len(at_cells)]
        )
        terms = replace(load.terms_on(index), varying=varying)
        if received is not None:
            terms = terms.irradiated(load.apart(received)[index], emits=False)
        rate, by_term = terms.heat(time, at_cells)
        heat.append(rate)
        for number, row in enumerate(load.entries):
            if row[index] >= 0:
                entries = entries.at[row[index]].add(by_term[number])
    return heat, entries


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_one_balance_is_all_bodies_own(grids, name):
    compiled = compile_scene(_scene(grids, *SCENES[name]), 1, 5.0)
    chance = np.random.default_rng(0)
    states = tuple(
        state + chance.uniform(-5, 5, state.shape) for state in compiled.state
    )
    first = jax.tree.map(np.shape, eqx.filter(compiled.programs[0], eqx.is_array))
    for program in compiled.programs[:: len(compiled.programs) // 2 or 1]:
        # Every moment runs the same compiled step.
        assert jax.tree.map(np.shape, eqx.filter(program, eqx.is_array)) == first
        now = jnp.asarray(0.5)
        joined = _together(program, states, now)
        alone = _alone(program, states, now)
        for first_values, second in zip(joined[0], alone[0], strict=True):
            np.testing.assert_allclose(first_values, second, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(joined[1], alone[1], rtol=1e-12, atol=1e-14)
        assert np.abs(joined[1]).max() > 0.1


def _equations(jaxpr):
    for equation in jaxpr.eqns:
        yield equation
        for inner in jax.extend.core.jaxprs_in_params(equation.params):
            yield from _equations(inner)


def _wind_equations(scene):
    compiled = compile_scene(scene, 1, 5.0)
    arrays, static = eqx.partition(compiled.program, eqx.is_array)
    now = jnp.zeros(())

    def step(arrays, states):
        return add_loads(eqx.combine(arrays, static), states, states, now, now)

    jaxpr = jax.make_jaxpr(step)(arrays, compiled.state)
    scopes = [str(e.source_info.name_stack) for e in _equations(jaxpr.jaxpr)]
    return sum("wind" in scope for scope in scopes)


def test_the_program_holds_one_balance(grids):
    wind = (jt.Wind((0.0, 3.0, 0.0), 283.0),)
    three = _scene(grids, wind, (STEEL,) * 3)
    single = jt.Scene(three.bodies[:1], wind, dtype="float64")
    assert 0 < _wind_equations(three) == _wind_equations(single)


def test_a_body_without_terms_has_no_cells(grids):
    def loaded(*terms):
        load = compile_scene(_scene(grids, terms, (STEEL,) * 3)).program.surface
        return [] if load is None else [cells.body for cells in load.by_cell.cells]

    flux = jt.HeatFlux(200.0, on=TOP)
    assert loaded() == [] and loaded(flux) == [1]
    assert loaded(flux, jt.Surroundings(280.0)) == [0, 1, 2]


def test_sky_and_ground_are_one_entry_and_an_absent_term_none(grids):
    terms = (jt.Surroundings(300.0, ground=290.0), jt.HeatFlux(10.0, on=TOP))
    load = compile_scene(_scene(grids, terms, (STEEL, STEEL, MIRROR))).program.surface
    assert isinstance(load, SurfaceLoad)
    # The third body has no surface load.
    assert load.entries == ((0, 1), (-1, 2)) and len(load.cells) == 2
    assert [n for n, _ in load.terms.natural] == [0, 0, 1]


@pytest.mark.slow
@pytest.mark.slice
# The second body has few voxels across.
@pytest.mark.filterwarnings("ignore:body 1 represents")
def test_gradients_go_through_the_joined_balance(grids):
    """By the second body's parameters, and the wind's."""

    def run(p):
        program = jt.Material(
            p["conductivity"], 8000.0, specific_heat=500.0, emissivity=p["emissivity"]
        )
        terms = (
            jt.Wind((0.0, 1.0, 0.0), 283.0, speed=p["speed"]),
            jt.Surroundings(268.0, ground=288.0),
        )
        scene = _scene(grids, terms, (STEEL, program), starts=(300.0, p["start"]))
        solution = jt.simulate(scene, 1.0, solver=jt.ForwardEuler(dt=0.5))
        return jnp.mean((solution.surface_temperature - 300.0) ** 2)

    at = {"emissivity": 0.7, "start": 310.0, "conductivity": 16.0, "speed": 3.0}
    slopes = jax.jit(jax.grad(run))(at)
    value = jax.jit(run)
    for name in at:
        step = 1e-4 * at[name]
        up, down = (value(at | {name: at[name] + d}) for d in (step, -step))
        assert abs(slopes[name]) > 1e-6
        np.testing.assert_allclose(slopes[name], (up - down) / (2 * step), rtol=1e-5)
