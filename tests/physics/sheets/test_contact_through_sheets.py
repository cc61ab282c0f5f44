"""Heat through contacts of sheets: series of resistances, two nodes, derivatives."""

import functools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from tests.sheet_bodies import plate
from tests.slopes import check_gradient


METAL = jt.Material(50.0, 2000.0, specific_heat=500.0, emissivity=0.5)
SIZE = (0.4, 0.3)
AREA = 0.4 * 0.3
UP = (0.0, 0.0, 1.0)
DOWN = (0.0, 0.0, -1.0)
SOLVERS = {
    "explicit": jt.ForwardEuler(dt=0.5),
    "stages": jt.SuperTimeStepping(dt=0.5, stages=3),
    "implicit": jt.TRBDF2(dt=1.0),
}


@functools.cache
def mesh():
    return plate(*SIZE)


def sheet_at(height, temperature, thickness=1e-3, cells=1):
    layers = (jt.Layer(METAL, thickness),)
    sheet = jt.Sheet(mesh(), layers, pitch=0.1, cells=cells)
    pose = jt.Pose((0.0, 0.0, height))
    return jt.Body(sheet, temperature=temperature, pose=pose)


@functools.cache
def block_structure():
    return jt.FullVolume(jt.voxelize(jt.shapes.box((*SIZE, 0.2)), 0.05))


def block(temperature=300.0):
    pose = jt.Pose((0.0, 0.0, -0.1))
    return jt.Body(block_structure(), METAL, temperature=temperature, pose=pose)


@pytest.mark.parametrize(("cells", "contact"), [(1, jt.Contact(200.0)), (4, jt.bonded)])
def test_a_plate_on_a_block_is_a_series_of_resistances(cells, contact):
    """Air, the plate, the contact, and the block held at its bottom."""
    thickness = 0.02
    terms = (
        contact,
        jt.Convection(40.0, 400.0, on=jt.Face("front", body=0)),
        jt.FixedTemperature(300.0, on=jt.Side(DOWN, body=1)),
    )
    bodies = (sheet_at(0.0, 300.0, thickness, cells), block())
    warm = jt.steady(jt.Scene(bodies, terms, dtype="float64"))
    through_contact = 1 / float(contact.conductance)
    resistance = 1 / 40.0 + thickness / 50.0 + through_contact + 0.2 / 50.0
    flux = 100.0 / resistance
    plate_middle = 400.0 - flux * (1 / 40.0 + thickness / 100.0)
    block_middle = 300.0 + flux * 0.1 / 50.0
    assert_allclose(
        warm.mean_temperature[0], [plate_middle, block_middle], atol=1e-6 * 100.0
    )


def pair(conductance):
    """Two plates of 1 and 2 mm, 4 mm apart; the first is hot."""
    bodies = (sheet_at(0.0, 350.0), sheet_at(0.004, 300.0, thickness=2e-3))
    return jt.Scene(bodies, (jt.Contact(conductance),), dtype="float64")


@pytest.mark.parametrize("solver", SOLVERS)
def test_two_plates_with_a_gap_conductance_approach_exponentially(solver):
    scene = pair(80.0)
    times = [0.0, 4.0, 10.0, 20.0]
    solution = jt.simulate(scene, times[-1], times, solver=SOLVERS[solver])
    through = 1 / (1 / 80.0 + 0.5e-3 / 50.0 + 1e-3 / 50.0)
    first, second = 1e-3 * 1e6, 2e-3 * 1e6
    decay = np.exp(-through * (1 / first + 1 / second) * np.array(times))
    mean = (350.0 * first + 300.0 * second) / (first + second)
    exact = [
        mean + 50.0 * decay * second / (first + second),
        mean - 50.0 * decay * first / (first + second),
    ]
    within = 0.4 if solver == "explicit" else 0.02
    assert_allclose(solution.mean_temperature.T, exact, atol=within)
    energy = solution.energy
    exchanged = np.asarray(energy.contacts["contact 0-1"])
    assert exchanged[-1] == pytest.approx(
        AREA * first * (350.0 - float(solution.mean_temperature[-1, 0])), rel=1e-9
    )
    assert_array_equal(energy.bodies[0].contacts["contact 0-1"], -exchanged)
    assert_array_equal(energy.bodies[1].contacts["contact 0-1"], exchanged)
    for body in energy.bodies:
        assert np.abs(body.residual_relative).max() < 1e-11


@pytest.mark.parametrize(
    "solver", ["explicit", "stages", pytest.param("implicit", marks=pytest.mark.slow)]
)
def test_the_derivative_with_respect_to_the_conductance(solver):
    def cold_plate(conductance):
        solution = jt.simulate(pair(conductance), 20.0, solver=SOLVERS[solver])
        return solution.mean_temperature[0, 1]

    check_gradient(cold_plate, 80.0, step=1e-3, rtol=1e-6)


@pytest.mark.slow
def test_the_derivative_of_a_steady_state_with_respect_to_the_conductance():
    terms = (
        jt.Convection(40.0, 400.0, on=jt.Face("front", body=0)),
        jt.FixedTemperature(300.0, on=jt.Side(DOWN, body=1)),
    )

    def warm_plate(conductance):
        bodies = (sheet_at(0.0, 300.0), block())
        scene = jt.Scene(bodies, (jt.Contact(conductance), *terms), dtype="float64")
        return jt.steady(scene).mean_temperature[0, 0]

    check_gradient(warm_plate, 200.0, step=1e-2, rtol=1e-6)


def test_a_bonded_cladding_takes_the_place_of_the_surface():
    """Heat enters the block through the cladding alone, as fast as through its skin."""
    grid = jt.voxelize(jt.shapes.box((0.1, 0.08, 0.06)), 0.01)
    solid = jt.Body(jt.FullVolume(grid), METAL, temperature=300.0)
    sheet = jt.Sheet(grid.mesh, (jt.Layer("copper", 0.5e-3),), pitch=0.01)
    cladding = jt.Body(sheet, temperature=300.0)
    terms = (jt.bonded, jt.HeatFlux(1000.0))
    scene = jt.Scene((solid, cladding), terms, dtype="float64")
    solution = jt.simulate(scene, 60.0, [60.0])
    heat = np.asarray(solution.energy.mechanisms["heat_flux"])[-1]
    assert heat == pytest.approx(1000.0 * grid.mesh.area * 60.0, rel=0.01)
    into_solid = np.asarray(solution.energy.bodies[0].mechanisms["heat_flux"])[-1]
    assert abs(into_solid) < 0.01 * heat
    rise = heat / (
        grid.mesh.volume * 1e6
        + sheet.volume * float(jt.materials["copper"].volumetric_heat_capacity)
    )
    means = np.asarray(solution.mean_temperature)[-1]
    assert means[0] == pytest.approx(300.0 + rise, abs=0.05 * rise)
    assert_allclose(
        np.asarray(solution.of_body(0))[-1].mean(), means[1], atol=0.02 * rise
    )
