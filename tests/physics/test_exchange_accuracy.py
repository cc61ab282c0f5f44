"""View factors as accurate as they are asked for, and a sky and a ground."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.physics.radiation.radiative_exchange import _enclosure
from jaxthermo.physics.radiation.view_factors import (
    Sampling,
    ViewFactors,
    _refine,
    refined_view_factors,
)
from jaxthermo.reference.view_factor import (
    parallel_rectangles,
    perpendicular_rectangles,
)
from jaxthermo.scene.compile.compile import compile_scene
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import single_body_scene
from tests.radiating import UPRIGHT, in_patches, moved, room, surface_of, whole
from tests.slopes import check_gradient


def side(patched, axis, sign, first=0):
    """Patches that face up or down an axis."""
    return first + np.flatnonzero(patched.patches.code % 6 == 2 * axis + (sign > 0))


# How much narrower than the room that each voxel has.
THICK = 0.125


def corner(turn: Any = UPRIGHT):
    """A floor of 1 x 1 m and a wall of 2 m on one of its edges."""
    floor = voxelize(jt.shapes.box((1.0, 1.0, THICK)), THICK)
    wall = voxelize(jt.shapes.box((THICK, 1.0, 2.0)), THICK)
    places = np.array([[0.5, 0.0, -THICK / 2], [-THICK / 2, 0.0, 1.0]]) @ turn.T
    pairs = zip((floor, wall), places, strict=True)
    return tuple(
        in_patches(g, 96, moved(x, y=y, z=z, rotation=turn)) for g, (x, y, z) in pairs
    )


def from_floor_to_wall(views, bodies):
    up = side(bodies[0], 2, 1)
    across = side(bodies[1], axis=0, sign=1, first=bodies[0].patches.count)
    return views.between[np.ix_(up, across)].sum() / views.area[up].sum()


def test_perpendicular_plates():
    """The case in which 128 directions were 8 % low."""
    bodies = corner()
    views, sampling = refined_view_factors(bodies, 0.01)
    exact = perpendicular_rectangles(1.0, 2.0, 1.0)
    assert exact == pytest.approx(0.2329, abs=5e-5)
    factor = from_floor_to_wall(views, bodies)
    assert factor == pytest.approx(exact, rel=0.01)
    assert sampling.error <= 0.01 and sampling.directions <= 4096


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_the_estimate_holds_however_plates_are_turned(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    bodies = corner(turn * np.linalg.det(turn))
    views, sampling = refined_view_factors(bodies, 0.01)
    exact = perpendicular_rectangles(1.0, 2.0, 1.0)
    error = from_floor_to_wall(views, bodies) / exact - 1
    # The estimate bounds the error itself: no factor of safety is missing.
    assert abs(error) <= sampling.error <= 0.01
    assert sampling.directions < 4096


@pytest.mark.slow
def test_the_walls_of_a_closed_room():
    """One concave body alone: parallel and perpendicular squares, and nothing else."""
    body = in_patches(voxelize(room(1.0, 1.4), 0.1), 200)
    views, sampling = refined_view_factors((body,), 0.01)
    inside = np.abs(body.patches.centre).max(1) < 0.6
    assert views.outside[inside].sum() == 0.0
    walls = {s: side(body, *s) for s in ((0, 1), (0, -1), (2, 1))}
    inner = {s: which[inside[which]] for s, which in walls.items()}

    def total(a, b):
        return views.between[np.ix_(inner[a], inner[b])].sum()

    across = total((0, 1), (0, -1))
    adjacent = total((0, 1), (2, 1))
    assert across == pytest.approx(parallel_rectangles(1.0, 1.0, 1.0), rel=0.01)
    exact = perpendicular_rectangles(1.0, 1.0, 1.0)
    assert adjacent == pytest.approx(exact, rel=0.01)


def wobble(count):
    """A sample whose error falls as 1 / count."""
    return np.array([1.0 + 4.0 / count * np.sin(count)])


def change(coarse, fine):
    return float(np.abs(coarse - fine).max())


def test_doubling_ends_where_the_estimate_holds():
    for error in (0.1, 0.01, 0.001):
        mean, count, estimate = _refine(
            wobble, difference=change, error=error, max_directions=2**20
        )
        assert estimate <= error and abs(float(mean[0]) - 1) <= error
        coarser = _refine(
            wobble, difference=change, error=error, max_directions=count // 2
        )
        assert coarser[2] > error or count == 128


def test_doubling_ends_at_its_limit():
    noise = np.random.default_rng(0)
    mean, count, estimate = _refine(
        lambda n: noise.normal(size=1),
        difference=change,
        error=1e-6,
        max_directions=1000,
    )
    assert count == 512 and estimate > 1e-6 and np.isfinite(mean).all()


def test_nothing_to_refine_ends_at_once():
    assert _refine(
        lambda n: np.ones(3), difference=change, error=0.01, max_directions=4096
    )[1:] == (32, 0.0)


def test_notes_for_the_receipt():
    assert Sampling(512, 0.00617, 0.01).note == (
        "view factors from 512 directions, with an estimated error of 0.62 %"
    )
    assert Sampling(4096, 0.0231, 0.01).note == (
        "view factors from 4096 directions, with an estimated error of 2.3 %, more "
        "than the 1 % asked for: give more `max_directions`"
    )
    assert Sampling(64, np.nan, 0.01).note.endswith(
        "as given; their error is not estimated"
    )


CUBE = jt.voxelize(jt.shapes.box((0.2, 0.2, 0.2)), 0.1)
METAL = jt.Material(20.0, density=2000.0, specific_heat=500.0, emissivity=0.8)


def test_the_receipt_has_the_estimate():
    """A convex body alone needs no more than the first directions."""
    scene = single_body_scene(
        CUBE, METAL, 300.0, jt.RadiativeExchange(290.0, max_patches=6), dtype="float32"
    )
    notes = compile_scene(scene).receipt.notes
    (note,) = [note for note in notes if note.startswith("emission")]
    assert note.startswith("emission: view factors of 6 patches, whose sampled rows ")
    assert "from 32 directions, with an " in note
    assert "estimated error of" in note


def two_cubes(**options):
    surface = whole(surface_of(CUBE), surface_of(CUBE, moved(0.25, 0.0, 0.0), body=1))
    return jt.RadiativeExchange(290.0, max_patches=6, **options).enclosure(surface)[1]


def test_directions_may_be_given():
    assert "from 8 directions, as given" in two_cubes(directions=8).note


@pytest.mark.slow
def test_directions_are_limited():
    short = two_cubes(error=1e-5, max_directions=128)
    assert short.directions == 128 and short.error > 1e-5
    assert "from 128 directions" in short.note
    assert "give more `max_directions`" in short.note
    enough = two_cubes()
    assert 0 < enough.error <= 0.01


def net_flux(term, *surfaces, theta=0.0):
    """Net heat flux into fragments at 300 K + theta [W/m^2]."""
    surface = whole(*surfaces)
    enclosure, _ = term.enclosure(surface)
    cell_theta = jnp.full(sum(surface.counts), theta)
    return np.asarray(enclosure.net(jnp.asarray(0.0), cell_theta))


def test_a_convex_body_between_sky_and_ground():
    """(1 + n_z) / 2 and (1 - n_z) / 2, averaged over each patch."""
    ball = jt.voxelize(jt.shapes.sphere(0.1, 2), 0.025)
    surface = surface_of(ball, emissivity=0.5)
    term = jt.RadiativeExchange(250.0, ground=350.0)
    enclosure, _ = term.enclosure(whole(surface))
    patch = np.asarray(enclosure.patch)
    area = ball.fragment_area
    up = np.bincount(patch, area * (1 + ball.fragment_normal[:, 2]) / 2)
    up /= np.bincount(patch, area)
    assert_allclose(enclosure.from_surroundings, up, rtol=1e-9)
    ground = np.asarray(enclosure.from_ground)
    assert_allclose(ground, 1 - up, rtol=1e-9, atol=1e-12)
    exact = STEFAN_BOLTZMANN * (up * 250.0**4 + (1 - up) * 350.0**4 - 300.0**4)
    assert_allclose(net_flux(term, surface), exact[patch], rtol=1e-7)


def test_one_temperature_everywhere_is_at_rest():
    lower = surface_of(CUBE)
    upper = surface_of(CUBE, moved(0.0, 0.0, 0.25), body=1)
    same = jt.RadiativeExchange(300.0, ground=300.0, max_patches=24, directions=8)
    assert np.abs(net_flux(same, lower, upper)).max() < 1e-9
    plain = jt.RadiativeExchange(280.0, max_patches=24, directions=8)
    split = jt.RadiativeExchange(280.0, ground=280.0, max_patches=24, directions=8)
    assert_allclose(
        net_flux(split, lower, upper), net_flux(plain, lower, upper), rtol=1e-10
    )


@pytest.mark.slow
def test_a_roof_hides_the_sky_and_a_floor_the_ground():
    """Of two cubes above each other the facing sides see half of what is left."""
    low = surface_of(CUBE)
    high = surface_of(CUBE, moved(0.0, 0.0, 0.3), body=1)
    term = jt.RadiativeExchange(0.0, ground=300.0, max_patches=24, directions=32)
    enclosure, _ = term.enclosure(whole(low, high))
    sky = np.asarray(enclosure.from_surroundings)[np.asarray(enclosure.patch)]
    ground = np.asarray(enclosure.from_ground)[np.asarray(enclosure.patch)]
    normal = np.concatenate([low.normal, high.normal])[:, 2]
    of_low = np.arange(len(normal)) < len(low.area)
    top = of_low & (normal > 0.9)
    bottom = ~of_low & (normal < -0.9)
    factor = parallel_rectangles(0.2, 0.2, 0.1)
    # Reflection between both adds a little of the other half.
    assert sky[top].mean() == pytest.approx((1 - factor), abs=0.1 * factor)
    assert ground[bottom].mean() == pytest.approx((1 - factor), abs=0.1 * factor)
    assert sky[bottom].mean() < 0.2 * factor and ground[top].mean() < 0.2 * factor


def test_gradients_by_sky_and_ground():
    area = np.ones(2)
    factor = np.array([[0.0, 0.3], [0.3, 0.0]])
    visible = np.array([[0.9, 0.5], [0.4, 1.0]])
    views = ViewFactors(
        area=area,
        between=csr_array(factor),
        outside=area - factor.sum(1),
        visible=visible,
    )

    def heat(temperatures):
        sky, ground = temperatures
        enclosure = _enclosure(
            views,
            patch=np.arange(2),
            area=area,
            emissivity=np.array([0.8, 0.6]),
            upward=np.array([0.5, -0.2]),
            ground=ground,
            base=jnp.asarray(300.0),
            temperature=sky,
            above=jnp.asarray(0.0),
        )
        return enclosure.net(jnp.asarray(0.0), jnp.array([10.0, -5.0])) @ np.ones(2)

    at = np.array([260.0, 310.0])
    _, slopes = check_gradient(heat, at, step=1e-2, rtol=1e-6)(at)
    assert float(slopes[0]) > 0 and float(slopes[1]) > 0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"error": 0.0}, "error=0.0"),
        ({"error": 1.0}, "error=1.0"),
        ({"max_directions": 64}, "max_directions=64"),
        ({"ground": -1.0}, r"ground \[K\]"),
    ],
)
def test_what_is_out_of_range_is_refused(options, told):
    with pytest.raises(jt.InputError, match=told):
        jt.RadiativeExchange(290.0, **options)
