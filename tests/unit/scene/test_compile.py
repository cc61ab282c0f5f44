"""What is not in a scene is not in its program, and the receipt says why."""

import equinox as eqx
import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.integrate.run import simulate as simulate_module
from jaxthermo.integrate.run.plan import initial_state, plan_run
from jaxthermo.integrate.run.simulate import run_plan
from tests.bodies import blocks


METAL = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.8)
MIRROR = jt.Material(16.0, density=8000.0, specific_heat=500.0, emissivity=0.0)
SHAPE = (4, 3, 5)
TOP = jt.Side((0.0, 0.0, 1.0))
TERMS = {
    "sun": jt.Sun((0.0, 0.0, -1.0), 800.0),
    "emission": jt.Surroundings(280.0),
    "convection": jt.Convection(10.0, 290.0),
    "heat_flux": jt.HeatFlux(100.0, on=TOP),
    "fixed_temperature": jt.FixedTemperature(310.0, on=jt.Side((1.0, 0.0, 0.0))),
}


@pytest.fixture(scope="module")
def structure():
    solid = np.ones(SHAPE, bool)
    solid[0, 0, 0] = False
    return jt.FullVolume(blocks(solid, 0.01))


def _scene(
    structure,
    *terms,
    material: jt.Material | jt.MaterialMap = METAL,
    dtype: Dtype = "float32",
):
    body = jt.Body(structure, material, temperature=300.0)
    return jt.Scene((body,), terms, dtype=dtype)


def _step(scene):
    """The jaxpr of one step; the program's arrays are its first inputs."""
    todo = plan_run(scene, 2.0, None, jt.ForwardEuler())
    arrays, static = eqx.partition(todo.compiled.program, eqx.is_array)
    now = jnp.zeros((), todo.dtype)

    def step(arrays, state):
        return todo.stepper.step(eqx.combine(arrays, static), state, now, now)

    return jax.make_jaxpr(step)(arrays, initial_state(todo)), arrays


def _equations(jaxpr):
    """Every equation, those of all programs within included."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in jax.extend.core.jaxprs_in_params(equation.params):
            yield from _equations(inner)


def _names(scene):
    """The name scopes and the primitives of one step."""
    equations = list(_equations(_step(scene)[0].jaxpr))
    scopes = {str(e.source_info.name_stack) for e in equations}
    return scopes, {e.primitive.name for e in equations}


def test_the_receipt_has_the_factor_that_was_chosen():
    grid = blocks(np.ones((4, 4, 4), bool), 0.01)
    structure = jt.Aggregate(grid, jt.Aggregate.factor_for(grid, nodes=9))
    receipt = plan_run(_scene(structure), 2.0, None, None).compiled.receipt
    assert receipt.structures == ("Aggregate x2, 8 nodes",)


@pytest.mark.parametrize("absent", TERMS)
def test_an_absent_mechanism_leaves_no_trace(structure, absent):
    present = {name: term for name, term in TERMS.items() if name != absent}
    scopes, _ = _names(_scene(structure, *present.values()))
    assert not any(absent in scope for scope in scopes)
    assert all(any(name in scope for scope in scopes) for name in present)


def test_without_terms_no_surface_is_touched(structure):
    indexing = {"gather", "scatter", "scatter-add"}
    scopes, primitives = _names(_scene(structure))
    assert not primitives & indexing
    assert any("conduction" in scope for scope in scopes)
    _, primitives = _names(_scene(structure, TERMS["convection"]))
    assert primitives & indexing == {"gather", "scatter-add"}


def test_products_of_matrices_are_in_full_precision():
    # A notch, whose sides see each other.
    solid = np.ones((3, 2, 2), bool)
    solid[1, 1] = False
    notched = jt.FullVolume(blocks(solid, 0.01))
    exchange = jt.RadiativeExchange(290.0, directions=16)
    equations = _equations(_step(_scene(notched, exchange))[0].jaxpr)
    actual = [
        e.params["precision"] for e in equations if e.primitive.name == "dot_general"
    ]
    exact = jax.lax.Precision.HIGHEST
    assert actual and set(actual) == {(exact, exact)}


def test_one_material_costs_one_byte_a_cell(structure):
    _, arrays = _step(_scene(structure))
    lattices = [a for a in jax.tree.leaves(arrays.bodies[0].network) if a.ndim]
    assert [(a.shape, str(a.dtype)) for a in lattices] == [(SHAPE, "uint8")]


def test_two_materials_cost_an_array_a_face(structure):
    region = jt.Region((0.0, 0.0, 0.0), (0.02, 1.0, 1.0))
    painted = jt.MaterialMap(METAL, ((region, MIRROR),))
    _, arrays = _step(_scene(structure, material=painted))
    lattices = [a for a in jax.tree.leaves(arrays.bodies[0].network) if a.ndim == 3]
    assert len(lattices) == 4


def test_pruned_and_unpruned_programs_agree(structure):
    dtype = "float64"
    included = TERMS["sun"], TERMS["convection"], TERMS["emission"]
    idle = (jt.HeatFlux(0.0), jt.Convection(0.0, 350.0))
    solver = jt.ForwardEuler(dt=0.5)
    short, long = (
        _scene(structure, *terms, dtype=dtype)
        for terms in (included, (*included, *idle))
    )
    pruned = jt.simulate(short, 50.0, solver=solver)
    unpruned = run_plan(plan_run(long, 50.0, None, solver=solver, prune=False))
    assert set(unpruned.receipt.included) - set(pruned.receipt.included) == {
        "heat_flux", "convection#2"
    }  # fmt: skip
    np.testing.assert_allclose(
        pruned.surface_temperature,
        unpruned.surface_temperature,
        rtol=4 * np.finfo(dtype).eps,
    )
    assert float(pruned.mean_temperature[0, 0]) != 300.0


def _omissions(scene):
    return {o.what: o.why for o in jt.compile_scene(scene).receipt.left_out}


@pytest.mark.parametrize(
    ("term", "material", "message", "why"),
    [
        (jt.HeatFlux(0.0), METAL, "heat_flux", "the heat flux is 0"),
        (jt.Convection(0.0, 300.0), METAL, "convection", "coefficient is 0"),
        (jt.Sun((0.0, 0.0, -1.0), 0.0), METAL, "sun", "switched off at all times"),
        (jt.Sun((0.0, 0.0, -1.0), 9.0), MIRROR, "sun", "absorptivity 0"),
        (jt.Surroundings(280.0), MIRROR, "emission", "emissivity 0"),
    ],
)
def test_the_receipt_says_why(structure, term, material, message, why):
    scene = _scene(structure, term, material=material)
    omitted = _omissions(scene)
    assert why in omitted[message]
    assert "uniform" in omitted["per-node conductivity"]
    compiled = jt.compile_scene(scene)
    assert compiled.receipt.included == ("conduction",)
    assert compiled.program.mechanisms == ()
    run = jt.simulate(scene, 1.0, solver=jt.ForwardEuler())
    assert run.energy.mechanisms == {}


def test_a_held_surface_needs_no_other_term(structure):
    held = jt.FixedTemperature(310.0, on=TOP)
    omitted = _omissions(_scene(structure, TERMS["heat_flux"], held))
    assert "held at a temperature" in omitted["heat_flux"]


def test_no_surface_is_held_twice(structure):
    first = jt.FixedTemperature(310.0, on=TOP)
    second = jt.FixedTemperature(320.0)
    with pytest.raises(jt.InputError, match=r"terms\[0\] and terms\[1\] both hold"):
        jt.compile_scene(_scene(structure, first, second))


def test_a_selection_of_nothing_is_refused(structure):
    nowhere = jt.Region((5.0, 5.0, 5.0), (6.0, 6.0, 6.0))
    everywhere = jt.HeatFlux(1.0)
    selected = jt.HeatFlux(1.0, on=nowhere)
    words = r"^terms\[1\], heat_flux: on=.* selects no surface of body 0"
    with pytest.raises(jt.InputError, match=words):
        jt.compile_scene(_scene(structure, everywhere, selected))
    sun = jt.Sun((0.0, 0.0, -1.0), 500.0, on=nowhere)
    with pytest.raises(jt.InputError, match=r"^terms\[0\], sun: on=.* selects no"):
        jt.compile_scene(_scene(structure, sun))


def test_the_receipt_counts(structure):
    receipt = jt.compile_scene(_scene(structure, *TERMS.values())).receipt
    assert receipt.included == ("conduction", *TERMS)
    assert (receipt.nodes, receipt.dtype) == (59, "float32")
    # 3 x 3 x 5 + 4 x 2 x 5 + 4 x 3 x 4 shared faces, less the three of the corner.
    assert receipt.links == 45 + 40 + 48 - 3
    assert receipt.fragments == 2 * (12 + 15 + 20)
    assert receipt.memory_bytes > 0
    assert receipt.as_dict()["left_out"][0]["what"] == "per-node conductivity"


def test_new_numbers_need_no_new_program(structure, monkeypatch):
    """Neither material, nor coefficients, nor temperatures, nor lengths of the run.

    All of them need two iterations at the surface, which a program has as a constant.
    """
    calls = []
    steps_of = simulate_module.steps_of

    def counted(*args, **kwargs):
        calls.append(args)
        return steps_of(*args, **kwargs)

    monkeypatch.setattr(simulate_module, "steps_of", counted)

    def run(k, h, temperature, t1):
        material = jt.Material(k, density=8000.0, specific_heat=500.0)
        body = jt.Body(structure, material, temperature=temperature)
        terms = (
            jt.Convection(h, temperature - 10.0),
            jt.Surroundings(temperature - 20.0),
            jt.HeatFlux(jt.Table([0.0, 1.0], [h, 2 * h]), on=TOP),
            jt.Sun((0.0, 0.0, -1.0), jt.Until(80.0 * h, 0.5)),
            jt.FixedTemperature(temperature + h, on=jt.Side((1.0, 0.0, 0.0))),
        )
        return jt.simulate(jt.Scene((body,), terms), t1).mean_temperature

    first = run(4.0, 10.0, 300.0, 2.0)
    traces = len(calls)
    second = run(3.0, 20.0, 350.0, 3.0)
    assert traces > 0
    assert len(calls) == traces
    assert float(first[0, 0]) != float(second[0, 0])


def test_two_bodies_are_told_apart(structure):
    bodies = tuple(
        jt.Body(
            structure, METAL, temperature=300.0, pose=jt.Pose(translation=(x, 0.0, 0.0))
        )
        for x in (0.0, 1.0)
    )
    side = jt.Side((0.0, 0.0, 1.0), body=1)
    scene = jt.Scene(bodies, (jt.HeatFlux(100.0, on=side),), dtype="float64")
    omitted = _omissions(scene)
    assert "another body" in omitted["heat_flux on body 0"]
    solution = jt.simulate(scene, 3.0, solver=jt.ForwardEuler())
    means = np.asarray(solution.mean_temperature)[0]
    assert means[0] == 300.0
    assert means[1] > 300.0
    np.testing.assert_array_equal(solution.of_body(0), 300.0)
    assert float(solution.of_body(1).max()) > 300.0
