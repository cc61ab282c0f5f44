"""`compile_simulation`: other numbers without compiling, tracing or searching again."""

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import jax.monitoring
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.integrate.implicit import jacobian
from jaxthermo.integrate.run import surface_reading
from jaxthermo.memo.found import findings_size, forget_findings
from jaxthermo.network import multigrid
from jaxthermo.physics import conduction, surface
from jaxthermo.physics.contact import links
from jaxthermo.scene.compile import probes
from tests.bodies import blocks


ROOT = Path(__file__).resolve().parents[3]
EVENTS: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, *_, **__: EVENTS.append(event)
)


def compilations(stage: str = "") -> int:
    """Number of functions that were traced or compiled so far."""
    return sum("/jax/core/compile/" + stage in name for name in EVENTS)


@pytest.fixture(scope="module")
def structure():
    structure = jt.Aggregate(blocks(np.ones((4, 4, 8), bool), 0.01), factor=2)
    # What every run compiles, such as the check of its outcome.
    jt.simulate(make_scene(structure), *TIMES, solver=EULER)
    return structure


SHADED = jt.Sun((-1.0, 0.0, -0.4), jt.Until(800.0, 40.0))
TIMES = 60.0, (20.0, 60.0)
EULER = jt.ForwardEuler(dt=1.0)
AIR = (jt.Convection(10.0, 290.0),)


def make_scene(structure, k=16.0, h=10.0, air: Any = 290.0, sun=SHADED, **options):
    metal = jt.Material(k, density=8000.0, specific_heat=500.0, emissivity=0.8)
    terms = (sun, jt.Convection(h, air), jt.Surroundings(280.0))
    start = options.pop("temperature", 300.0)
    body = jt.Body(structure, metal, temperature=start, **options)
    return jt.Scene((body,), terms, dtype="float64")


def assert_equal(solution, expected):
    """Equal bit for bit."""
    for name in ("times", "surface_temperature", "mean_temperature", "energy"):
        leaves = jax.tree.leaves((getattr(solution, name), getattr(expected, name)))
        half = len(leaves) // 2
        for a, b in zip(leaves[:half], leaves[half:], strict=True):
            np.testing.assert_array_equal(a, b, name)
    assert solution.run.steps == expected.run.steps
    assert solution.receipt.notes == expected.receipt.notes
    assert solution.receipt.left_out == expected.receipt.left_out


def fresh(scene, solver=None):
    forget_findings()
    return jt.simulate(scene, *TIMES, solver=solver)


@pytest.mark.parametrize(
    "solver",
    [None, jt.ForwardEuler(), jt.SuperTimeStepping(dt=20.0), jt.BackwardEuler(5.0)],
)
def test_other_numbers_cost_no_compilation(structure, solver):
    run = jt.compile_simulation(make_scene(structure), *TIMES, solver=solver)
    # Both numbers of a run that controls its error, which may take more passes.
    run(make_scene(structure, h=11.0))
    compiled_so_far = compilations()
    changed_scene = make_scene(structure, k=150.0, h=25.0, air=285.0, temperature=310.0)
    solution = run(changed_scene)
    assert compilations() == compiled_so_far
    assert solution.receipt.searches == ()
    assert_equal(solution, fresh(changed_scene, solver))


def test_the_same_scene_again_is_the_same(structure):
    scene = make_scene(structure)
    run = jt.compile_simulation(scene, *TIMES)
    compiled_so_far = compilations()
    solution = run()
    assert compilations() == compiled_so_far
    assert solution.receipt.searches == ()
    assert_equal(solution, fresh(scene))


def test_a_scene_is_bound_once_for_all_its_numbers():
    forget_findings()
    structure = jt.Aggregate(blocks(np.ones((4, 4, 8), bool), 0.01), factor=2)
    first = jt.simulate(make_scene(structure), *TIMES, solver=EULER)
    count = findings_size()[0]
    again = jt.simulate(make_scene(structure, k=17.0, h=11.0), *TIMES, solver=EULER)
    assert findings_size()[0] == count
    assert first.receipt.searches == ("shadows of sun on body 0",)
    assert again.receipt.searches == ()
    # Without a coefficient another scene is bound, without air.
    jt.simulate(make_scene(structure, h=0.0), *TIMES, solver=EULER)
    assert findings_size()[0] > count
    del structure, first, again
    gc.collect()
    # Programs alone remain, which other bodies of these shapes share.
    assert findings_size()[0] == 2


def test_simulate_compiles_nothing_again_either(structure):
    jt.simulate(make_scene(structure), *TIMES, solver=jt.ForwardEuler())
    compiled_so_far = compilations()
    scene = make_scene(structure, k=20.0, h=30.0)
    solution = jt.simulate(scene, *TIMES, solver=jt.ForwardEuler())
    assert compilations() == compiled_so_far
    assert solution.receipt.searches == ()


def test_other_times_of_a_table_cost_no_compilation(structure):
    def air(end):
        return jt.Table([0.0, end], [290.0, 300.0])

    solver = jt.SuperTimeStepping(dt=10.0)
    run = jt.compile_simulation(
        make_scene(structure, air=air(30.0)), *TIMES, solver=solver
    )
    later_table = make_scene(structure, air=air(45.0))
    compiled_so_far = compilations()
    solution = run(later_table)
    assert compilations() == compiled_so_far
    assert_equal(solution, fresh(later_table, solver))


def test_other_weights_cost_no_compilation(structure):
    grid = structure.grid
    solver = jt.ForwardEuler()

    def weighted(w):
        return jt.Aggregate(grid, factor=2, weights=jt.ConductionWeights(within=w))

    run = jt.compile_simulation(make_scene(weighted(1.1)), *TIMES, solver=solver)
    weaker_links = make_scene(weighted(0.9))
    compiled_so_far = compilations()
    solution = run(weaker_links)
    assert compilations() == compiled_so_far
    assert_equal(solution, fresh(weaker_links, solver))


def test_a_full_volume_with_weights_does_not_run_in_cells_found_without():
    grid = blocks(np.ones((3, 3, 4), bool), 0.01)
    weights = jt.ConductionWeights(), jt.ConductionWeights(within=1 + 1e-9)
    bodies = (jt.FullVolume(grid, weights=body_weights) for body_weights in weights)
    scenes = (
        jt.Scene(make_scene(body).bodies, AIR, dtype="float64") for body in bodies
    )
    runs = [jt.simulate(scene, *TIMES, solver=EULER) for scene in scenes]
    plain, weighted = (np.asarray(run.surface_temperature) for run in runs)
    np.testing.assert_allclose(weighted, plain, rtol=1e-9)


def test_a_sun_that_moved_casts_its_shadows_again(structure):
    run = jt.compile_simulation(make_scene(structure), *TIMES, solver=EULER)
    moved = make_scene(structure, sun=jt.Sun((0.0, -1.0, -0.7), jt.Until(900.0, 40.0)))
    solution = run(moved)
    assert solution.receipt.searches == ("shadows of sun on body 0",)
    assert_equal(solution, fresh(moved, EULER))


def test_a_sun_that_moved_a_little_costs_its_shadows_only(structure):
    def sun(x):
        return jt.Sun((-1.0, 0.0, x), jt.Until(800.0, 40.0))

    low = make_scene(structure, sun=sun(0.0))
    high = make_scene(structure, sun=sun(-0.4))
    # Another number of lit fragments, of which two runs know.
    jt.simulate(high, *TIMES, solver=EULER)
    run = jt.compile_simulation(low, *TIMES, solver=EULER)
    moved = make_scene(structure, sun=sun(-0.1))
    compiled_so_far = compilations("backend_compile")
    solution = run(moved)
    assert solution.receipt.searches == ("shadows of sun on body 0",)
    assert compilations("backend_compile") == compiled_so_far
    assert_equal(solution, fresh(moved, EULER))


@pytest.fixture
def counted(monkeypatch):
    """A function that counts calls of another one, by its name in a module."""
    calls: list[str] = []

    def count(module, name):
        inner = getattr(module, name)

        def outer(*args, **kwargs):
            calls.append(name)
            return inner(*args, **kwargs)

        monkeypatch.setattr(module, name, outer)

    return calls, count


MOVED = {
    "overlaps of bodies",
    "contacts of bodies",
    "shadows of sun on body 0",
    "shadows of sun on body 1",
}


def test_a_body_that_moved_costs_its_contacts_and_nothing_of_its_structure(counted):
    # Of its own, so that nothing is known of it.
    structure = jt.Aggregate(blocks(np.ones((4, 4, 8), bool), 0.01), factor=2)
    calls, count = counted
    count(links, "contacts_between")
    count(conduction, "row_layout")
    count(surface, "_enclosing")

    def pair(gap, k=16.0):
        lower = make_scene(structure, k).bodies[0]
        pose = jt.Pose(translation=(0.0, 0.0, 0.08 + gap))
        upper = jt.Body(structure, lower.material, temperature=350.0, pose=pose)
        return jt.Scene((lower, upper), (SHADED, jt.Contact(500.0)), dtype="float64")

    run = jt.compile_simulation(pair(0.0), *TIMES, solver=EULER)
    assert sorted(calls) == ["_enclosing", "contacts_between", "row_layout"]
    assert run(pair(0.0, k=20.0)).receipt.searches == ()
    calls.clear()
    moved = run(pair(0.001))
    assert set(moved.receipt.searches) == MOVED
    assert "row_layout" not in calls
    assert calls.count("contacts_between") == 1
    calls.clear()
    # Where it was before, nothing is searched at all.
    assert run(pair(0.0)).receipt.searches == ()
    assert calls == []
    # Nor are both searched for more where they do not touch any longer.
    apart = pair(0.005)
    solution = run(apart)
    assert set(solution.receipt.searches) == MOVED
    assert_equal(solution, fresh(apart, EULER))


def test_implicit_steps_and_probes_search_once(counted):
    structure = jt.Aggregate(blocks(np.ones((12, 12, 12), bool), 0.01), factor=2)
    calls, count = counted
    count(multigrid, "_layout")
    count(jacobian, "_found_components")
    count(probes, "KDTree")
    count(surface_reading, "KDTree")

    def scene(k):
        body = make_scene(structure, k).bodies[0]
        return jt.Scene((body,), AIR, probes=[(0.0, 0.0, 0.0)], dtype="float64")

    def read(k):
        solution = jt.simulate(scene(k), 6e4, solver=jt.BackwardEuler(2e4))
        face = structure.grid.fragment_foot[:1]
        return jt.probe(solution, face)

    read(16.0)
    assert set(calls) == {"_layout", "_found_components", "KDTree"}
    calls.clear()
    reading = read(20.0)
    assert calls == []
    forget_findings()
    np.testing.assert_array_equal(reading, read(20.0))


def test_gradients_are_those_of_finite_differences(structure):
    run = jt.compile_simulation(make_scene(structure), *TIMES, solver=EULER)

    def mean(k, h):
        return run(make_scene(structure, k, h)).surface_temperature[-1].mean()

    gradient = jax.jit(jax.grad(mean, (0, 1)))(16.0, 10.0)
    for n, (at, step) in enumerate([(16.0, 1e-3), (10.0, 1e-3)]):
        ends = [[16.0, 10.0], [16.0, 10.0]]
        ends[0][n] = at - step
        ends[1][n] = at + step
        low, high = (float(mean(*numbers)) for numbers in ends)
        expected = (high - low) / (2 * step)
        assert float(gradient[n]) == pytest.approx(expected, rel=1e-5)


def test_it_can_be_jitted_and_mapped(structure):
    run = jt.compile_simulation(make_scene(structure), *TIMES, solver=EULER)

    def mean(h):
        return run(make_scene(structure, h=h)).mean_temperature[-1, 0]

    values = np.array([5.0, 10.0, 20.0])
    expected = [float(mean(h)) for h in values.tolist()]
    mapped = jax.jit(jax.vmap(mean))(values)
    np.testing.assert_allclose(mapped, expected, rtol=1e-10)


def test_scenes_of_other_shapes_are_refused_in_one_line(structure):
    scene = make_scene(structure)
    run = jt.compile_simulation(scene, *TIMES, solver=EULER)
    coarser = jt.Aggregate(structure.grid, factor=4)
    table = jt.Table([0.0, 10.0], [290.0, 295.0])
    for other_scene, words in (
        (make_scene(coarser), r"bodies\[0\].structure is Aggregate of 2 nodes instead"),
        (jt.Scene(scene.bodies, scene.terms[:2], dtype="float64"), "terms is 2 inst"),
        (jt.Scene(scene.bodies, scene.terms), "dtype is float32 instead of float64"),
        (make_scene(structure, air=table), r"terms\[1\], convection, has other kinds"),
        (
            jt.Scene(scene.bodies, scene.terms[::-1], dtype="float64"),
            r"terms\[0\] is a Surroundings instead of a Sun",
        ),
    ):
        with pytest.raises(jt.InputError, match=words) as refused:
            run(other_scene)
        assert "\n" not in str(refused.value)


def test_traced_scenes_are_not_compiled_for(structure):
    with pytest.raises(jt.InputError, match="compile it for known values"):
        jax.jit(lambda h: jt.compile_simulation(make_scene(structure, h=h), 1.0))(1.0)


_ALONE = """
import jax, sys
jax.config.update("jax_enable_x64", True)
import numpy as np, jaxthermo as jt
from tests.bodies import blocks
from tests.unit.integrate.test_compiled_simulation import TIMES, make_scene
body = jt.Aggregate(blocks(np.ones((4, 4, 8), bool), 0.01), factor=2)
scene = make_scene(body, k=20.0, h=30.0)
np.save(sys.argv[1], jt.simulate(scene, *TIMES).surface_temperature)
"""


@pytest.mark.slow
def test_a_run_equals_that_of_a_new_process(structure, tmp_path):
    path = tmp_path / "alone.npy"
    subprocess.run(
        [sys.executable, "-c", _ALONE, str(path)], cwd=ROOT, check=True, timeout=300
    )
    run = jt.compile_simulation(make_scene(structure), *TIMES)
    solution = run(make_scene(structure, k=20.0, h=30.0))
    np.testing.assert_array_equal(solution.surface_temperature, np.load(path))


def test_the_receipt_names_a_number_that_changes_what_is_compiled(structure):
    run = jt.compile_simulation(make_scene(structure), *TIMES, solver=EULER)
    still = run(make_scene(structure, h=0.0))
    (note,) = [n for n in still.receipt.notes if "another program" in n]
    assert note == (
        "terms[1].heat_transfer_coefficient is 0.0 instead of 10.0: another program "
        "was compiled"
    )
    assert "convection" not in still.receipt.included
    expected = fresh(make_scene(structure, h=0.0), EULER)
    np.testing.assert_array_equal(
        still.surface_temperature, expected.surface_temperature
    )
    again = run(make_scene(structure, h=20.0))
    assert not any("another program" in n for n in again.receipt.notes)
