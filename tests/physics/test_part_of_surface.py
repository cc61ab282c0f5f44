"""Terms on a part of the surface: both parts together are the whole."""

from dataclasses import replace
from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import jaxthermo as jt
from jaxthermo.choices import Dtype
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.integrate.heat_rates import evaluate_rates
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.scene.compile.program import Compiled
from tests.bodies import body_at
from tests.radiating import room, surface_of, whole


RATES = eqx.filter_jit(evaluate_rates)
GRID = jt.voxelize(jt.shapes.box((0.03, 0.04, 0.05)), 0.01)
UPPER = jt.Region((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)) & ~jt.Side((1.0, 0.0, 0.0))
METAL = jt.Material(50.0, density=2000.0, specific_heat=500.0, emissivity=0.8)

TERMS = {
    "sun": lambda on: jt.Sun((-1.0, -0.5, -1.0), 800.0, on=on),
    "point source": lambda on: jt.PointSource((0.1, 0.1, 0.1), 5.0, on=on),
    "area source": lambda on: jt.AreaSource(
        (0.0, 0.2, 0.2), (0.0, -1.0, -1.0), (0.1, 0.1), 50.0, patches=1, on=on
    ),
    "surroundings": lambda on: jt.Surroundings(250.0, ground=290.0, on=on),
    "exchange": lambda on: jt.RadiativeExchange(250.0, on=on),
    "wind": lambda on: jt.Wind((0.0, 2.0, 0.0), 290.0, on=on),
    "free convection": lambda on: jt.FreeConvection(290.0, on=on),
}


@pytest.mark.parametrize("make", TERMS.values(), ids=TERMS)
def test_two_parts_are_the_whole(make):
    surface = whole(surface_of(GRID), surface_of(GRID, body=1))
    selected = UPPER.select(GRID.fragment_centres)
    on_upper, on_lower, on_all = (
        make(on).bind(surface) for on in (UPPER, ~UPPER, None)
    )

    def acting(bindings):
        return [binding for binding in bindings if isinstance(binding, jt.Binding)]

    for upper, lower, everywhere in zip(
        *map(acting, (on_upper, on_lower, on_all)), strict=True
    ):
        first, second = np.split(np.asarray(upper.effective_area), 2)
        assert first.any() and not first[~selected].any() and not second.any()
        assert not upper.acting[len(selected) :].any()
        half, nothing = np.split(np.asarray(everywhere.effective_area), 2)
        both = first + np.split(lower.effective_area, 2)[0]
        assert_allclose(both, half, rtol=1e-6)
        assert nothing.any()
    assert [binding for binding in on_upper if isinstance(binding, jt.Omitted)] == [
        jt.Omitted("`on` is on another body", 1)
    ]


def entries(compiled: Compiled) -> dict[tuple[str | int, ...], float]:
    """Heat rate of each mechanism on each body at the start [W]."""
    zero = jnp.zeros((), compiled.receipt.dtype)
    _, rates = RATES(compiled.program, compiled.state, zero)
    pairs = zip(compiled.program.entries, np.asarray(rates).tolist(), strict=True)
    return {(name, *bodies): rate for (name, bodies), rate in pairs}


def body(x=0.0, kelvin=400.0, material=METAL, grid=GRID) -> jt.Body:
    return body_at(grid, material, kelvin, at=(x, 0.0, 0.0))


def test_parts_have_surroundings_of_their_own():
    """Black at 400 K: each part emits sigma A (T^4 - T_s^4).

    The border is in the middle of a layer of voxels.
    """
    black = jt.Material(1e6, density=2000.0, specific_heat=500.0, emissivity=1.0)
    terms = (jt.Surroundings(200.0, on=UPPER), jt.Surroundings(300.0, on=~UPPER))
    scene = jt.Scene((body(material=black),), terms, dtype="float64")
    acting = compile_scene(scene).program.fragment_terms
    zero = jnp.zeros(())
    _, rates = acting.heat(zero, jnp.zeros(len(GRID.fragment_area)))
    # The top, and the upper half of three sides.
    upper = 0.03 * 0.04 + 0.025 * (0.04 + 2 * 0.03)
    whole_area = 2 * (0.03 * 0.04 + 0.03 * 0.05 + 0.04 * 0.05)
    sigma = 5.670374419e-8
    exact = [
        sigma * upper * (200.0**4 - 400.0**4),
        sigma * (whole_area - upper) * (300.0**4 - 400.0**4),
    ]
    assert acting.names == ("emission", "emission#2")
    assert_allclose(rates, exact, rtol=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_stripes_narrower_than_a_voxel_may_border_on_each_other(turn):
    mesh = jt.shapes.cylinder(0.02, 0.05)
    turned = Rotation.from_euler("y", turn).apply(mesh.vertices)
    grid = jt.voxelize(Mesh(turned, mesh.faces), 0.007)
    edges = [-1.0, -0.006, -0.002, 0.003, 1.0]
    stripes = [
        jt.Region((-1.0, -1.0, low), (1.0, 1.0, high)) for low, high in pairwise(edges)
    ]
    terms = tuple(jt.Surroundings(250.0, on=stripe) for stripe in stripes)
    compiled = compile_scene(jt.Scene((body(grid=grid),), terms, dtype="float64"))
    everywhere = compile_scene(
        jt.Scene((body(grid=grid),), (jt.Surroundings(250.0),), dtype="float64")
    )
    by_stripe = entries(compiled).values()
    assert len(by_stripe) == len(terms)
    assert sum(by_stripe) == pytest.approx(sum(entries(everywhere).values()), rel=0.01)


def test_part_of_the_exchange_in_the_middle_of_a_voxel():
    """What radiates to black surroundings alone emits eps sigma A (T^4 - T_s^4)."""
    upper = jt.Region((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    metal = jt.Material(1e6, density=2000.0, specific_heat=500.0, emissivity=0.8)
    scene = jt.Scene(
        (body(material=metal),),
        (jt.RadiativeExchange(250.0, on=upper),),
        dtype="float64",
    )
    (heat_rate,) = entries(compile_scene(scene)).values()
    area = 0.03 * 0.04 + 0.05 * (0.03 + 0.04)
    exact = 0.8 * 5.670374419e-8 * area * (250.0**4 - 400.0**4)
    assert heat_rate == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (
            (
                jt.Surroundings(280.0, on=UPPER),
                jt.Surroundings(290.0, on=jt.Everything()),
            ),
            "both count the emission of a piece of body 0's surface: keep their `on`",
        ),
        (
            (jt.Surroundings(280.0, on=UPPER), jt.RadiativeExchange(290.0)),
            "would count the emission twice",
        ),
        (
            (
                jt.RadiativeExchange(280.0, on=UPPER),
                jt.RadiativeExchange(1.0, on=~UPPER),
            ),
            "two RadiativeExchange would not see",
        ),
    ],
)
def test_no_surface_emits_twice(terms, message):
    with pytest.raises(jt.InputError, match=message):
        compile_scene(jt.Scene((body(),), terms))


@pytest.mark.slow
def test_what_takes_no_part_in_the_exchange_reflects():
    """In a reflecting room a body receives what it emits, whatever is outside."""
    around = jt.voxelize(room(0.06, 0.08), 0.01)
    ball = jt.voxelize(jt.shapes.box((0.02, 0.02, 0.02)), 0.01)
    surface = whole(surface_of(ball), surface_of(around, body=1))
    # The ball at 400 K in a room of 250 K.
    kelvin = np.repeat([400.0, 250.0], surface.counts)
    alone = replace(EXCHANGE, on=jt.Everything(0))
    with_room, only = (_received(term, surface, kelvin) for term in (EXCHANGE, alone))
    assert with_room[0] < -1.0 and with_room[1] > 0.0
    assert only[1] == 0.0
    # A perfect mirror is replaced by an absorptivity of 1e-6.
    assert abs(only[0]) < 1e-4 * abs(with_room[0])


def _received(term, surface, kelvin) -> list[float]:
    """Heat that each body receives by the exchange [W]."""
    (binding, *_) = term.bind(surface)
    net = term.enclosure(surface)[0].net(jnp.zeros(()), jnp.asarray(kelvin - 300.0))
    heat = surface.apart(binding.effective_area * np.asarray(net))
    return [float(rates.sum()) for rates in heat]


PLATE = jt.voxelize(jt.shapes.box((0.02, 0.06, 0.06)), 0.02)
EXCHANGE = jt.RadiativeExchange(300.0, max_patches=6, directions=16)


def _facing(term, material=METAL, dtype: Dtype = "float64"):
    bodies = (
        body(kelvin=300.0, material=material, grid=PLATE),
        body(x=0.06, kelvin=300.0, grid=PLATE),
    )
    return jt.Scene(bodies, (EXCHANGE, term), dtype=dtype)


HOT = jt.FixedTemperature(600.0, on=jt.Everything(0))


@pytest.mark.slow
@pytest.mark.slice
def test_a_surface_of_fixed_temperature_radiates_like_any_other():
    """As the enclosure says between surfaces of 600 K and 300 K."""
    # An insulator, whose nodes are 300 K colder than its surface.
    wool = jt.Material(0.05, density=100.0, specific_heat=800.0, emissivity=0.8)
    compiled = compile_scene(_facing(HOT, wool))
    rates = entries(compiled)
    enclosure = compiled.program.fine_enclosure
    assert enclosure is not None
    area = PLATE.fragment_area
    above = jnp.asarray(np.repeat([300.0, 0.0], len(area)))
    net = np.asarray(enclosure.net(jnp.zeros(()), above)).reshape(2, -1)
    exact = 0.8 * net @ area
    emitted = [rates["emission", number] for number in (0, 1)]
    # Body 1 is a metal, whose surface is at the temperature of its nodes to 1e-4.
    assert emitted == pytest.approx(exact, rel=1e-3)
    assert emitted[1] > 0
    # What keeps the temperature supplies the radiation and heats the inside, through
    # half a voxel of wool.
    supplied = rates["fixed_temperature", 0] + rates["emission", 0]
    inward = 0.05 * area.sum() / 0.01 * 300.0
    assert supplied == pytest.approx(inward, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "solver", [None, jt.BackwardEuler(dt=1.0)], ids=["", "implicit"]
)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_heat_of_a_fixed_temperature_closes(solver, dtype):
    side = jt.FixedTemperature(600.0, on=jt.Side((1.0, 0.0, 0.0)))
    run = jt.simulate(_facing(side, dtype=dtype), 20.0, solver=solver)
    for body in run.energy.bodies:
        assert np.abs(body.residual_relative).max() < (1e-5, 1e-12)[dtype == "float64"]
    held = run.energy.bodies[0].mechanisms
    assert held["fixed_temperature"][0] > -held["emission"][0] > 0
