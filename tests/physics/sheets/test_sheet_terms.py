"""Every mechanism on a sheet, with every solver, beside solids and other sheets."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from tests.bodies import body_at
from tests.sheet_bodies import BACK, FRONT, plate


SIZE = 0.1
AREA = SIZE**2
START = 300.0
THICKNESS = 1e-3
METAL = jt.Material(
    200.0, density=2700.0, specific_heat=900.0, emissivity=0.8, absorptivity=0.6
)
LAYERS = (jt.Layer(METAL, THICKNESS),)


def panel(height=0.0, temperature=START, layers=LAYERS):
    """A square sheet facing up."""
    sheet = jt.Sheet(plate(SIZE, SIZE), layers, pitch=0.05)
    return jt.Body(sheet, temperature=temperature, pose=jt.Pose((0.0, 0.0, height)))


def emitted(temperature):
    """Net radiation from black surroundings to a face [W/m^2]."""
    return 0.8 * STEFAN_BOLTZMANN * (temperature**4 - START**4)


HEAT_RATES = {
    "heat flux on both faces": (jt.HeatFlux(100.0), 200.0),
    "heat flux on the front": (jt.HeatFlux(100.0, on=FRONT), 100.0),
    "heat flux on all but the front": (jt.HeatFlux(100.0, on=~FRONT), 100.0),
    "air at both faces": (jt.Convection(10.0, 310.0), 200.0),
    "air at the back": (jt.Convection(10.0, 310.0, on=BACK), 100.0),
    "sun from above": (jt.Sun((0.6, 0.0, -0.8), 800.0), 0.6 * 0.8 * 800.0),
    "sun from below": (jt.Sun((0.6, 0.0, 0.8), 800.0), 0.6 * 0.8 * 800.0),
    "sun on the back alone": (jt.Sun((0.6, 0.0, -0.8), 800.0, on=BACK), 0.0),
    "distant lamp": (jt.PointSource((0.0, 0.0, 10.0), 5000.0), 0.6 * 50.0),
    "distant panel": (
        jt.AreaSource((0.0, 0.0, -10.0), (0.0, 0.0, 1.0), (0.2, 0.2), radiance=1e5),
        0.6 * 1e5 * 0.04 / 100.0,
    ),
    "surroundings": (jt.Surroundings(280.0), 2 * emitted(280.0)),
    "sky and ground": (
        jt.Surroundings(250.0, ground=310.0),
        emitted(250.0) + emitted(310.0),
    ),
    "exchange with surroundings": (jt.RadiativeExchange(280.0), 2 * emitted(280.0)),
    "daylight": (jt.DiffuseSky(100.0, reflected=30.0), 0.6 * 130.0),
    "heat source": (jt.HeatSource(heat_rate=3.0), 3.0 / AREA),
    "density of heat": (jt.HeatSource(1e5), 1e5 * THICKNESS),
}
"""Terms, and the heat rate into the panel over its area [W/m^2]."""


@pytest.mark.parametrize("case", HEAT_RATES)
def test_heat_rate_of_each_mechanism(case):
    term, expected = HEAT_RATES[case]
    scene = jt.Scene((panel(),), (term,), dtype="float64")
    step = 1e-3
    solution = jt.simulate(scene, step, solver=jt.ForwardEuler(dt=step))
    heat = solution.energy.mechanisms
    rate = float(heat[term.name][0]) / step if heat else 0.0
    # Lamps are at distances of a hundred sizes.
    assert rate / AREA == pytest.approx(expected, rel=2e-3, abs=1e-9)


def test_held_back_has_its_temperature():
    terms = (jt.FixedTemperature(320.0, on=BACK), jt.HeatFlux(1000.0, on=FRONT))
    solution = jt.steady(jt.Scene((panel(),), terms, dtype="float64"))
    temperature = np.asarray(solution.surface_temperature[0])
    face = np.asarray(panel().structure.grid.fragment_face)
    assert_allclose(temperature[face == 1], 320.0, atol=1e-9)
    drop = 1000.0 * THICKNESS / 200.0
    assert_allclose(temperature[face == 0], 320.0 + drop, atol=1e-9)


@pytest.mark.parametrize(
    "term",
    [
        jt.Wind((3.0, 0.0, 0.0), 280.0),
        pytest.param(jt.FreeConvection(280.0), marks=pytest.mark.slow),
    ],
)
def test_air_moves_along_a_sheet_as_along_a_plate_of_voxels(term):
    thickness = 0.002
    material = jt.Material(200.0, density=2700.0, specific_heat=900.0)
    step = 1e-3
    rates = []
    grid = jt.voxelize(jt.shapes.box((SIZE, SIZE, thickness)), 0.002)
    for body in (
        panel(layers=(jt.Layer(material, thickness),)),
        body_at(grid, material, START),
    ):
        scene = jt.Scene((body,), (term,), dtype="float64")
        solution = jt.simulate(scene, step, solver=jt.ForwardEuler(dt=step))
        rates.append(float(solution.energy.mechanisms[term.name][0]) / step)
    # The rim of the voxels has 4 % of the area.
    assert rates[0] == pytest.approx(rates[1], rel=0.05)


@pytest.mark.parametrize("is_sheet", [True, False])
def test_contact_of_a_sheet_lets_heat_into_what_it_lies_on(is_sheet):
    conductance = 500.0
    if is_sheet:
        below = panel(height=0.0, temperature=280.0)
        capacity = 2700.0 * 900.0 * THICKNESS
        above = panel(height=0.0)
    else:
        grid = jt.voxelize(jt.shapes.box((SIZE, SIZE, 0.02)), 0.01)
        below = body_at(grid, METAL, 280.0, at=(0.0, 0.0, -0.01))
        capacity = 2700.0 * 900.0 * 0.02
        above = panel()
    scene = jt.Scene((above, below), (jt.Contact(conductance),), dtype="float64")
    step = 1e-3
    solution = jt.simulate(scene, step, solver=jt.ForwardEuler(dt=step))
    change = np.asarray(solution.mean_temperature[0]) - [START, 280.0]
    heat = conductance * AREA * 20.0 * step
    assert change[0] == pytest.approx(
        -heat / (2700.0 * 900.0 * THICKNESS * AREA), rel=0.05
    )
    assert change[1] == pytest.approx(heat / (capacity * AREA), rel=0.05)
    stored = np.array([2700.0 * 900.0 * THICKNESS, capacity]) @ change
    assert stored == pytest.approx(0.0, abs=1e-9 * heat / AREA)


WALL = (
    jt.Layer(METAL, THICKNESS),
    jt.Layer(jt.Material(0.04, density=30.0, specific_heat=1400.0), 0.02),
)
EVERYTHING = (
    jt.Sun((0.5, 0.1, -0.8), 800.0),
    jt.DiffuseSky(100.0, reflected=30.0),
    jt.RadiativeExchange(285.0, ground=295.0),
    jt.Wind((3.0, 0.5, 0.0), 290.0),
    jt.HeatSource(heat_rate=1.0),
    jt.Contact(500.0),
)


def bodies_of(company):
    """A wall alone, on a block, or under another sheet."""
    wall = panel(layers=WALL)
    if company == "alone":
        return (wall,)
    if company == "solid":
        grid = jt.voxelize(jt.shapes.box((0.06, 0.06, 0.02)), 0.01)
        return (wall, body_at(grid, METAL, 310.0, at=(0.0, 0.0, 0.01)))
    return (wall, panel(height=0.03, temperature=310.0))


SOLVERS = {
    "euler": jt.ForwardEuler(),
    "stages": jt.SuperTimeStepping(),
    "backward": jt.BackwardEuler(0.5),
    "trapezoidal": jt.CrankNicolson(2.0),
    "tr-bdf2": jt.TRBDF2(2.0),
    "adaptive": jt.TRBDF2(),
    "default": None,
}


@pytest.fixture(scope="module")
def precise():
    """Surface temperatures by company, from short steps of second order."""

    def run(company, solver):
        scene = jt.Scene(bodies_of(company), EVERYTHING, dtype="float64")
        solution = jt.simulate(scene, 60.0, save_at=[20.0, 60.0], solver=solver)
        assert np.abs(np.asarray(solution.energy.residual_relative)).max() < 1e-9
        return np.asarray(solution.surface_temperature)

    stored = {}

    def deviation(company, solver):
        if company not in stored:
            stored[company] = run(company, jt.TRBDF2(0.25))
        return np.abs(run(company, solver) - stored[company]).max()

    return deviation


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("company", ["alone", "solid", "sheet"])
def test_solvers_agree_on_all_mechanisms_at_once(precise, company, solver):
    assert precise(company, SOLVERS[solver]) < 0.1
