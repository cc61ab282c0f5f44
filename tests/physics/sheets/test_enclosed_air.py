"""A volume of air inside a closed sheet, against the solution of two nodes."""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxthermo as jt
from calibrate.problem.parameters import find_path, value_at
from jaxthermo.arrays import precision
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import (
    begin_run,
    compile_segments,
    finish_run,
    run_segments,
)
from jaxthermo.material.material import Property
from tests.radiating import room
from tests.shallow import SHALLOW
from tests.slopes import check_gradient


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)
BOX = jt.shapes.box((1.0, 0.6, 0.5))
SHEET = jt.Sheet(BOX, (jt.Layer(STEEL, 1e-3),), 0.25)
TIMES = (0.0, 60.0, 300.0)
WALL = 300.0
AIR = 320.0
HOUR = 3600.0
RISING = Property([300.0, 400.0], [0.2, 0.6])


def scene_of(
    outer=20.0,
    inner=5.0,
    exchange=2.0 / HOUR,
    outside=270.0,
    volume=0.3,
    dtype: Dtype = "float64",
):
    wall = jt.Body(SHEET, temperature=WALL)
    air = jt.Body(jt.AirVolume(volume), temperature=AIR)
    terms = (
        jt.Convection(outer, 280.0),
        jt.EnclosedAir(inner, exchange, outside, body=0, air=1),
    )
    return jt.Scene((wall, air), terms, dtype=dtype)


def two_nodes(outer=20.0, inner=5.0, exchange=2.0 / HOUR, outside=270.0, volume=0.3):
    """Matrix and constant of the rates of both temperatures."""
    wall = BOX.area * 1e-3 * 7850.0 * 480.0
    air = 101_325.0 / (287.05 * AIR) * volume * 1006.0
    conductance = inner * BOX.area
    rates = [
        [-(outer + inner) * BOX.area / wall, conductance / wall],
        [conductance / air, -conductance / air - exchange],
    ]
    return np.array(rates), np.array(
        [outer * BOX.area * 280.0 / wall, exchange * outside]
    )


def exact():
    matrix, constant = two_nodes()
    final = np.linalg.solve(matrix, -constant)
    start = np.array([WALL, AIR])
    return np.stack(
        [final + scipy.linalg.expm(matrix * time) @ (start - final) for time in TIMES]
    )


@pytest.mark.parametrize(
    "solver",
    [
        jt.ForwardEuler(0.1),
        pytest.param(jt.SuperTimeStepping(), marks=pytest.mark.slow),
        jt.TRBDF2(),
    ],
)
def test_wall_and_air_are_a_system_of_two_nodes(solver):
    solution = jt.simulate(scene_of(), TIMES[-1], save_at=TIMES, solver=solver)
    np.testing.assert_allclose(solution.mean_temperature, exact(), atol=0.02)
    assert np.abs(solution.energy.residual_relative).max() < 1e-11


def test_time_constants_are_those_of_two_nodes():
    """Box with air: 1 m x 0.6 m x 0.5 m, 1 mm of steel, cells of 25 cm."""
    matrix, constant = two_nodes()
    final = np.linalg.solve(matrix, -constant)
    rates, modes = np.linalg.eig(matrix)
    times = [0.0, 60.0, 120.0, 600.0, 900.0]
    solution = jt.simulate(scene_of(), times[-1], save_at=times)
    above = np.asarray(solution.mean_temperature) - final
    amplitudes = np.abs(np.linalg.solve(modes, above.T))
    fast, slow = np.argsort(rates)
    measured = np.log(amplitudes[slow, 0] / amplitudes[slow, -1]) / times[-1]
    assert measured == pytest.approx(-rates[slow], rel=0.01)
    measured = np.log(amplitudes[fast, 0] / amplitudes[fast, 1]) / times[1]
    assert measured == pytest.approx(-rates[fast], rel=0.01)


@pytest.mark.slow
def test_warm_air_that_enters_leaves_by_the_transmittance_of_the_walls():
    """n C (T_in - T_air) = U A (T_air - T_out) with 1 / U = 1/h_i + sum d/k + 1/h_o."""
    foam = jt.Material(0.04, 30.0, specific_heat=1400.0)
    layers = (jt.Layer(STEEL, 1e-3), jt.Layer(foam, 0.05))
    wall = jt.Body(jt.Sheet(BOX, layers, 0.25), temperature=WALL)
    air = jt.Body(jt.AirVolume(0.3), temperature=AIR)
    inside = jt.EnclosedAir(5.0, 10.0 / HOUR, 340.0, body=0, air=1)
    terms = (jt.Convection(20.0, 280.0), inside)
    scene = jt.Scene((wall, air), terms, dtype="float64")
    solution = jt.steady(scene)
    resistance = 1 / 5.0 + 1e-3 / 45.0 + 0.05 / 0.04 + 1 / 20.0
    lost = BOX.area / resistance
    entering = 10.0 / HOUR * 101_325.0 / (287.05 * AIR) * 0.3 * 1006.0
    expected = (entering * 340.0 + lost * 280.0) / (entering + lost)
    assert float(solution.mean_temperature[-1, 1]) == pytest.approx(expected, abs=1e-6)
    # The cells through the foam are eliminated in explicit steps.
    run = jt.simulate(scene, 600.0, solver=jt.ForwardEuler())
    assert np.abs(run.energy.residual_relative).max() < 1e-11


def test_energy_closes_in_single_precision():
    solution = jt.simulate(scene_of(dtype="float32"), TIMES[-1], save_at=TIMES)
    assert np.abs(solution.energy.residual_relative).max() < 1e-5


def test_the_steady_state_balances_walls_and_exchange():
    matrix, constant = two_nodes()
    solution = jt.steady(scene_of())
    expected = np.linalg.solve(matrix, -constant)
    np.testing.assert_allclose(solution.mean_temperature[-1], expected, atol=1e-3)


def test_air_and_walls_alone_keep_their_heat():
    wall = jt.Body(SHEET, temperature=WALL)
    air = jt.Body(jt.AirVolume(0.3), temperature=AIR)
    inside = jt.EnclosedAir(5.0, body=0, air=1)
    scene = jt.Scene((wall, air), (inside,), dtype="float64")
    capacity = [BOX.area * 1e-3 * 7850.0 * 480.0, 101_325.0 / (287.05 * AIR) * 301.8]
    mean = np.average([WALL, AIR], weights=capacity)
    steady = jt.steady(scene)
    np.testing.assert_allclose(steady.mean_temperature[-1], mean, atol=1e-3)


@pytest.mark.slow
def test_radiation_and_air_share_the_balance_of_a_surface():
    # A wall of foam: its surface is far from its node, and has one temperature.
    foam = jt.Material(0.03, 40.0, specific_heat=1400.0, emissivity=0.9)
    sheet = jt.Sheet(BOX, (jt.Layer(foam, 0.02),), 0.25, cells=1)
    block = jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1))
    bodies = (
        jt.Body(sheet, temperature=300.0),
        jt.Body(block, STEEL, temperature=330.0),
    )
    volume = jt.Body(jt.AirVolume(0.3), temperature=310.0)
    exchange = jt.RadiativeExchange(280.0, max_patches=24, directions=32)

    def steady(air, bodies):
        held = jt.FixedTemperature(350.0, on=jt.Everything(1))
        terms = (jt.Convection(20.0, 280.0), exchange, held, air)
        return jt.steady(jt.Scene(bodies, terms, dtype="float64"))

    enclosed = jt.EnclosedAir(5.0, 3.0 / HOUR, 280.0, body=0, air=2)
    solution = steady(enclosed, (*bodies, volume))
    temperature = float(solution.mean_temperature[-1, 2])
    # Air that is held at that temperature leaves the walls as they are.
    fixed = steady(jt.InteriorAir(5.0, temperature, body=0), bodies)
    np.testing.assert_allclose(
        solution.mean_temperature[-1, 0], fixed.mean_temperature[-1, 0], atol=1e-3
    )
    assert 285.0 < temperature < 345.0


@pytest.mark.parametrize(
    "solver",
    [
        jt.ForwardEuler(2.0),
        pytest.param(jt.BackwardEuler(10.0), marks=pytest.mark.slow),
    ],
)
def test_derivatives_are_those_of_finite_differences(solver):
    def final(numbers):
        inner, exchange, outside, volume = numbers
        scene = scene_of(
            inner=inner, exchange=exchange / HOUR, outside=outside, volume=volume
        )
        return jt.simulate(scene, 60.0, solver=solver).mean_temperature[-1].sum()

    numbers = jnp.array([5.0, 2.0, 270.0, 0.3])
    gradient = np.asarray(jax.grad(final)(numbers))
    for index, number in enumerate(numbers):
        step = 1e-4 * float(number)
        ahead = final(numbers.at[index].add(step))
        behind = final(numbers.at[index].add(-step))
        assert gradient[index] == pytest.approx(
            float(ahead - behind) / (2 * step), rel=1e-6
        )


def room_scene(air_term, conductivity=RISING, with_air=True):
    """A room of cells of 20 mm whose walls conduct by k(T), in the sun."""
    material = jt.Material(conductivity, 2000.0, specific_heat=500.0)
    grid = jt.voxelize(room(0.06, 0.1), 0.02)
    bodies = [jt.Body(jt.FullVolume(grid), material, temperature=310.0)]
    if with_air:
        bodies.append(jt.Body(jt.AirVolume(2.16e-4), temperature=330.0))
    sun = jt.Sun((0.0, 0.0, -1.0), 900.0)
    terms = (sun, jt.Convection(20.0, 280.0), air_term)
    return jt.Scene(tuple(bodies), terms, dtype="float64")


@SHALLOW
@pytest.mark.slow
def test_walls_whose_conductivity_varies():
    enclosed = jt.EnclosedAir(40.0, 0.5, 360.0, body=0, air=1)
    scene = room_scene(enclosed)
    steady = jt.steady(scene)
    # Air that is held at that temperature leaves the walls as they are.
    kelvin = float(steady.mean_temperature[-1, 1])
    fixed = jt.steady(room_scene(jt.InteriorAir(40.0, kelvin), with_air=False))
    np.testing.assert_allclose(
        steady.surface_temperature, fixed.surface_temperature, atol=1e-6
    )
    implicit = jt.simulate(scene, 100.0, solver=jt.BackwardEuler(0.5))
    explicit = jt.simulate(scene, 100.0, solver=jt.ForwardEuler(0.2))
    np.testing.assert_allclose(
        implicit.mean_temperature, explicit.mean_temperature, atol=0.1
    )
    # Newton's method with the true Jacobian converges quadratically.
    effort = implicit.run.statistics
    assert effort is not None
    assert int(effort.newton_iterations) <= 3 * implicit.run.steps


@SHALLOW
@pytest.mark.slow
def test_derivatives_through_walls_whose_conductivity_varies():
    def end(numbers):
        inner, exchange, first = numbers
        k = Property([300.0, 400.0], jnp.stack([first, 3.0 * first]))
        scene = room_scene(jt.EnclosedAir(inner, exchange, 360.0, body=0, air=1), k)
        solver = jt.BackwardEuler(20.0)
        return jt.simulate(scene, 60.0, solver=solver).mean_temperature[-1].sum()

    check_gradient(end, [40.0, 0.5, 0.2], [4e-3, 5e-5, 2e-5], rtol=1e-6)


CUBE = jt.FullVolume(jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1))


def cabin(inner=5.0, motion=None, dtype: Dtype = "float64"):
    """A block with a heat source, on another one, in a box with air, in the sun."""
    pose = motion or jt.Pose()
    sheet = jt.Sheet(BOX, (jt.Layer(STEEL, 1e-3),), 0.1)
    wall = jt.Body(sheet, temperature=WALL, pose=pose)
    blocks = [
        jt.Body(CUBE, STEEL, temperature=310.0, pose=jt.Pose((0.0, 0.0, height)))
        for height in (0.1, -0.1)
    ]
    air = jt.Body(jt.AirVolume(0.3), temperature=AIR)
    terms = (
        jt.Sun((0.0, 0.3, -1.0), 800.0),
        jt.Convection(20.0, 280.0),
        jt.HeatSource(heat_rate=50.0, within=jt.Everything(body=1)),
        jt.Contact(100.0, bodies=(1, 2)),
        jt.EnclosedAir(inner, 2.0 / HOUR, 270.0, body=0, air=3),
    )
    probes = {
        "air": (0.25, 0.0, 0.0),
        "block": (0.0, 0.0, 0.1),
        "near a wall": (0.48, 0.1, 0.1),
        "wall": (0.5, 0.1, 0.1),
    }
    return jt.Scene((wall, *blocks, air), terms, dtype=dtype, probes=probes)


def test_bodies_inside_exchange_heat_with_the_air():
    solution = jt.simulate(cabin(), 600.0, save_at=(0.0, 600.0))
    assert np.abs(solution.energy.residual_relative).max() < 1e-11
    areas = {
        part.bodies: part.area
        for part in solution.receipt.parts
        if part.mechanism == "interior_air"
    }
    assert areas[0,] == pytest.approx(BOX.area, rel=1e-6)
    # All but the faces in contact.
    assert areas[1,] == areas[2,] == pytest.approx(0.2, rel=1e-6)
    # What the walls and the blocks lose to it, the air gains.
    by_body = [body.mechanisms["interior_air"] for body in solution.energy.bodies]
    entering = solution.energy.mechanisms["interior_air"]
    np.testing.assert_allclose(sum(by_body), entering, rtol=1e-9)
    assert solution.probe_temperature is not None
    read = np.asarray(solution.probe_temperature)
    for column in (0, 2):
        np.testing.assert_allclose(
            read[:, column], solution.mean_temperature[:, 3], rtol=1e-12
        )
    assert read[-1, 1] > read[-1, 0] > read[-1, 3] + 1.0


@pytest.mark.slow
@pytest.mark.parametrize("solver", [jt.SuperTimeStepping(), jt.TRBDF2()])
def test_every_box_has_its_own_air(solver):
    """Two boxes beside many blocks, which explicit steps conduct as one network."""
    blocks = [
        jt.Body(CUBE, STEEL, temperature=300.0, pose=jt.Pose((0.0, 1.0 * n, 2.0)))
        for n in range(4)
    ]
    far = jt.Pose((5.0, 0.0, 0.0))
    boxes = [
        jt.Body(SHEET, temperature=WALL),
        jt.Body(SHEET, temperature=WALL, pose=far),
    ]
    airs = [jt.Body(jt.AirVolume(0.3), temperature=kelvin) for kelvin in (AIR, WALL)]
    terms = (
        jt.Convection(20.0, 280.0),
        jt.EnclosedAir(5.0, 2.0 / HOUR, 270.0, body=5, air=6),
        jt.EnclosedAir(5.0, 2.0 / HOUR, 270.0, body=2, air=7),
    )
    bodies = (*blocks[:2], boxes[1], *blocks[2:], boxes[0], *airs)
    scene = jt.Scene(bodies, terms, dtype="float64")
    solution = jt.simulate(scene, TIMES[-1], save_at=TIMES, solver=solver)
    mean = np.asarray(solution.mean_temperature)
    np.testing.assert_allclose(mean[:, [5, 6]], exact(), atol=0.02)
    assert np.abs(mean[-1, 7] - mean[-1, 6]) > 0.1
    assert np.abs(solution.energy.residual_relative).max() < 1e-11


@pytest.mark.slow
def test_a_compiled_run_serves_other_numbers_batches_and_copies():
    steps = jt.ForwardEuler(1.0)
    run = jt.compile_simulation(cabin(), 60.0, [60.0], solver=steps)

    def end(scene):
        return jt.simulate(scene, 60.0, [60.0], solver=steps).mean_temperature

    changed = run(cabin(8.0))
    assert changed.receipt.searches == ()
    np.testing.assert_array_equal(changed.mean_temperature, end(cabin(8.0)))
    copy = pickle.loads(pickle.dumps(cabin()))
    np.testing.assert_array_equal(end(copy), run().mean_temperature)
    rows = jax.vmap(lambda inner: run(cabin(inner)).mean_temperature)(
        jnp.array([5.0, 8.0])
    )
    np.testing.assert_allclose(rows[1], end(cabin(8.0)), rtol=1e-12)


@pytest.mark.slow
def test_a_run_goes_on_from_a_checkpoint(tmp_path):
    plan = plan_run(cabin(), t1=60.0, save_at=(30.0, 60.0), solver=jt.ForwardEuler(1.0))
    with precision("float64"):
        fresh = begin_run(plan)
        first = next(run_segments(plan, compile_segments(plan, fresh), 0.0))
        path = tmp_path / "checkpoint.npz"
        save_checkpoint(path, plan=plan, progress=first, key="air")
        resumed = load_checkpoint(path, plan=plan, fresh=fresh, key="air")
        assert resumed is not None
        *_, last = run_segments(plan, compile_segments(plan, resumed))
        solution = finish_run(plan, last)
    whole = jt.simulate(cabin(), 60.0, (30.0, 60.0), solver=jt.ForwardEuler(1.0))
    np.testing.assert_array_equal(solution.mean_temperature, whole.mean_temperature)


@pytest.mark.slow
def test_pictures_files_and_motion_show_the_bodies_that_have_a_surface(tmp_path):
    poses = [jt.Pose((0.0, 0.0, height)) for height in (0.0, 0.02)]
    motion = jt.Motion(jt.PoseTable([0.0, 60.0], poses), every=30.0)
    solution = jt.simulate(cabin(motion=motion), 60.0, save_at=[60.0])
    assert np.abs(solution.energy.residual_relative).max() < 1e-11
    assert len(solution.surfaces) == 3
    assert solution.of_body(3).shape == (1, 0)
    camera = jt.Camera((4.0, 3.0, 2.0), look_at=(0.0, 0.0, 0.0), width=40, height=30)
    image = jt.render(solution, camera)
    assert set(np.unique(image.object_id)) == {-1, 0}
    jt.write_vtu(tmp_path / "air.vtu", solution)
    jt.write_glb(tmp_path / "air.glb", solution)


def test_its_numbers_can_be_fitted():
    scene = cabin()
    for name in ("exchange", "heat_transfer_coefficient", "temperature"):
        number = value_at(scene, find_path(scene, f"interior_air.{name}"))
        assert number == getattr(scene.terms[-1], name)
    volume = value_at(scene, find_path(scene, "bodies.3.structure.air_volume"))
    assert volume == 0.3


def test_the_receipt_and_the_ledger_have_the_air():
    solution = jt.simulate(scene_of(), 60.0)
    receipt = solution.receipt
    parts = [(part.mechanism, part.bodies) for part in receipt.parts]
    assert ("interior_air", (0,)) in parts and ("interior_air", (1,)) in parts
    assert "AirVolume, 1 node" in receipt.structures
    assert not any("body" in omission.what for omission in receipt.left_out)


def scene_with(*terms, bodies=None):
    walls = jt.Body(SHEET, temperature=WALL)
    air = jt.Body(jt.AirVolume(0.3), temperature=AIR)
    return jt.compile_scene(jt.Scene(bodies or (walls, air), terms))


INSIDE = jt.EnclosedAir(5.0, body=0, air=1)
OPEN_BOX = jt.Mesh(BOX.vertices, BOX.faces[:-1])


def opened():
    sheet = jt.Sheet(OPEN_BOX, (jt.Layer(STEEL, 1e-3),), 0.25)
    air = jt.Body(jt.AirVolume(0.3), temperature=AIR)
    return scene_with(INSIDE, bodies=(jt.Body(sheet, temperature=WALL), air))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: jt.AirVolume(0.0), "above 0"),
        (lambda: jt.EnclosedAir(5.0, 1e-3, body=0, air=1), "temperature"),
        (lambda: jt.EnclosedAir(5.0, -1e-3, 280.0, body=0, air=1), "exchange"),
        (lambda: jt.Body(jt.AirVolume(1.0), STEEL, temperature=290.0), "no material"),
        (
            lambda: scene_with(INSIDE, bodies=(jt.Body(SHEET, temperature=WALL),) * 2),
            "body 1 is no AirVolume",
        ),
        (opened, "encloses no air; its mesh has a border"),
        (scene_with, "no term joins it to walls"),
        (
            lambda: scene_with(INSIDE, jt.InteriorAir(5.0, 300.0)),
            "has the air of terms.0. already",
        ),
        (
            lambda: scene_with(
                jt.EnclosedAir(5.0, body=1, air=0),
                bodies=(
                    jt.Body(jt.AirVolume(0.3), temperature=AIR),
                    jt.Body(SHEET, temperature=WALL),
                ),
            ),
            "come after all others",
        ),
        (
            lambda: scene_with(
                INSIDE, jt.HeatSource(heat_rate=1.0, within=jt.Everything(body=1))
            ),
            "body 1 is air",
        ),
        (lambda: jt.reduce(scene_of(), 60.0, [60.0]), "reduce: .* enclosed air"),
    ],
)
def test_mistakes_have_one_line(make, words):
    with pytest.raises(jt.InputError, match=words) as error:
        make()
    assert "\n" not in str(error.value)
