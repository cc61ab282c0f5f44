"""Parts between which no heat flows take their own numbers of stages."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.integrate import part_stepper
from jaxthermo.integrate.explicit import RKL2Stepper
from jaxthermo.integrate.heat_rates import add_loads
from jaxthermo.integrate.part_stepper import PartStepper, stage_parts
from jaxthermo.integrate.run.checkpoint import load_checkpoint, save_checkpoint
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.integrate.run.segments import begin_run, finish_run, run_segments
from jaxthermo.integrate.run.simulate import run_plan
from jaxthermo.integrate.run.time_error import of_pass
from jaxthermo.scene.compile.independent_parts import (
    independent_groups,
    program_of,
)
from tests.shallow import SHALLOW


pytestmark = SHALLOW

DT = 120.0
END = 2 * DT
AIR = jt.Convection(8.0, 290.0)
EMISSION = jt.Surroundings(285.0)


def sun(body):
    """Sun that acts on the top of one body alone."""
    top = jt.Side((0.0, 0.0, 1.0), body=body)
    return jt.Sun(direction=(0.3, 0.2, -1.0), irradiance=800.0, on=top)


TERMS = (AIR, EMISSION, sun(1))
LINEAR_TERMS = (AIR, sun(1))


@pytest.fixture(autouse=True)
def pays(monkeypatch):
    """Let a loop over stages pay for few nodes, so that scenes are small."""
    monkeypatch.setattr(part_stepper, "_MIN_SAVED", 1)


@pytest.fixture(scope="module")
def bodies():
    """A small piece of aluminium, and a large one of concrete."""
    return (
        jt.Body(
            jt.FullVolume(jt.voxelize(jt.shapes.box((0.04, 0.04, 0.02)), pitch=0.01)),
            jt.Material(200.0, density=2700.0, specific_heat=900.0),
            temperature=310.0,
            name="fast",
        ),
        jt.Body(
            jt.FullVolume(jt.voxelize(jt.shapes.box((0.25, 0.25, 0.2)), pitch=0.025)),
            jt.Material(1.0, density=2000.0, specific_heat=900.0, absorptivity=0.6),
            temperature=290.0,
            pose=jt.Pose((1.0, 0.0, 0.0)),
            name="slow",
        ),
    )


def scene_of(bodies, terms=TERMS):
    return jt.Scene(tuple(bodies), terms, dtype="float64")


def plan_of(scene, dt=DT):
    return plan_run(scene, END, None, solver=jt.SuperTimeStepping(dt=dt))


def run(scene, dt=DT):
    return jt.simulate(scene, END, solver=jt.SuperTimeStepping(dt=dt))


def test_a_slow_body_takes_the_few_stages_that_it_requires(bodies):
    plan = plan_of(scene_of(bodies))
    fast, slow = stage_parts(plan.compiled, DT)
    assert (fast.groups, slow.groups) == ((0,), (1,))
    assert fast.stable_step == plan.stable_step
    assert slow.stable_step > 100 * fast.stable_step
    assert fast.stages > 10 * slow.stages
    assert isinstance(plan.stepper, PartStepper)
    assert plan.stepper.stages_taken == fast.stages
    assert [s.stages_taken for s in plan.stepper.steppers] == [
        fast.stages,
        slow.stages,
    ]


@pytest.mark.parametrize("terms", (TERMS, LINEAR_TERMS), ids=("emission", "linear"))
def test_parts_are_as_each_of_them_is_alone(bodies, terms):
    together = run(scene_of(bodies, terms))
    alone = [
        run(scene_of(bodies[:1], terms[:-1])),
        run(scene_of(bodies[1:], (*terms[:-1], sun(0)))),
    ]
    np.testing.assert_allclose(
        together.surface_temperature,
        np.concatenate([run.surface_temperature for run in alone], axis=1),
        rtol=1e-13,
    )
    for of_body, run_alone in zip(together.energy.bodies, alone, strict=True):
        of_one = run_alone.energy
        np.testing.assert_allclose(of_body.stored_J, of_one.stored_J, rtol=1e-11)
        for name, heat in of_one.mechanisms.items():
            np.testing.assert_allclose(of_body.mechanisms[name], heat, rtol=1e-11)


def test_energy_is_balanced_over_all_parts(bodies):
    energy = run(scene_of(bodies)).energy
    supplied = sum(np.asarray(heat) for heat in energy.mechanisms.values())
    np.testing.assert_allclose(supplied, energy.stored_J, rtol=1e-11)


def test_parts_and_one_number_of_stages_converge_to_one_solution(bodies, monkeypatch):
    scene = scene_of(bodies)

    def difference(dt):
        with monkeypatch.context() as patch:
            patch.setattr(part_stepper, "_MIN_SAVED", 2**60)
            one_number = run(scene, dt)
        of_parts = np.asarray(run(scene, dt).surface_temperature)
        return np.abs(of_parts - np.asarray(one_number.surface_temperature)).max()

    coarse = difference(DT)
    fine = difference(DT / 2)
    assert 0 < fine < coarse / 3
    assert coarse < 0.05


def test_few_nodes_do_not_pay_for_a_loop_of_their_own(bodies, monkeypatch):
    compiled = plan_of(scene_of(bodies)).compiled
    fast, slow = stage_parts(compiled, DT)
    saved = slow.nodes * (fast.stages - slow.stages)
    monkeypatch.setattr(part_stepper, "_MIN_SAVED", saved)
    assert len(stage_parts(compiled, DT)) == 2
    monkeypatch.setattr(part_stepper, "_MIN_SAVED", saved + 1)
    (whole,) = stage_parts(compiled, DT)
    assert whole.groups == (0, 1)
    assert whole.nodes == fast.nodes + slow.nodes
    assert (whole.stages, whole.stable_step) == (fast.stages, fast.stable_step)
    assert isinstance(plan_of(scene_of(bodies)).stepper, RKL2Stepper)


def test_bodies_that_exchange_heat_are_one_part(bodies):
    fast, slow = bodies
    touching = replace(slow, pose=jt.Pose((0.145, 0.0, 0.0)))
    contact = jt.Contact(bodies=(0, 1), conductance=100.0)
    joined = plan_of(scene_of((fast, touching), (contact, *TERMS)))
    assert joined.compiled.program.contacts
    assert independent_groups(joined.compiled.programs) == [(0, 1)]
    assert isinstance(joined.stepper, RKL2Stepper)
    box = replace(fast, name="box", pose=jt.Pose((0.2, 0.0, 0.0)))
    radiating = plan_of(scene_of((fast, box), (jt.RadiativeExchange(285.0),)))
    assert independent_groups(radiating.compiled.programs) == [(0, 1)]


@pytest.mark.parametrize("terms", (TERMS, LINEAR_TERMS), ids=("emission", "linear"))
def test_loads_of_a_part_are_those_on_its_bodies(bodies, terms):
    plan = plan_of(scene_of(bodies, terms))
    program = plan.compiled.program
    states = tuple(state + 3.0 for state in initial_state(plan).theta)
    time = jnp.asarray(10.0)
    dt = jnp.asarray(1.0)
    warmed, rates = add_loads(program, states, new=states, time=time, dt=dt)
    of_parts = []
    for group in (0, 1):
        part = program_of(program, (group,))
        state = (states[group],)
        (one,), part_rates = add_loads(part, state, new=state, time=time, dt=dt)
        np.testing.assert_allclose(one, warmed[group], rtol=1e-15)
        of_parts.append(part_rates)
    np.testing.assert_allclose(sum(of_parts), rates, rtol=1e-12)
    for number, (_, entry_bodies) in enumerate(program.entries):
        (body,) = entry_bodies
        assert of_parts[1 - body][number] == 0


def test_the_receipt_names_the_body_that_limits_the_stable_step(bodies):
    scene = scene_of(bodies)
    plan = plan_of(scene)
    line = f"the stable step, {plan.stable_step:.3g} s, is that of body 0 (fast)"
    assert line in plan.compiled.receipt.notes
    implicit = plan_run(scene, END, None, solver=jt.TRBDF2(dt=DT))
    assert not any("stable step" in note for note in implicit.compiled.receipt.notes)


def test_in_a_group_it_is_the_body_of_the_stiffest_node():
    conductivities = (1.0, 2.0, 8.0, 4.0)
    structure = jt.FullVolume(
        jt.voxelize(jt.shapes.box((0.03, 0.03, 0.03)), pitch=0.01)
    )
    bodies = [
        jt.Body(
            structure,
            jt.Material(conductivity, density=2000.0, specific_heat=900.0),
            temperature=290.0,
            pose=jt.Pose((0.1 * number, 0.0, 0.0)),
        )
        for number, conductivity in enumerate(conductivities)
    ]
    compiled = plan_of(scene_of(bodies, (AIR,))).compiled
    assert len(compiled.program.bodies) == 1
    assert int(compiled.stable_rates.stiffest_body) == 2


def test_derivatives_pass_through_parts(bodies):
    plan = plan_of(scene_of(bodies))
    program = plan.compiled.program
    state = initial_state(plan)
    stepper = PartStepper(((0,), (1,)), (RKL2Stepper(7), RKL2Stepper(3)))
    dt = 0.9 * jnp.asarray(plan.stable_step)
    time = jnp.zeros_like(dt)

    def mean_after_step(rise):
        theta = tuple(values + rise for values in state.theta)
        before = type(state)(theta, state.ledger)
        after = stepper.step(program, before, time, dt)
        return sum(values.mean() for values in after.theta)

    rise = jnp.asarray(2.0)
    step = 1e-3
    mean_and_gradient = jax.jit(jax.value_and_grad(mean_after_step))
    difference = mean_and_gradient(rise + step)[0] - mean_and_gradient(rise - step)[0]
    _, gradient = mean_and_gradient(rise)
    np.testing.assert_allclose(gradient, difference / (2 * step), rtol=1e-7)


LONG_END = 7200.0
CONTROL = jt.ErrorControl(relative_error=1e-4)


@pytest.fixture
def controlled_plan(bodies):
    """A run whose second part takes one pass more than the first."""
    scene = jt.Scene(
        bodies,
        TERMS,
        probes=[(1.0, 0.0, 0.0), (0.0, 0.0, 0.0)],
        surface_outputs=["heat_flux"],
        dtype="float64",
    )
    with precision("float64"):
        return plan_run(scene, LONG_END, None, solver=CONTROL, control_error=True)


def test_a_part_takes_no_pass_after_that_in_which_its_error_holds(controlled_plan):
    plan = controlled_plan
    with precision("float64"):
        together = run_plan(plan)
        of_passes = [run_plan(of_pass(plan, number)) for number in (2, 3)]
        exact = np.asarray(run_plan(of_pass(plan, 6)).surface_temperature)
    assert together.run.steps == 2**3 * plan.steps
    surfaces = plan.compiled.program.fragments()
    for body, (surface, of_pass_alone) in enumerate(
        zip(surfaces, of_passes, strict=True)
    ):

        def values(solution, body=body, surface=surface):
            energy = solution.energy.bodies[body]
            return (
                solution.surface_temperature[:, surface],
                solution.heat_flux[:, surface],
                solution.mean_temperature[:, body],
                # The probes are in the other order.
                solution.probe_temperature[:, 1 - body],
                energy.stored_J,
                energy.mechanisms,
            )

        jax.tree.map(assert_array_equal, values(together), values(of_pass_alone))
    off = np.abs(np.asarray(together.surface_temperature) - exact).max()
    error = together.run.time_error
    limit = together.run.time_error_limit
    assert error is not None and limit is not None
    assert 0 < off <= error <= limit
    assert np.abs(together.energy.residual_relative).max() < 1e-11


def test_segments_and_checkpoints_know_the_parts_that_take_steps(
    controlled_plan, tmp_path
):
    plan = controlled_plan
    path = tmp_path / "checkpoint.npz"
    with precision("float64"):
        expected = run_plan(plan)
        progress = begin_run(plan)
        while not progress.passes.finished:
            progress = next(run_segments(plan, progress))
            save_checkpoint(path, plan=plan, progress=progress, key="key")
            progress = load_checkpoint(
                path, plan=plan, fresh=begin_run(plan), key="key"
            )
            assert progress is not None
        solution = finish_run(plan, progress)
    assert solution.run.time_error == expected.run.time_error
    assert_array_equal(solution.surface_temperature, expected.surface_temperature)
    jax.tree.map(assert_array_equal, solution.energy, expected.energy)
