"""Bodies that are one network are as each of them is alone."""

import re

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.integrate.run.simulate import first_loop, take_steps
from jaxthermo.integrate.stepper import in_place
from jaxthermo.memo.found import forget_findings
from jaxthermo.scene.compile import groups
from tests.shallow import SHALLOW


TERMS = (
    jt.Sun(direction=(0.3, 0.2, -1.0), irradiance=800.0),
    jt.Convection(8.0, 290.0),
    jt.Surroundings(285.0),
)
EULER = jt.ForwardEuler(dt=2.0)
STEEL = jt.Material(16.0, density=8000.0, specific_heat=500.0)


def unlike_bodies(count, gap=0.2, temperature=None):
    """Boxes and balls of several sizes and materials, turned; every fifth is large."""
    bodies = []
    for n in range(count):
        edges = (0.03 + 0.01 * (n % 3), 0.03, 0.02 + 0.01 * (n % 2))
        shape = jt.shapes.sphere(0.02) if n % 4 == 3 else jt.shapes.box(edges)
        structure = jt.FullVolume(jt.voxelize(shape, pitch=0.01))
        if n % 5 == 2:
            structure = jt.Aggregate(structure.grid, factor=2)
        bodies.append(
            jt.Body(
                structure,
                jt.Material(
                    10.0 + n,
                    density=7800.0,
                    specific_heat=400.0 + 10 * n,
                    emissivity=0.5 + 0.02 * (n % 20),
                    absorptivity=0.4,
                ),
                temperature=280.0 + 3 * n if temperature is None else temperature,
                pose=jt.Pose.about((0.0, 0.0, 1.0), 0.3 * n, (gap * n, 0.0, 0.0)),
            )
        )
    return tuple(bodies)


def run(scene, **options):
    return jt.simulate(scene, 40.0, save_at=[0.0, 20.0, 40.0], solver=EULER, **options)


@pytest.fixture
def apart(monkeypatch):
    """Run a function with every body by itself."""

    def call(function):
        forget_findings()
        with monkeypatch.context() as patch:
            patch.setattr(groups, "_LEAST_BODIES", 10**6)
            result = function()
        forget_findings()
        return result

    return call


def assert_equal_runs(joined, separate, rel):
    for name in ("surface_temperature", "mean_temperature"):
        a = np.asarray(getattr(joined, name))
        b = np.asarray(getattr(separate, name))
        np.testing.assert_allclose(a, b, rtol=rel)
    for a, b in zip(joined.energy.bodies, separate.energy.bodies, strict=True):
        scale = max(float(np.abs(b.stored_J).max()), 1.0)
        assert a.mechanisms.keys() == b.mechanisms.keys()
        for name in b.mechanisms:
            near = np.abs(np.asarray(a.mechanisms[name]) - b.mechanisms[name]).max()
            assert near <= 100 * rel * scale, name
        assert np.abs(np.asarray(a.stored_J) - b.stored_J).max() <= 100 * rel * scale


@pytest.mark.parametrize(
    ("dtype", "rel"),
    [("float32", 1e-6), pytest.param("float64", 1e-12, marks=pytest.mark.slow)],
)
def test_a_body_among_others_is_as_it_is_alone(dtype, rel):
    bodies = unlike_bodies(7)
    joined = run(jt.Scene(bodies, TERMS, dtype=dtype))
    counts = np.cumsum([len(b.structure.grid.fragment_area) for b in bodies])
    parts = np.split(np.asarray(joined.surface_temperature), counts[:-1], axis=1)
    for n in (2, 3):
        alone = run(jt.Scene((bodies[n],), TERMS, dtype=dtype))
        np.testing.assert_allclose(
            parts[n], np.asarray(alone.surface_temperature), rtol=rel
        )
        energy = joined.energy.bodies[n]
        for name, heat in alone.energy.mechanisms.items():
            scale = np.abs(np.asarray(alone.energy.stored_J)).max()
            near = np.abs(np.asarray(energy.mechanisms[name]) - np.asarray(heat)).max()
            assert near <= 100 * rel * scale


def walls_and_skins():
    """Sheets of two cells through the wall, and skins of an orthotropic material.

    The second sheet has two parts, of which one stands on the first sheet.
    """
    layers = (jt.Layer("copper", 1e-3), jt.Layer("glass", 4e-3))
    corners = [(-0.05, 0.0, 0.05), (0.05, 0.0, 0.05), (0.05, 0.0, 0.2)]
    standing = jt.shapes.polygon(corners)
    above = jt.Mesh(standing.vertices + np.array([0.0, 0.0, 0.5]), standing.faces)
    parts = {"standing": standing, "above": above}
    stacks = {"standing": layers, "above": layers[::-1]}
    box = jt.Sheet(jt.shapes.box((0.3, 0.2, 0.1)), layers, pitch=0.1, cells=2)
    plates = jt.Sheet(parts, stacks, pitch=0.1, cells=2)
    turned = jt.Pose.about((0.0, 0.0, 1.0), 0.4)
    bodies = [
        jt.Body(box, temperature=285.0),
        jt.Body(plates, temperature=288.0, pose=turned),
    ]
    for n in range(2):
        grid = jt.voxelize(jt.shapes.box((0.04 + 0.02 * n, 0.04, 0.04)), pitch=0.02)
        material = jt.Material((5.0 + n, 3.0, 1.0), density=2000.0, specific_heat=900.0)
        bodies.append(
            jt.Body(
                jt.Skin(jt.FullVolume(grid), cells=2),
                material,
                temperature=lambda x: 290.0 + 100.0 * x[:, 0],
                pose=jt.Pose((1.0 * n, 2.0, 0.0)),
            )
        )
    return tuple(bodies)


@pytest.mark.parametrize(
    "solver", [EULER, pytest.param(jt.TRBDF2(dt=5.0), marks=pytest.mark.slow)]
)
@SHALLOW
def test_walls_and_skins_are_as_bodies_apart(monkeypatch, apart, solver):
    monkeypatch.setattr(groups, "_LEAST_BODIES", 2)
    source = jt.HeatSource(heat_rate=4.0, within=jt.Region((-9, -9, 0), (9, 9, 9)))
    scene = jt.Scene(
        walls_and_skins(),
        (*TERMS, jt.Seam(500.0), source),
        dtype="float64",
        probes={"wall": (0.01, 0.02, 0.05), "skin": (0.0, 2.0, 0.01)},
    )

    def call():
        return jt.simulate(scene, 20.0, save_at=[10.0, 20.0], solver=solver)

    joined = call()
    program = plan_run(scene, 20.0, None, EULER).compiled.program
    assert len(program.bodies) == 2 and len(program.contacts) == 1
    separate = apart(call)
    # A linear solve stops at its tolerance.
    rel = 1e-12 if solver is EULER else 1e-10
    assert_equal_runs(joined, separate, rel)
    probed = [np.asarray(run.probe_temperature) for run in (joined, separate)]
    np.testing.assert_allclose(*probed, rtol=rel)


def test_implicit_steps_and_steady_states_are_those_of_bodies_apart(apart):
    scene = contact_scene(count=2)
    # A body that nothing touches, and one that exchanges heat with nothing.
    lone = [
        jt.Body(
            body.structure, body.material, temperature=310.0, pose=jt.Pose((x, 1, 0))
        )
        for body, x in zip(scene.bodies[:2], (0.0, 1.0), strict=True)
    ]
    up = (0.0, 0.0, 1.0)
    cooled = jt.Side(up, body=1) | jt.Side(up, body=2)
    scene = jt.Scene(
        (*scene.bodies, *lone),
        (jt.Convection(10.0, 290.0, on=cooled), *scene.terms[1:]),
        dtype="float64",
    )
    solver = jt.BackwardEuler(dt=10.0)

    def call():
        run = jt.simulate(scene, 20.0, save_at=[10.0, 20.0], solver=solver)
        return run, jt.steady(scene)

    assert len(plan_run(scene, 20.0, None, solver).compiled.program.bodies) == 1
    joined, steady = call()
    separate, steady_apart = apart(call)
    # A linear solve stops at its tolerance.
    assert_equal_runs(joined, separate, 1e-10)
    assert steady.isolated_components == steady_apart.isolated_components == 1
    np.testing.assert_allclose(
        steady.surface_temperature, steady_apart.surface_temperature, rtol=1e-9
    )


def test_the_compiled_programs_do_not_grow_with_the_bodies(monkeypatch):
    evaluate = jax.core.eval_jaxpr
    of_scenes = []

    def counted(jaxpr, *arguments):
        of_scenes.append(len(jaxpr.eqns))
        return evaluate(jaxpr, *arguments)

    monkeypatch.setattr(jax.core, "eval_jaxpr", counted)

    def operations(count):
        # The number of Newton's iterations follows from the temperatures.
        bodies = unlike_bodies(count, gap=0.3, temperature=300.0)
        plan = plan_run(jt.Scene(bodies, TERMS), 40.0, None)
        loop = first_loop(plan)
        text = in_place(take_steps, loop.theta).lower(*loop).as_text()
        return len(re.findall(r" = ", text))

    assert operations(24) <= 1.05 * operations(12)
    more_bodies, fewer_bodies = of_scenes
    assert more_bodies <= 1.05 * fewer_bodies


def test_alike_bodies_of_thousands_of_voxels_are_one_network():
    def alike(edge):
        structure = jt.FullVolume(jt.voxelize(jt.shapes.box((edge,) * 3), pitch=0.01))
        bodies = [
            jt.Body(structure, STEEL, temperature=300.0, pose=jt.Pose((n, 0, 0)))
            for n in range(4)
        ]
        return jt.Scene(tuple(bodies), TERMS)

    assert groups.grouped_numbers(alike(0.2)) == [[0, 1, 2, 3]]
    assert groups.grouped_numbers(alike(0.26)) == [[0], [1], [2], [3]]


def mixed_speeds():
    """Four pieces of aluminium, four of wood and one of steel, of 12 voxels each."""
    aluminium = jt.Material(200.0, density=2700.0, specific_heat=900.0)
    wood = jt.Material(0.15, density=600.0, specific_heat=1600.0)
    grid = jt.voxelize(jt.shapes.box((0.03, 0.02, 0.02)), pitch=0.01)
    materials = [aluminium, wood, STEEL, aluminium, wood, aluminium, wood]
    return tuple(
        jt.Body(
            jt.FullVolume(grid),
            material,
            temperature=300.0 + number,
            pose=jt.Pose((0.1 * number, 0.0, 0.0)),
        )
        for number, material in enumerate((*materials, aluminium, wood))
    )


def test_slow_bodies_are_a_group_apart_where_a_run_is_long_enough(monkeypatch):
    scene = jt.Scene(mixed_speeds(), TERMS)
    # 60 slow nodes, of a scene whose largest stable step is .2 s.
    monkeypatch.setattr(groups, "_MIN_SAVED", 60 * 2 * 10)
    assert groups.speed_classes(scene, 19.0) == (0,) * 9
    assert groups.grouped_numbers(scene) == [list(range(9))]
    classes = groups.speed_classes(scene, 21.0)
    assert classes == (0, 1, 1, 0, 1, 0, 1, 0, 1)
    assert groups.grouped_numbers(scene, classes) == [[0, 3, 5, 7], [1, 2, 4, 6, 8]]
    apart_from_all = tuple(range(9))
    assert groups.grouped_numbers(scene, apart_from_all) == [[n] for n in range(9)]


@SHALLOW
def test_groups_of_two_speeds_are_as_one_group(monkeypatch):
    scene = jt.Scene(mixed_speeds(), TERMS, dtype="float64")
    solver = jt.ForwardEuler(dt=0.1)
    one_group = jt.simulate(scene, 1.0, solver=solver)
    monkeypatch.setattr(groups, "_MIN_SAVED", 1)
    two_groups = jt.simulate(scene, 1.0, solver=solver)
    assert_equal_runs(two_groups, one_group, rel=1e-12)


def contact_scene(count=6, dtype: Dtype = "float64", **options):
    bodies = []
    for n in range(count):
        grid = jt.voxelize(jt.shapes.box((0.03, 0.03, 0.02)), pitch=0.01)
        material = jt.Material(15.0 + n, density=7800.0, specific_heat=460.0)
        pose = jt.Pose((0.0, 0.0, 0.02 * n))
        bodies.append(
            jt.Body(jt.FullVolume(grid), material, temperature=290.0 + 5 * n, pose=pose)
        )
    terms = (
        jt.Convection(10.0, 290.0),
        jt.Contact(500.0),
        jt.HeatSource(heat_rate=4.0, within=jt.Region((-1, -1, -1), (1, 1, 0), body=1)),
        jt.FixedTemperature(300.0, on=jt.Side((0.0, 0.0, -1.0), body=0)),
    )
    return jt.Scene(tuple(bodies), terms, dtype=dtype, **options)


def test_contacts_sources_probes_and_outputs_are_those_of_bodies_apart(apart):
    scene = contact_scene(
        probes={"low": (0.001, 0.002, 0.0), "high": (0.0, 0.0, 0.079)},
        surface_outputs=("heat_flux", "heat_transfer_coefficient"),
    )
    joined = run(scene)
    assert len(plan_run(scene, 40.0, None, EULER).compiled.program.bodies) == 1
    separate = apart(lambda: run(scene))
    assert_equal_runs(joined, separate, 1e-12)
    for name in ("heat_flux", "heat_transfer_coefficient", "probe_temperature"):
        a = np.asarray(getattr(joined, name))
        b = np.asarray(getattr(separate, name))
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-9)
    assert joined.energy.contacts.keys() == separate.energy.contacts.keys()
    for name, heat in separate.energy.contacts.items():
        np.testing.assert_allclose(joined.energy.contacts[name], heat, rtol=1e-12)


def test_the_largest_stable_step_is_that_of_bodies_apart(apart):
    scene = contact_scene()
    joined = plan_run(scene, 40.0, None)
    separate = apart(lambda: plan_run(scene, 40.0, None))
    assert joined.stable_step == pytest.approx(separate.stable_step, rel=1e-12)
    for name in ("highest", "lowest"):
        bounds = [getattr(p.compiled.temperatures, name) for p in (joined, separate)]
        assert float(bounds[0]) == pytest.approx(float(bounds[1]), rel=1e-12)


@pytest.mark.slow
def test_gradients_are_those_of_bodies_apart(apart):
    bodies = unlike_bodies(5)

    def mean_of_last(conductivity, emissivity):
        changed = tuple(
            jt.Body(
                body.structure,
                jt.Material(
                    conductivity * body.material.conductivity,
                    density=7800.0,
                    specific_heat=450.0,
                    emissivity=emissivity,
                    absorptivity=0.4,
                ),
                temperature=290.0 * conductivity**0.1,
                pose=body.pose,
            )
            for body in bodies
        )
        scene = jt.Scene(changed, TERMS, dtype="float64")
        solution = jt.simulate(scene, 40.0, solver=EULER)
        return solution.surface_temperature[-1].mean()

    def slopes():
        with jax.enable_x64(True):
            one = jnp.asarray(1.0)
            return jax.grad(mean_of_last, argnums=(0, 1))(one, jnp.asarray(0.8))

    np.testing.assert_allclose(slopes(), apart(slopes), rtol=1e-12)


@pytest.mark.slow
def test_bodies_that_move_are_as_bodies_apart(apart):
    bodies = list(unlike_bodies(6))
    path = jt.PoseTable(
        (0.0, 20.0, 40.0),
        tuple(jt.Pose((x, 0.0, 0.3)) for x in (1.0, 0.4, -0.2)),
    )
    motion = jt.Motion(path)
    bodies[5] = jt.Body(
        bodies[5].structure, bodies[5].material, temperature=300.0, pose=motion
    )
    scene = jt.Scene(tuple(bodies), TERMS, dtype="float64")
    assert_equal_runs(run(scene), apart(lambda: run(scene)), 1e-12)


def test_a_checkpoint_holds_each_body_by_itself(tmp_path, apart):
    scene = jt.Scene(unlike_bodies(5), TERMS)
    file = tmp_path / "checkpoint.npz"

    def planned():
        return plan_run(scene, 8.0, None, EULER)

    plan = planned()
    *_, progress = run_segments(plan, begin_run(plan))
    save_checkpoint(file, plan, progress, "key")
    loaded = load_checkpoint(file, plan, begin_run(plan), "key")
    assert loaded is not None
    for a, b in zip(loaded.state.theta, progress.state.theta, strict=True):
        np.testing.assert_array_equal(a, b)

    def stored_apart():
        separate = planned()
        again = load_checkpoint(file, separate, begin_run(separate), "key")
        assert again is not None and len(again.state.theta) == 5
        return separate.compiled.program.stored_heat(again.state.theta)

    stored = plan.compiled.program.stored_heat(progress.state.theta)
    assert len(progress.state.theta) < 5
    np.testing.assert_allclose(apart(stored_apart), stored, rtol=1e-6)


@pytest.mark.parametrize(
    ("dtype", "rel"),
    [("float32", 1e-6), pytest.param("float64", 1e-12, marks=pytest.mark.slow)],
)
@SHALLOW
def test_a_run_goes_on_from_a_checkpoint_as_bodies_apart(tmp_path, apart, dtype, rel):
    file = tmp_path / "checkpoint.npz"

    def planned():
        scene = jt.Scene(unlike_bodies(5), TERMS, dtype=dtype)
        return plan_run(scene, 8.0, [4.0, 8.0], EULER)

    def end(plan, progress):
        *_, last = run_segments(plan, progress)
        return finish_run(plan, last)

    plan = planned()
    straight = end(plan, begin_run(plan))
    middle = next(iter(run_segments(plan, begin_run(plan))))
    assert middle.interval < 2
    save_checkpoint(file, plan, middle, "key")

    def resumed():
        separate = planned()
        loaded = load_checkpoint(file, separate, begin_run(separate), "key")
        assert loaded is not None
        return end(separate, loaded)

    assert_equal_runs(resumed(), straight, rel)
    assert_equal_runs(apart(resumed), straight, rel)
