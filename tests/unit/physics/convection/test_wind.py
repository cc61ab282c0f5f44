"""Wind on a body: local coefficients, speeds, wakes, and invalid input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from wind_bodies import (
    DIAMETER,
    behind,
    flux_at,
    law_of,
    upright_cylinder,
)

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.geometry.mesh import Pose
from jaxthermo.physics.convection.air import kinematic_viscosity
from jaxthermo.physics.convection.cross_flow import _mean_coefficient, local_nusselt
from jaxthermo.physics.convection.film import FilmExchange, _SpeedTable
from jaxthermo.physics.convection.nusselt import churchill_bernstein
from jaxthermo.physics.convection.wake import WakeDeficit
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.surface import Omitted
from jaxthermo.voxels.cylinders import Cylinder, parts_of
from tests.radiating import surface_of, whole
from tests.slopes import check_gradient


ALONG_X = (1.0, 0.0, 0.0)
AIR = 300.0


@pytest.fixture(scope="module")
def grid():
    return upright_cylinder()


@pytest.fixture(scope="module")
def seen(grid):
    return surface_of(grid)


def coefficients(term, seen, temperature=AIR + 20.0, time=0.0):
    """The heat transfer coefficient of every fragment."""
    flux = flux_at(law_of(term, seen), temperature, time)
    return flux / (AIR - temperature)


def side_of(grid):
    return np.abs(grid.fragment_normal[:, 2]) < 0.5


@pytest.mark.parametrize("speed", [0.05, 1.0, 10.0])
def test_the_mean_over_the_side_is_that_of_the_correlation(grid, seen, speed):
    """Within the fragments' quadrature around it, 20 voxels across."""
    diameter = _diameter(seen)
    film = jnp.array(AIR + 10.0)
    expected = _mean_coefficient(
        jnp.array(speed),
        diameter=jnp.array(diameter),
        film=film,
        average=churchill_bernstein,
    )
    h = coefficients(Wind((speed, 0, 0), AIR), seen)
    side = side_of(grid)
    mean = np.average(h[side], weights=grid.fragment_area[side])
    assert mean == pytest.approx(float(expected), rel=2e-2)
    assert_allclose(h[~side], float(expected), rtol=1e-3)


def _diameter(seen):
    """Diameter of the cylinder that is detected."""
    (only,) = parts_of(seen.grid, (), 0).cylinders
    return only.diameter


def test_every_fragment_has_the_local_number_of_its_angle(grid, seen):
    speed = 2.0
    h = coefficients(Wind((speed, 0, 0), AIR), seen, 300.2)
    side = side_of(grid)
    cosine = -grid.fragment_normal[side, 0]
    diameter = _diameter(seen)
    nu = float(kinematic_viscosity(jnp.array(AIR)))
    # By whole rings of equal angles, of which there are few.
    angles, ring = np.unique(np.round(cosine, 9), return_inverse=True)
    by_ring = jax.jit(
        lambda ring_cosine: local_nusselt(
            ring_cosine,
            reynolds=jnp.full(len(angles), speed * diameter / nu),
            prandtl_number=jnp.full(len(angles), 0.7071),
            average=churchill_bernstein,
        )
    )
    local = np.asarray(by_ring(jnp.asarray(angles)))[ring]
    assert_allclose(h[side], local * 0.02638 / diameter, rtol=2e-3)


def test_a_turned_body_feels_the_same_wind_turned_with_it(grid, seen):
    sine = 0.5
    cosine = float(np.sqrt(0.75))
    rotation = ((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0))
    turned = surface_of(grid, Pose((1.0, 2.0, 3.0), rotation))
    wind = tuple(float(v) for v in turned.pose.rotate(np.array([2.0, 0.0, 0.0])))
    assert_allclose(
        coefficients(Wind(wind, AIR), turned),
        coefficients(Wind((2.0, 0.0, 0.0), AIR), seen),
        rtol=1e-9,
    )


def test_another_average_changes_the_level_alone(seen):
    base = coefficients(Wind((5.0, 0, 0), AIR), seen)
    profile = coefficients(Wind((5.0, 0, 0), AIR, average="profile"), seen)
    assert np.ptp(profile / base) < 1e-9
    assert (profile / base).mean() > 1.1


def _heat(seen, wake, speed, air, surface_temperature):
    """Heat into the whole surface [W]."""
    law = law_of(Wind(ALONG_X, air, speed=speed, wake=wake), seen)
    theta = jnp.full(len(seen.area), surface_temperature - 300.0)
    return (law.flux(jnp.zeros(()), theta) * seen.area).sum()


def test_gradients_by_speed_and_temperatures_are_finite_and_right(seen):
    """At V = 0 too, where sqrt(Re) has no slope."""

    @jax.jit
    @jax.value_and_grad
    def value_and_slope(p):
        return _heat(seen, None, speed=p[0], air=p[1], surface_temperature=p[2])

    def value(*p):
        return float(value_and_slope(jnp.asarray(np.array(p)))[0])

    for speed in (0.0, 1e-6, 0.3, 4.0):
        slopes = value_and_slope(jnp.array([speed, AIR, 350.0]))[1]
        step = 1e-12 + 1e-6 * speed
        low = max(speed - step, 0.0)
        high = speed + step
        rises = (
            (value(high, AIR, 350.0) - value(low, AIR, 350.0)) / (high - low),
            (value(speed, AIR + 1e-3, 350.0) - value(speed, AIR - 1e-3, 350.0)) / 2e-3,
            (value(speed, AIR, 350.001) - value(speed, AIR, 349.999)) / 2e-3,
        )
        assert_allclose(slopes, rises, rtol=2e-3)


def test_a_gusty_wind_is_the_steady_one_at_each_moment(seen):
    gusts = jt.Table([0.0, 10.0], [0.0, 10.0])
    law = law_of(Wind(ALONG_X, AIR, speed=gusts), seen)
    assert isinstance(law, FilmExchange) and isinstance(law.coefficients, _SpeedTable)
    for speed in (0.3, 1.0, 3.7, 10.0):
        steady = flux_at(law_of(Wind((speed, 0, 0), AIR), seen), 320.0)
        gusty = flux_at(law, 320.0, time=speed)
        assert_allclose(gusty, steady, rtol=3e-3)
        assert gusty.sum() == pytest.approx(steady.sum(), rel=1e-4)


def test_a_plain_function_may_be_the_speed_or_the_temperature(seen):
    by_function = Wind(ALONG_X, lambda t: AIR + 0 * t, speed=lambda t: 2.0 + 0 * t)
    steady = coefficients(Wind((2.0, 0, 0), AIR), seen)
    assert_allclose(coefficients(by_function, seen), steady, rtol=2e-3)


def test_the_air_may_warm_up(seen):
    wind = Wind((2.0, 0, 0), jt.Table([0.0, 100.0], [AIR, AIR + 50.0]))
    law = law_of(wind, seen)
    assert not flux_at(law, AIR + 50.0, time=100.0).any()
    assert (flux_at(law, AIR, time=50.0) > 0).all()


def test_still_air_is_left_out(seen):
    for wind in (
        Wind((0.0, 0.0, 0.0), AIR),
        Wind(ALONG_X, AIR, speed=0.0),
        Wind(ALONG_X, AIR, speed=jt.Table([0.0, 1.0], [0.0, 0.0])),
    ):
        assert wind.bind(whole(seen)) == (Omitted("the air stands still"),)


def test_the_places_of_two_cylinders_go_by_their_own_diameters(grid, seen):
    """The lower half as a thin cylinder, the upper one as a thick one."""
    halves = (
        Cylinder((0.0, 0.0, -0.025), axis=(0, 0, 1), diameter=0.05, length=0.05),
        Cylinder((0.0, 0.0, 0.025), axis=(0, 0, 1), diameter=0.2, length=0.05),
    )
    h = coefficients(Wind((1.0, 0, 0), AIR, cylinders=halves), seen)
    full_height = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 0.2)
    thick = coefficients(Wind((1.0, 0, 0), AIR, cylinders=(full_height,)), seen)
    upper = grid.fragment_position[:, 2] > 0
    assert_allclose(h[upper], thick[upper], rtol=1e-12)
    assert h[~upper].mean() > 1.5 * h[upper].mean()


def test_cylinders_of_another_body_are_not_this_ones(seen):
    foreign = Cylinder((0.0, 0.0, 0.0), (1, 0, 0), 0.5, body=1)
    assert_array_equal(
        coefficients(Wind((1.0, 0, 0), AIR, cylinders=(foreign,)), seen),
        coefficients(Wind((1.0, 0, 0), AIR), seen),
    )


@pytest.fixture(scope="module")
def shaded():
    return behind(2.0)


def test_a_wake_slows_the_wind_as_its_function_says(seen, shaded):
    """A constant speed ratio is a lower speed on the whole body behind another."""
    h = coefficients(Wind((2.0, 0, 0), AIR, wake=lambda x: 0.25 + 0 * x), shaded)
    slow = coefficients(Wind((0.5, 0, 0), AIR), seen)
    assert_allclose(h, slow, rtol=1e-9)


def test_gradients_reach_the_wakes_parameters(shaded):
    def heat(length):
        return _heat(
            shaded,
            WakeDeficit(length=length),
            speed=2.0,
            air=AIR,
            surface_temperature=350.0,
        )

    value_and_slope = check_gradient(heat, 2.0, step=1e-3, rtol=1e-5)
    assert float(value_and_slope(2.0)[1]) > 0


def notes(wind, seen):
    """Remarks on validity, after the line that names the law."""
    (binding,) = wind.bind(whole(seen))
    law, *remarks = [line for note in binding.notes for line in note.lines()]
    assert law.startswith("cylinders of ")
    return tuple(remarks)


def test_notes_name_recalled_shapes_and_constant_numbers(seen):
    assert notes(Wind((2.0, 0, 0), AIR), seen) == ()
    assert "recalled" in notes(Wind((15.0, 0, 0), AIR), seen)[0]
    constant, recalled = notes(Wind((1e3, 0, 0), AIR), seen)
    assert "is constant" in constant and "recalled" in recalled
    gusts = jt.Table([0.0, 1.0], [0.0, 15.0])
    assert "recalled" in notes(Wind(ALONG_X, AIR, speed=gusts), seen)[0]
    assert notes(Wind(ALONG_X, AIR, speed=lambda t: 99.0), seen) == ()
    narrow = Wind((0.01, 0, 0), AIR, average="sanitjai_goldstein")
    assert "outside sanitjai_goldstein's range" in notes(narrow, seen)[0]


def test_a_note_names_the_reynolds_number_of_a_wake_beyond_its_fit(seen, shaded):
    """Fitted at Re 20; the object upstream is 0.1 m wide."""
    nu = float(kinematic_viscosity(jnp.asarray(AIR)))

    def wake_notes(wind):
        return [note for note in notes(wind, shaded) if "the deficit was" in note]

    def at(reynolds, wake=None):
        speed = reynolds * nu / DIAMETER
        return wake_notes(Wind(ALONG_X, AIR, speed=speed, wake=wake))

    assert at(20.0, wake=WakeDeficit()) == []
    (note,) = at(2e4, wake=WakeDeficit())
    assert "of an object at Re 2e+04, and" in note
    # The range of another function is not known, and without a wake there is no note.
    assert at(2e4, wake=lambda x: 0.5 + 0 * x) == at(2e4) == []
    headwind = Wind((-1.0, 0, 0), AIR, speed=9.0, wake=WakeDeficit())
    assert wake_notes(headwind) == []


def test_notes_are_of_the_part_that_the_wind_cools(seen):
    """Of two halves given as cylinders the thick one alone is at a high Re."""
    halves = (
        Cylinder((0.0, 0.0, -0.025), axis=(0, 0, 1), diameter=DIAMETER, length=0.05),
        Cylinder((0.0, 0.0, 0.025), axis=(0, 0, 1), diameter=9.0, length=0.05),
    )
    lower = jt.Region((-1.0, -1.0, -1.0), (1.0, 1.0, -1e-6))
    part_notes = [
        notes(Wind((2.0, 0, 0), AIR, cylinders=halves, on=on), seen)
        for on in (None, ~lower, lower)
    ]
    assert part_notes[0] == part_notes[1] != () and part_notes[2] == ()


def test_notes_are_known_while_something_else_is_traced(seen):
    storm = Wind((15.0, 0, 0), AIR)
    traced_notes = []

    def traced(x):
        traced_notes.extend(notes(storm, seen))
        return x

    jax.make_jaxpr(traced)(1.0)
    assert "recalled" in traced_notes[0]


def test_a_storm_is_held_and_finite(seen):
    storm = coefficients(Wind((1e3, 0, 0), AIR), seen)
    limit = 2.5e5 * float(kinematic_viscosity(jnp.array(AIR))) / DIAMETER
    # Well beyond: the cylinder is fitted to voxels.
    held = coefficients(Wind((1.1 * limit, 0, 0), AIR), seen)
    assert_allclose(storm, held, rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"velocity": (0, 0, 0), "speed": 2.0}, "not all zero"),
        ({"velocity": (1, 0)}, "three numbers"),
        ({"velocity": (np.nan, 0, 0)}, "three finite numbers"),
        ({"velocity": "north"}, "three numbers"),
        ({"speed": -1.0}, "at least 0"),
        ({"speed": jt.Table([0.0, 1.0], [1.0, -2.0])}, "at least 0"),
        ({"temperature": -3.0}, "at least 0"),
        ({"temperature": np.nan}, "a finite number"),
        ({"average": "zukauskas"}, "there are churchill_bernstein"),
        ({"cylinders": [3]}, "list of Cylinder"),
        ({"cylinders": 3}, "list of Cylinder"),
        ({"wake": 0.5}, "a function of x / D"),
    ],
)
def test_a_mistake_is_one_line(arguments, words):
    fields = {"velocity": ALONG_X, "temperature": AIR, **arguments}
    with pytest.raises(InputError, match=words) as raised:
        Wind(**fields)
    assert "\n" not in str(raised.value)


def test_cylinders_far_from_the_body_are_refused(seen):
    lost = Cylinder((50.0, 0.0, 0.0), axis=(0, 0, 1), diameter=0.1, length=0.1)
    with pytest.raises(InputError, match="nearest is 49.9 m away"):
        Wind(ALONG_X, AIR, cylinders=(lost,)).bind(whole(seen))


def test_a_wake_that_gives_no_share_is_refused(shaded):
    with pytest.raises(InputError, match=r"must lie in \(0, 1\]"):
        Wind(ALONG_X, AIR, wake=lambda x: -x).bind(whole(shaded))
