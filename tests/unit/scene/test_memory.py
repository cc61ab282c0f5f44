"""The forecast of memory against the arrays of compiled runs, and what it refuses."""

import tracemalloc
from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo import host_memory
from jaxthermo.integrate.run.plan import Plan, plan_run
from jaxthermo.integrate.run.simulate import first_loop, take_steps
from jaxthermo.integrate.solvers import AbstractSolver
from jaxthermo.integrate.stepper import jit_in_place
from jaxthermo.memo import found as findings
from jaxthermo.scene.compile import compile as compile_module
from jaxthermo.scene.compile.groups import grouped_numbers
from jaxthermo.scene.compile.memory import forecast_memory


STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.9)
TERMS = (
    jt.Sun((-1, 0, -0.4), 800.0),
    jt.Convection(10.0, 290.0),
    jt.Surroundings(280.0),
)
SOLVERS = {
    "euler": jt.ForwardEuler(),
    "stages": jt.SuperTimeStepping(dt=10.0),
    "implicit": jt.TRBDF2(dt=1000.0),
}
KINDS = {
    "full": jt.FullVolume,
    "octree": jt.Octree,
    "aggregate": lambda grid: jt.Aggregate(grid, factor=2),
    "sheet": lambda grid: jt.Sheet(grid.mesh, (jt.Layer(STEEL, 1e-3),), 2 * grid.pitch),
}


def _scene(structure_name: str, across: int = 50) -> jt.Scene:
    grid = jt.voxelize(jt.shapes.sphere(0.25), 0.5 / across * (1 + 1e-9))
    structure = KINDS[structure_name](grid)
    material = None if isinstance(structure, jt.Sheet) else STEEL
    body = jt.Body(structure, material, temperature=300.0)
    return jt.Scene((body,), TERMS, dtype="float32")


def _planned(scene: jt.Scene, saves: list[float], solver: AbstractSolver) -> Plan:
    """The plan of a run, the only one whose arrays are among the findings."""
    findings.forget_findings()
    return findings.found(
        (scene,), "plan", lambda: plan_run(scene, saves[-1], saves, solver)
    )


def _steps(plan: Plan) -> int:
    """Memory of the states and of the arrays on the way of compiled steps [bytes]."""
    loop = first_loop(plan)
    lowered = jit_in_place(take_steps).lower(loop.arguments, loop.theta)
    report = lowered.compile().compiled.memory_analysis()
    size = sum(theta.nbytes for theta in loop.theta)
    # The state at the start is overwritten: it is the one at the end.
    assert report.alias_size_in_bytes >= size
    temporary = report.temp_size_in_bytes
    return size + temporary + report.output_size_in_bytes - report.alias_size_in_bytes


def _kept() -> dict[int, int]:
    """Size of every array of the findings [bytes], by its address."""
    sizes = {}
    # The collector may drop one at any moment.
    for finding in findings._entries.copy().values():
        for leaf in findings._leaves(finding.value):
            if isinstance(leaf, np.ndarray):
                while isinstance(leaf.base, np.ndarray):
                    leaf = leaf.base
                sizes[leaf.ctypes.data] = leaf.nbytes
            elif isinstance(leaf, jax.Array):
                sizes[leaf.unsafe_buffer_pointer()] = leaf.nbytes
    return sizes


@pytest.mark.parametrize(
    "structure_name, method",
    [
        ("full", "euler"),
        pytest.param("octree", "euler", marks=pytest.mark.slow),
        pytest.param("aggregate", "euler", marks=pytest.mark.slow),
        pytest.param("full", "stages", marks=pytest.mark.slow),
        pytest.param("octree", "stages", marks=pytest.mark.slow),
        ("sheet", "stages"),
        pytest.param("full", "implicit", marks=pytest.mark.slow),
    ],
)
def test_the_forecast_is_that_of_the_arrays(structure_name, method):
    # Multigrid is for steps far longer than the stable one.
    step = 1000.0 if method == "implicit" else 10.0
    scene = _scene(structure_name)
    saves = [step, 2 * step, 3 * step]
    plan = _planned(scene, saves, SOLVERS[method])
    assert plan.stepper.method == method
    measured = sum(_kept().values()) + _steps(plan)
    forecast = forecast_memory(plan.scene, 3, 1, plan.stepper.method)
    assert plan.compiled.receipt.memory_bytes == forecast.peak
    assert forecast.peak - forecast.runtime == pytest.approx(measured, rel=0.1)


@pytest.mark.parametrize("finer", [0.05, 0.0], ids=["unlike", "equal"])
def test_the_forecast_of_bodies_of_one_network_is_that_of_their_arrays(finer):
    bodies = []
    for number in range(6):
        shape = jt.shapes.sphere(0.1) if number % 2 else jt.shapes.box((0.2, 0.1, 0.1))
        grid = jt.voxelize(shape, 0.01 * (1 - finer * number))
        pose = jt.Pose((0.5 * number, 0.0, 0.0))
        bodies.append(jt.Body(jt.FullVolume(grid), STEEL, temperature=300.0, pose=pose))
    scene = jt.Scene(tuple(bodies), TERMS, dtype="float32")
    plan = _planned(scene, [10.0], SOLVERS["euler"])
    (group,) = plan.groups
    assert len(group.numbers) == len(bodies)
    measured = sum(_kept().values()) + _steps(plan)
    forecast = forecast_memory(plan.scene, 1, 1, plan.stepper.method)
    assert forecast.peak - forecast.runtime == pytest.approx(measured, rel=0.15)


def test_bodies_of_one_structure_count_as_those_of_equal_ones():
    grid = jt.voxelize(jt.shapes.box((0.2, 0.1, 0.1)), 0.02)
    structure = jt.FullVolume(grid)
    # A material that varies keeps its body apart from the others.
    varying = jt.Material(
        16.0,
        density=8000.0,
        specific_heat=jt.Property((300.0, 400.0), (460.0, 500.0)),
        emissivity=0.9,
    )
    scenes = []
    for structures in ([structure] * 5, [jt.FullVolume(grid) for _ in range(5)]):
        bodies = [jt.Body(part, STEEL, temperature=300.0) for part in structures]
        bodies[2] = replace(bodies[2], material=varying)
        scenes.append(jt.Scene(tuple(bodies), TERMS))
    shared, apart = (forecast_memory(scene, 1, 1, "euler") for scene in scenes)
    assert shared == apart
    for scene in scenes:
        assert grouped_numbers(scene) == [[0, 1, 3, 4], [2]]
        assert grouped_numbers(scene) is grouped_numbers(scene)


def test_what_bodies_of_the_same_structures_are_made_of_counts():
    """Structures share their parts: materials and motion tell bodies apart."""
    box = jt.shapes.box((0.2, 0.1, 0.1))
    grids = [jt.voxelize(box, pitch) for pitch in (0.02, 0.025)]
    conductivity = jt.Property((300.0, 400.0), (14.0, 18.0))
    varying = jt.Material(conductivity, density=8000.0, specific_heat=500.0)
    moved = jt.PoseTable((0.0, 1.0), (jt.Pose(), jt.Pose((0.1, 0.0, 0.0))))
    changes = (
        {},
        {"material": jt.MaterialMap(varying)},
        {"pose": jt.Motion(moved)},
    )
    structures = [jt.FullVolume(grid) for grid in grids * 2]
    forecasts = []
    for change in changes:
        of_scenes = []
        # The last structures are new ones.
        for parts in (structures, [jt.FullVolume(grid) for grid in grids * 2]):
            bodies = [jt.Body(part, STEEL, temperature=300.0) for part in parts]
            bodies[1] = replace(bodies[1], **change)
            scene = jt.Scene(tuple(bodies), TERMS)
            of_scenes.append(forecast_memory(scene, 1, 2, "euler"))
        shared, new = of_scenes
        assert shared == new
        forecasts.append(new)
    assert len(set(forecasts)) == 3


@pytest.mark.parametrize("moving", [0, 1, 2])
def test_snapshots_keep_what_they_change(moving):
    """Two balls, some of which move, or a sun that does."""
    end = 6.0
    last = (-1.0, 0.1, -0.5)
    course = jt.DirectionTable((0.0, end), ((-1.0, 0.0, -0.4), last), range(1, 6))
    sun = jt.Sun(last if moving else course, 800.0)
    bodies = []
    for number in range(2):
        grid = jt.voxelize(jt.shapes.sphere(0.25), 0.5 / 30)
        pose = jt.Pose((float(number), 0.0, 0.0))
        path = jt.PoseTable((0.0, end), (pose, jt.Pose((float(number), 0.3, 0.1))))
        bodies.append(
            jt.Body(
                jt.FullVolume(grid),
                STEEL,
                temperature=300.0,
                pose=jt.Motion(path, every=1.0) if number < moving else pose,
            )
        )
    scene = jt.Scene(tuple(bodies), (sun, *TERMS[1:]), dtype="float32")
    plan = _planned(scene, [end], SOLVERS["euler"])
    snapshots = len(plan.compiled.starts)
    assert snapshots == 6
    measured = sum(_kept().values())
    forecast = forecast_memory(plan.scene, 1, snapshots, plan.stepper.method)
    assert forecast.retained == pytest.approx(measured, rel=0.15)


def test_the_forecast_of_bodies_apart_is_that_of_their_own_networks():
    grid = jt.voxelize(jt.shapes.box((0.2, 0.1, 0.1)), 0.02)
    structure = jt.FullVolume(grid)
    poses = [jt.Pose((0.5 * number, 0.0, 0.0)) for number in range(5)]
    bodies = [jt.Body(structure, STEEL, temperature=300.0, pose=pose) for pose in poses]
    scene = jt.Scene(tuple(bodies), TERMS)
    joined, apart = (jt.compile_scene(scene, joins=joins) for joins in (True, False))
    assert joined.receipt.memory_bytes == forecast_memory(scene, 1, 1, "euler").peak
    of_classes = forecast_memory(scene, 1, 1, "euler", classes=apart.classes)
    assert apart.receipt.memory_bytes == of_classes.peak
    assert apart.receipt.memory_bytes != joined.receipt.memory_bytes


def test_a_voxel_of_a_stencil_needs_two_states_and_a_byte():
    mesh = jt.shapes.box((1.0, 1.0, 1.0))
    rows = []
    peaks = []
    for across in (8, 16, 32):
        structure = jt.FullVolume(jt.voxelize(mesh, 1 / across))
        scene = jt.Scene((jt.Body(structure, STEEL, temperature=300.0),), TERMS)
        fragments = len(structure.grid.fragment_area)
        rows.append((np.prod(structure.state_shape), fragments, len(mesh.faces)))
        peaks.append(forecast_memory(scene, 1, 1, "euler").peak)
    volume, surface, _ = np.linalg.solve(np.array(rows, float), peaks)
    # Of the limit of 12 bytes, the rest is for the surface.
    assert volume == pytest.approx(9.0, abs=0.1)
    assert surface == pytest.approx(300.0, abs=30.0)


@pytest.mark.parametrize("structure_name", ["full", "octree"])
@pytest.mark.parametrize("solver", [None, *SOLVERS.values()])
def test_too_large_a_scene_is_refused_before_anything_is_made(
    monkeypatch, structure_name, solver
):
    def unreachable(*_):
        raise AssertionError("work began")

    scene = _scene(structure_name, 40)
    monkeypatch.setattr(compile_module, "prepare", unreachable)
    monkeypatch.setattr(host_memory, "available_bytes", lambda: 1_000_000)
    arranged = scene if solver is None else solver.arranged(scene)
    needed = forecast_memory(arranged, 1, 1, "euler").peak
    refused = lambda: pytest.raises(jt.InputError, match="needs about")
    # The first call writes checks of types, and imports.
    with refused():
        jt.simulate(_scene(structure_name, 20), 30.0, solver=solver)
    tracemalloc.start()
    try:
        with refused() as caught:
            jt.simulate(scene, 30.0, solver=solver)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    said = str(caught.value)
    assert said.startswith("simulating this scene needs about") and "\n" not in said
    assert peak < 0.15 * needed


def test_more_saved_times_and_longer_numbers_need_more():
    scene = _scene("full", 20)
    double = jt.Scene(scene.bodies, scene.terms, dtype="float64")
    few, many = (forecast_memory(scene, n, 1, "euler") for n in (1, 2001))
    fragments = len(scene.bodies[0].structure.grid.fragment_area)
    assert many.rows - few.rows == 2000 * 4 * fragments
    # Rows exist twice while the solution is put together.
    assert many.peak == many.retained + 2 * many.rows
    assert forecast_memory(double, 1, 1, "euler").steps == 2 * few.steps


def test_columns_through_a_wall_are_eliminated_in_memory():
    """Measured: 112 MB of a run with 336 973 nodes, less one with 85 293 nodes."""
    layers = jt.stacks["soil"]
    peaks = []
    for size in (4.0, 8.0):
        mesh = jt.shapes.rectangle(size, size)
        sheet = jt.Sheet(mesh, layers, 0.05, back="adiabatic")
        scene = jt.Scene((jt.Body(sheet, temperature=290.0),))
        forecast = forecast_memory(scene, saves=2, snapshots=1, method="stages")
        peaks.append(forecast.peak)
    assert peaks[1] - peaks[0] == pytest.approx(112e6, rel=0.1)
