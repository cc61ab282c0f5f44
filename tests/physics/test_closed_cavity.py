"""Closed cavities: nothing from outside acts in them, unless it is asked for."""

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.scene.compile.compile import compile_scene
from tests.bodies import body_at
from tests.radiating import room, shell, surface_of, whole


METAL = jt.Material(20.0, density=2000.0, specific_heat=500.0, emissivity=0.8)
GRID = jt.voxelize(shell(0.06, 0.1, 2), 0.02)
INNER = GRID.fragment_cavity > 0
FROM_OUTSIDE = {
    "convection": jt.Convection(10.0, 290.0),
    "wind": jt.Wind((2.0, 0.0, 0.0), 290.0),
    "free_convection": jt.FreeConvection(290.0),
    "surroundings": jt.Surroundings(290.0),
    "sky and ground": jt.Surroundings(250.0, ground=290.0),
    "sun": jt.Sun((-1.0, 0.2, -0.3), 800.0),
}
EVERYWHERE = {
    "flux": jt.HeatFlux(100.0),
    "temperature": jt.FixedTemperature(300.0),
    "exchange": jt.RadiativeExchange(290.0, max_patches=24, directions=16),
    "named": jt.Convection(10.0, 290.0, on=jt.FragmentMask(INNER)),
}


def compiled(term, inside="closed", **options):
    body = body_at(GRID, METAL, 320.0, inside=inside)
    return compile_scene(jt.Scene((body,), (term,), dtype="float64"), **options)


def acts_on(term):
    """Fragments with an effective area other than 0."""
    terms = compiled(term).programs[0].fragment_terms
    bound_terms = (*terms.natural, *terms.prescribed)
    acting = [np.asarray(bound.effective_area) > 0 for _, bound in bound_terms]
    return np.any(acting, axis=0)


# A scene has one surroundings.
TOGETHER = tuple(name for name in FROM_OUTSIDE if name != "surroundings")


@functools.cache
def acting(names, inside):
    """Fragments on which each term acts, of some in one scene."""
    body = body_at(GRID, METAL, 320.0, inside=inside)
    terms = tuple(FROM_OUTSIDE[name] for name in names)
    scene = jt.Scene((body,), terms, dtype="float64")
    where = np.zeros((len(names), len(INNER)), bool)
    for n, bound in compile_scene(scene).programs[0].fragment_terms.natural:
        where[n] |= np.asarray(bound.effective_area) > 0
    return dict(zip(names, where, strict=True))


def from_outside(name, inside):
    names = TOGETHER if name in TOGETHER else (name,)
    return acting(names, inside)[name]


@pytest.mark.parametrize("name", FROM_OUTSIDE)
def test_from_outside_nothing_acts_inside(name):
    where = from_outside(name, "closed")
    assert not where[INNER].any()
    lit = where[~INNER]
    assert lit.any() if name == "sun" else lit.all()


@pytest.mark.parametrize("name", sorted(set(FROM_OUTSIDE) - {"sun"}))
def test_an_open_inside_is_like_the_outside(name):
    assert from_outside(name, "open").all()


def test_shadows_keep_the_sun_out_in_any_case():
    opened, closed = (from_outside("sun", inside) for inside in ("open", "closed"))
    assert_array_equal(opened, closed)


@pytest.mark.parametrize("name", EVERYWHERE)
def test_what_is_on_the_surface_itself_acts_inside_too(name):
    where = acts_on(EVERYWHERE[name])
    assert_array_equal(where, INNER if name == "named" else True)


def test_a_lamp_inside_lights_it():
    lamp = jt.PointSource((0.01, 0.0, 0.02), 5.0)
    assert_array_equal(acts_on(lamp), INNER)


def told(receipt):
    return [note for note in receipt.notes if "cavities" in note]


def test_the_receipt_says_so():
    receipt = compiled(FROM_OUTSIDE["convection"]).receipt
    area = GRID.fragment_area
    (surface_part,) = receipt.parts
    assert surface_part.area == pytest.approx(area[~INNER].sum())
    (note,) = told(receipt)
    assert note == (
        f"{100 * area[INNER].sum() / area.sum():.3g} % of the surface of body 0 faces "
        "closed cavities: air, sun and surroundings act there only with `inside: open`"
    )
    assert told(compiled(FROM_OUTSIDE["convection"], "open").receipt) == []
    assert told(compiled(EVERYWHERE["flux"]).receipt) == []


def test_heat_leaves_through_the_outside_only():
    """Newton's law on the area of the outer sphere."""
    terms = compiled(FROM_OUTSIDE["convection"]).programs[0].fragment_terms
    ((_, bound),) = terms.natural
    flux = np.asarray(bound.law.flux(jnp.asarray(0.0), jnp.zeros(len(INNER))))
    heat = (np.asarray(bound.effective_area) * flux).sum()
    assert heat == pytest.approx(-10.0 * 30.0 * 4 * np.pi * 0.1**2, rel=0.02)


@pytest.mark.slow
def test_a_body_in_the_cavity_of_another_is_enclosed():
    ball = jt.voxelize(jt.shapes.sphere(0.03, 2), 0.01)
    for inside, distance in (("closed", 1.01), ("open", 1.01), ("closed", 1.5)):
        bodies = (
            body_at(ball, METAL, 300.0, at=(distance, 0.0, 0.0)),
            body_at(GRID, METAL, 320.0, at=(1.0, 0.0, 0.0), inside=inside),
        )
        terms = (FROM_OUTSIDE["convection"],)
        receipt = compile_scene(jt.Scene(bodies, terms)).receipt
        reached = {surface_part.bodies[0] for surface_part in receipt.parts}
        shut = inside == "closed" and distance == 1.01
        assert reached == ({1} if shut else {0, 1})
        if shut:
            assert "convection on body 0" in [o.what for o in receipt.left_out]
            assert any("closed cavity" in o.why for o in receipt.left_out)


def walls(outer):
    """A room of 4 cm, by its outer edge."""
    return jt.voxelize(room(0.04, outer), 0.01)


def in_a_room(around, position, *terms):
    """Receipt of a cube of 3 cm in a room."""
    box = jt.voxelize(jt.shapes.box((0.03, 0.03, 0.03)), 0.01)
    bodies = tuple(
        body_at(grid, METAL, 300.0, at=place)
        for grid, place in ((box, position), (around, (0.0, 0.0, 0.0)))
    )
    return compile_scene(jt.Scene(bodies, terms)).receipt


@pytest.mark.parametrize("gap", [0.005, 0.0099])
def test_a_body_close_to_the_walls_is_enclosed(gap):
    """Half a voxel or less from the wall, on which its next voxel then lies."""
    position = (0.005 - gap, 0.0, 0.0)
    receipt = in_a_room(walls(0.06), position, FROM_OUTSIDE["convection"])
    assert {surface_part.bodies[0] for surface_part in receipt.parts} == {1}
    assert receipt.warnings == ()


@pytest.mark.parametrize(
    "term",
    [
        FROM_OUTSIDE["convection"],
        pytest.param(EVERYWHERE["exchange"], marks=pytest.mark.slow),
    ],
)
def test_cavities_that_are_open_in_the_voxels_are_told(term):
    """Walls of half a voxel."""
    around = walls(0.05)
    assert around.opened_area == pytest.approx(6 * 0.04**2)
    warnings = in_a_room(around, (0.0, 0.0, 0.0), term).warnings
    (line,) = [line for line in warnings if "cavities" in line]
    assert line == (
        "39 % of the surface of body 1 faces cavities that are closed in its mesh "
        "and open in its voxels: walls thinner than a voxel let air and radiation "
        "through; use a finer pitch"
    )
    assert walls(0.06).opened_area == 0.0


@pytest.mark.slow
def test_what_does_not_come_from_outside_needs_no_warning_of_cavities():
    receipt = in_a_room(walls(0.05), (0.0, 0.0, 0.0), EVERYWHERE["flux"])
    (line,) = receipt.warnings
    assert "the mesh has 2.4 times the volume of its voxels" in line
    assert "cavities" not in line


@pytest.mark.parametrize(
    "max_patches", [6, pytest.param(60, marks=pytest.mark.slow), 200]
)
def test_radiation_crosses_a_cavity(max_patches):
    """Black parts of a hollow ball, above and below: A_1 A_2 / (A_1 + A_2)."""
    black = surface_of(GRID, emissivity=1.0)
    exchange = jt.RadiativeExchange(0.0, max_patches=max_patches, directions=32)
    enclosure, _ = exchange.enclosure(whole(black))
    # Hot above and cold below, inside and, the other way round, outside.
    hot = (GRID.fragment_position[:, 2] > 0) == INNER
    net = np.asarray(enclosure.net(jnp.asarray(0.0), jnp.where(hot, 100.0, 0.0)))
    heat = net * GRID.fragment_area
    assert heat[INNER].sum() == pytest.approx(0.0, abs=1e-12 * np.abs(heat).sum())
    # In a sphere each piece sees another with its fraction of the whole area.
    above, below = (GRID.fragment_area[INNER & s].sum() for s in (hot, ~hot))
    mutual = above * below / (above + below)
    exact = STEFAN_BOLTZMANN * (400.0**4 - 300.0**4) * mutual
    if max_patches > 6:
        assert heat[INNER & ~hot].sum() == pytest.approx(exact, rel=0.02)
    emitted = STEFAN_BOLTZMANN * np.where(hot, 400.0, 300.0) ** 4
    assert_allclose(net[~INNER], -emitted[~INNER], rtol=1e-9)


def test_anything_else_is_refused():
    with pytest.raises(jt.InputError, match="inside='ajar'"):
        jt.Body(jt.FullVolume(GRID), METAL, temperature=300.0, inside="ajar")  # type: ignore
