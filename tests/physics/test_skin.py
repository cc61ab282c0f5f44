"""Skin: loads that have gone less than a voxel deep, and the steps of its columns."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import solve_banded

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.config.loader import load_config
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.reference.semi_infinite import surface_flux
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import bar, single_body_scene


HOT_END = jt.Side((-1.0, 0.0, 0.0))
GROUND = jt.Material(1.0, density=2000.0, specific_heat=1000.0, emissivity=1.0)
CONCRETE = jt.Material(1.4, density=2300.0, specific_heat=880.0)
HOUR = 3600.0
SUN = jt.Table(
    np.array([0.0, 6.0, 9.0, 12.0, 15.0, 18.0, 24.0]) * HOUR,
    [0.0, 0.0, 424.0, 600.0, 424.0, 0.0, 0.0],
)


def at_end(grid, solution):
    """Temperatures of the end at -x, at all saved times after the start [K]."""
    end = np.argmin(grid.fragment_normal[:, 0])
    return np.asarray(solution.surface_temperature)[-len(solution.times) :, end]


def half_space(material, thickness, load, times, dt):
    """Temperatures of a half space's surface, by backward Euler on fine cells [K].

    `load` is the flux at a temperature and time, and its slope.
    """
    heat = material.density * material.specific_heat
    k = material.conductivity
    capacity = heat * thickness
    between = dt * k / ((thickness[1:] + thickness[:-1]) / 2)
    half = k / (thickness[0] / 2)
    theta = np.zeros(len(thickness))
    values = []
    for step in range(1, round(times[-1] / dt) + 1):
        band = np.zeros((3, len(theta)))
        band[0, 1:] = band[2, :-1] = -between
        band[1] = capacity
        band[1, :-1] += between
        band[1, 1:] += between
        new = theta
        surface = theta[0]
        for _ in range(4):
            node = new[0]
            _, slope = load(surface, step * dt)
            for _ in range(8):
                flux, slope = load(surface, step * dt)
                surface -= (flux - half * (surface - node)) / (slope - half)
            conductance = -slope * half / (half - slope)
            heat_rate = half * (surface - node)
            matrix = band.copy()
            matrix[1, 0] += dt * conductance
            right = capacity * theta
            right[0] += dt * (heat_rate + conductance * node)
            new = solve_banded((1, 1), matrix, right)
        theta = new
        values.append(surface)
    return np.array(values)[np.round(np.asarray(times) / dt).astype(int) - 1]


RADIATION_TIMES = (1.0, 2.0, 5.0, 10.0, 20.0, 60.0)


def radiation_rise():
    def load(theta, _):
        kelvin = theta + 300.0
        flux = STEFAN_BOLTZMANN * (1200.0**4 - kelvin**4)
        return flux, -4 * STEFAN_BOLTZMANN * kelvin**3

    thickness = 5e-5 * 1.03 ** np.arange(200)
    return half_space(GROUND, thickness, load, RADIATION_TIMES, dt=0.02)


@pytest.mark.parametrize(
    ("cells", "limit"),
    [
        (6, 0.07),
        pytest.param(12, 0.02, marks=pytest.mark.slow),
        pytest.param("auto", 0.02, marks=pytest.mark.slow),
    ],
)
def test_half_space_in_a_furnace(cells, limit):
    # 20 mm voxels, of which heat goes 0.7 mm deep in the first second.
    grid = bar(15, 0.02)
    if cells == "auto":
        diffusivity = float(GROUND.diffusivity)
        cells = jt.Skin.cells_for(0.02, diffusivity, RADIATION_TIMES[0])
    skin = jt.Skin(jt.FullVolume(grid), cells=cells, on=HOT_END)
    scene = single_body_scene(
        skin,
        GROUND,
        300.0,
        jt.Surroundings(1200.0, on=HOT_END),
        allow_extreme_temperatures=True,
    )
    solution = jt.simulate(scene, 60.0, save_at=RADIATION_TIMES)
    rise = at_end(grid, solution)[-len(RADIATION_TIMES) :] - 300.0
    assert_allclose(rise, radiation_rise(), rtol=limit)
    assert abs(solution.energy.residual_relative).max() < 1e-11


@pytest.mark.filterwarnings("ignore:body 0 represents 99.81 %")
@pytest.mark.slow
def test_half_space_that_is_turned_against_the_lattice():
    """Columns below a staircase follow its true normals: within 4 % in the mean."""
    normal = np.array([-np.cos(np.pi / 6), -0.5, 0.0])
    axes = np.array([-normal, [-0.5, np.cos(np.pi / 6), 0.0], [0.0, 0.0, 1.0]])
    box = jt.shapes.box((0.3, 0.2, 0.2))
    grid = jt.voxelize(Mesh(box.vertices @ axes, box.faces), 0.02)
    hot = jt.Side(tuple(normal))
    scene = single_body_scene(
        jt.Skin(jt.FullVolume(grid), cells=12, on=hot),
        GROUND,
        300.0,
        jt.Surroundings(1200.0, on=hot),
        allow_extreme_temperatures=True,
    )
    solution = jt.simulate(scene, 60.0, save_at=RADIATION_TIMES)
    along = grid.fragment_position @ normal
    aside = np.linalg.norm(grid.fragment_position - np.outer(along, normal), axis=1)
    middle = (grid.fragment_normal @ normal > 0.99) & (aside < 0.06)
    rises = np.asarray(solution.surface_temperature)[:, middle] - 300.0
    mean = np.average(rises, axis=1, weights=grid.fragment_area[middle])
    assert_allclose(mean[-len(RADIATION_TIMES) :], radiation_rise(), rtol=0.05)
    assert abs(solution.energy.residual_relative).max() < 1e-11


def roof_scene(dtype: Dtype = "float64", material: Any = CONCRETE, kind=jt.Skin):
    on = HOT_END
    skin = kind(jt.FullVolume(bar(6, 0.5)), cells=6, on=on)
    return single_body_scene(
        skin,
        material,
        295.0,
        jt.HeatFlux(SUN, on=on),
        jt.Convection(12.0, 295.0, on=on),
        dtype=dtype,
    )


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_day_on_a_roof_of_half_metre_voxels(dtype):
    times = np.arange(1, 25) * HOUR

    def load(theta, time):
        flux = np.interp(time, SUN.times, SUN.values) - 12.0 * theta
        return flux, -12.0

    fine = half_space(CONCRETE, np.full(150, 0.02), load, times, dt=60.0)
    scene = roof_scene(dtype=dtype)
    solution = jt.simulate(scene, 24 * HOUR, save_at=tuple(times))
    roof = at_end(scene.bodies[0].structure.grid, solution)[-24:] - 295.0
    assert np.abs(roof - fine).max() < 0.5
    assert roof.argmax() == 12
    assert roof.max() + 295.0 - 273.15 == pytest.approx(47.4, abs=0.5)
    limit = {"float32": 1e-5, "float64": 1e-11}[dtype]
    assert abs(solution.energy.residual_relative).max() < limit


@pytest.mark.slow
def test_flux_against_the_closed_form():
    grid = bar(40, 0.02)
    skin = jt.Skin(jt.FullVolume(grid), cells=12, on=HOT_END)
    scene = single_body_scene(skin, GROUND, 300.0, jt.HeatFlux(1e3, on=HOT_END))
    times = np.array([1.0, 10.0, 100.0])
    solution = jt.simulate(scene, 100.0, save_at=tuple(times))
    exact = surface_flux(
        0.0,
        times,
        initial=300.0,
        heat_flux=1e3,
        conductivity=1.0,
        diffusivity=GROUND.diffusivity,
    )
    assert_allclose(at_end(grid, solution)[-3:] - 300.0, exact - 300.0, rtol=0.02)


class LinkedSkin(jt.Skin):
    """A skin whose cells are linked like all other nodes."""

    def columns(self):
        return None


def smooth_scene(kind=jt.Skin):
    skin = kind(jt.FullVolume(bar(4, 0.5)), cells=6, on=HOT_END)
    flux = jt.HeatFlux(
        lambda t: 300 * (1 - jnp.cos(jnp.pi * t / (12 * HOUR))) ** 2, on=HOT_END
    )
    air = jt.Convection(12.0, 295.0, on=HOT_END)
    return single_body_scene(skin, CONCRETE, 295.0, flux, air)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solver", "steps", "order"),
    [
        (lambda dt: jt.ForwardEuler(dt=dt), (50, 100, 200), 1),
        (lambda dt: jt.SuperTimeStepping(dt=dt, stages=5), (24, 48, 96), 2),
    ],
    ids=["Euler", "stages"],
)
def test_steps_converge_to_those_of_all_links(solver, steps, order):
    end = 12 * HOUR
    times = tuple(np.arange(1, 9) * 1.5 * HOUR)
    grid = bar(4, 0.5)

    def surface(scene, dt, solver):
        return at_end(grid, jt.simulate(scene, end, save_at=times, solver=solver(dt)))

    exact = surface(smooth_scene(LinkedSkin), end / 1600, lambda dt: jt.TRBDF2(dt=dt))
    errors = [
        np.abs(surface(smooth_scene(), end / count, solver) - exact).max()
        for count in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > order - 0.2).all()


def test_columns_do_not_shorten_the_step():
    stable = []
    for cells in (1, 6):
        skin = jt.Skin(jt.FullVolume(bar(4, 0.5)), cells=cells, on=HOT_END)
        scene = single_body_scene(skin, CONCRETE, 295.0)
        stable.append(float(compile_scene(scene, 1, HOUR).stable_step))
    assert stable[1] == pytest.approx(stable[0], rel=1e-9)


def test_columns_spread_loads_on_their_cells():
    """Heat of 500 s goes as deep as the columns: the outermost cell would allow 8 s."""
    rubber = jt.Material(0.24, density=1200.0, specific_heat=1400.0)
    skin = jt.Skin(jt.FullVolume(bar(4, 0.04)), cells=12, on=HOT_END)
    air = jt.Convection(15.0, 295.0, on=HOT_END)
    scene = single_body_scene(skin, rubber, 295.0, air)
    compiled = compile_scene(scene, 1, HOUR)
    assert float(compiled.stable_step) > 500.0
    outermost = np.asarray(compiled.program.bodies[0].network.capacity())[0]
    assert outermost / (15.0 * 0.04**2) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "solver", [jt.ForwardEuler(dt=100.0), jt.SuperTimeStepping(dt=HOUR, stages=9)]
)
def test_derivatives_against_differences(solver):
    def warmth(numbers):
        k, coefficient = numbers
        material = jt.Material(1.4 * k, density=2300.0, specific_heat=880.0)
        scene = roof_scene(material=material)
        terms = (scene.terms[0], jt.Convection(coefficient, 295.0, on=HOT_END))
        solution = jt.simulate(replace(scene, terms=terms), 6 * HOUR, solver=solver)
        return solution.surface_temperature[-1].sum()

    at = jnp.array([1.0, 12.0])
    gradient = jax.grad(warmth)(at)
    for axis in range(2):
        step = jnp.zeros(2).at[axis].set(1e-4)
        difference = (warmth(at + step) - warmth(at - step)) / 2e-4
        assert float(gradient[axis]) == pytest.approx(float(difference), rel=1e-6)


@pytest.mark.slow
def test_varying_properties_agree_with_all_links():
    varying = jt.Material(
        jt.Property([280.0, 340.0], [1.0, 3.0]),
        density=2300.0,
        specific_heat=jt.Property([280.0, 340.0], [700.0, 1200.0]),
    )
    layered = jt.MaterialMap(
        varying, ((jt.Region((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0)), CONCRETE),)
    )
    for material in (varying, layered):
        ends = []
        for kind, dt in ((jt.Skin, 450.0), (LinkedSkin, 100.0)):
            scene = roof_scene(material=material, kind=kind)
            solution = jt.simulate(scene, 12 * HOUR, solver=jt.SuperTimeStepping(dt=dt))
            ends.append(at_end(bar(6, 0.5), solution)[-1])
        assert ends[0] == pytest.approx(ends[1], abs=0.02)


@pytest.mark.slow
def test_probes_follow_the_temperature_by_depth():
    # Steady: a linear fall from the hot end.
    grid = bar(6, 0.5)
    skin = jt.Skin(jt.FullVolume(grid), cells=6, on=HOT_END)
    hot = jt.HeatFlux(20.0 * 1.4, on=HOT_END)
    cold = jt.FixedTemperature(290.0, on=jt.Side((1.0, 0.0, 0.0)))
    depths = np.array([0.0, 0.003, 0.02, 0.1, 0.24, 0.26, 0.4, 0.6, 1.5])
    probes = tuple((-1.5 + depth, 0.0, 0.0) for depth in depths)
    scene = single_body_scene(skin, CONCRETE, 320.0, hot, cold, probes=probes)
    solution = jt.steady(scene)
    read = np.asarray(jt.probe(solution)).reshape(-1)
    assert_allclose(read, 350.0 - 20.0 * depths, atol=1e-6)


@pytest.mark.slow
def test_heat_source_heats_all_cells_alike():
    grid = bar(3, 0.5)
    skin = jt.Skin(jt.FullVolume(grid), cells=6)
    scene = single_body_scene(
        skin, CONCRETE, 295.0, jt.HeatSource(heat_rate_density=1e4)
    )
    solution = jt.simulate(scene, HOUR)
    rise = 1e4 * HOUR / (2300.0 * 880.0)
    assert_allclose(solution.surface_temperature[-1], 295.0 + rise, rtol=1e-9)


@pytest.mark.slow
def test_implicit_steps_and_steady_states_agree_with_all_links():
    for solve in (
        lambda scene: jt.simulate(scene, 12 * HOUR, solver=jt.TRBDF2(dt=HOUR)),
        lambda scene: jt.steady(scene, at=12 * HOUR),
    ):
        ends = []
        for kind in (jt.Skin, LinkedSkin):
            solution = solve(roof_scene(kind=kind))
            ends.append(np.atleast_2d(solution.surface_temperature)[-1])
        assert_allclose(ends[0], ends[1], atol=1e-6)


@pytest.mark.slow
def test_the_roof_of_a_file():
    config = load_config("tests/data/mesh_and_heat/roof_skin.yaml")
    scene = config.build()
    times = config.time.save_times
    solution = jt.simulate(scene, config.time.last, save_at=times)
    front = scene.bodies[0].structure.grid.fragment_normal[:, 0] > 0.9
    celsius = np.asarray(solution.surface_temperature)[-24:, front] - 273.15
    assert celsius.max() == pytest.approx(47.4, abs=0.5)
    assert celsius.mean(axis=1).argmax() == 12
