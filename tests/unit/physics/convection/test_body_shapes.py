"""Plates and spheres in still air and in wind, by the laws of the handbooks."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from wind_bodies import flux_at, law_of, upright_cylinder

from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Pose
from jaxthermo.physics.convection.air import conductivity, kinematic_viscosity, prandtl
from jaxthermo.physics.convection.free_convection import FreeConvection
from jaxthermo.physics.convection.wind import Wind
from jaxthermo.physics.surface import Binding
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import surface_of, whole


AIR = 300.0
SIDE = 0.5
DIAMETER = 0.1


@functools.cache
def plate(side=SIDE):
    return voxelize(shapes.box((side, side, side / 50)), side / 50)


@functools.cache
def ball():
    return voxelize(shapes.sphere(DIAMETER / 2), DIAMETER / 10)


def tilted(degrees):
    """Turned about x, by whole degrees from lying."""
    cosine = float(np.cos(np.radians(degrees)))
    sine = float(np.sin(np.radians(degrees)))
    return Pose(
        (0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine))
    )


def coefficients(term, grid, temperature, degrees=0.0):
    """The heat transfer coefficient of every fragment."""
    flux = flux_at(law_of(term, surface_of(grid, tilted(degrees))), temperature)
    return flux / (AIR - temperature)


def faces(grid, h):
    """Means of the two faces, of which the first looks up where the plate lies."""
    z = grid.fragment_normal[:, 2]
    return h[z > 0.9].mean(), h[z < -0.9].mean()


def film(temperature):
    kelvin = jnp.asarray((temperature + AIR) / 2)
    nu = float(kinematic_viscosity(kelvin))
    return nu, float(conductivity(kelvin)), float(prandtl(kelvin))


def rayleigh(temperature, length):
    nu, _, pr = film(temperature)
    kelvin = (temperature + AIR) / 2
    return 9.80665 * abs(temperature - AIR) / kelvin * length**3 * pr / nu**2


def upright_number(ra, pr):
    return (
        0.825 + 0.387 * ra ** (1 / 6) / (1 + (0.492 / pr) ** (9 / 16)) ** (8 / 27)
    ) ** 2


@pytest.mark.parametrize("side", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("temperature", [340.0, 270.0])
def test_a_lying_plate_has_mcadams_numbers(side, temperature):
    """Ra 4e4, 5e6 and 3e8: both ranges; a cold plate is a warm one upside down."""
    length = side / 4
    ra = rayleigh(temperature, length)
    _, k, _ = film(temperature)
    up = 0.54 * ra**0.25 if ra < 1e7 else 0.15 * ra ** (1 / 3)
    expected = np.array([up, 0.27 * ra**0.25]) * k / length
    h = faces(plate(side), coefficients(FreeConvection(AIR), plate(side), temperature))
    # The limit of conduction adds 1.4 % to the smallest of the numbers, 5.4.
    assert_allclose(h, expected if temperature > AIR else expected[::-1], rtol=1.5e-2)


@pytest.mark.parametrize("temperature", [340.0, 270.0])
def test_an_upright_plate_has_churchill_and_chus_number(temperature):
    """On both faces, with its height; about 0.93 of a horizontal cylinder's."""
    _, k, pr = film(temperature)
    expected = upright_number(rayleigh(temperature, SIDE), pr) * k / SIDE
    h = coefficients(FreeConvection(AIR), plate(), temperature, degrees=90)
    assert_allclose(faces(plate(), h), [expected, expected], rtol=2e-3)


def test_nothing_jumps_over_the_tilt():
    """All sides, warm and cold, within 8 % of the largest of the laws by components."""
    angles = np.arange(0, 181, 3)
    for temperature in (340.0, 270.0):
        h = np.stack(
            [
                coefficients(
                    FreeConvection(AIR), plate(), temperature, degrees=float(angle)
                )
                for angle in angles
            ]
        )
        steps = np.abs(np.diff(np.log(h), axis=0)).max()
        assert steps < 0.12
        sides = np.array([faces(plate(), row) for row in h])
        # Turned by half a turn, the two faces change places.
        assert_allclose(sides[:, 0], sides[::-1, 1], rtol=1e-6)
    _, k, pr = film(temperature)
    cosine = np.cos(np.radians(angles))
    lying = 0.25 * SIDE
    across = rayleigh(temperature, lying) * np.abs(cosine)
    along = rayleigh(temperature, SIDE) * np.sqrt(1 - cosine**2)
    upright = upright_number(along, pr) * k / SIDE
    # Of the colder plate, the face that looks down has the number of a warm side up.
    number = np.where(cosine < 0, 0.54 * across**0.25, 0.27 * across**0.25)
    expected = np.maximum(number * k / lying, upright)
    assert np.abs(sides[:, 0] / expected - 1).max() < 0.08


def test_a_cylinder_does_not_jump_at_45_degrees():
    """And has the numbers of an upright or a lying one up to 5 degrees from there."""
    grid = upright_cylinder()
    term = FreeConvection(AIR)
    h = [coefficients(term, grid, 340.0, degrees=a)[0] for a in range(91)]
    assert np.abs(np.diff(np.log(h))).max() < 0.02
    assert_allclose(h[:40], h[0], rtol=1e-12)
    assert_allclose(h[51:], h[-1], rtol=1e-12)
    assert h[0] != h[-1]


@pytest.mark.parametrize("temperature", [350.0, 270.0])
def test_a_sphere_has_churchills_number(temperature):
    _, k, pr = film(temperature)
    rising = 0.589 * rayleigh(temperature, DIAMETER) ** 0.25
    number = 2 + rising / (1 + (0.469 / pr) ** (9 / 16)) ** (4 / 9)
    h = coefficients(FreeConvection(AIR), ball(), temperature)
    assert_allclose(h, number * k / DIAMETER, rtol=3e-3)


@pytest.mark.parametrize("make", [plate, ball])
def test_gradients_are_finite_without_a_difference(make):
    seen = surface_of(make(), tilted(30))

    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1))
    def heat(air, theta):
        law = law_of(FreeConvection(air), seen)
        return law.flux(jnp.zeros(()), jnp.full(len(seen.area), theta)).mean()

    value, slopes = heat(jnp.array(300.0), jnp.array(0.0))
    assert float(value) == 0.0
    assert float(slopes[0]) == pytest.approx(-float(slopes[1])) and slopes[0] > 0
    step = 1e-4
    higher, _ = heat(jnp.array(300.0), jnp.array(40.0 + step))
    lower, _ = heat(jnp.array(300.0), jnp.array(40.0 - step))
    _, slopes = heat(jnp.array(300.0), jnp.array(40.0))
    assert float(slopes[1]) == pytest.approx(
        float(higher - lower) / (2 * step), rel=1e-5
    )


def test_cells_of_several_sides_have_the_heat_of_all():
    """A lying plate of one voxel: its upper and lower side are one cell."""
    grid = plate()
    area = grid.fragment_area
    law = law_of(FreeConvection(AIR), surface_of(grid))
    whole_heat = (flux_at(law, 340.0) * area).sum()
    coarse = law.coarsened(lambda values: np.average(values, weights=area)[None])
    assert float(flux_at(coarse, 340.0)[0] * area.sum()) == pytest.approx(
        whole_heat, rel=1e-2
    )


@pytest.mark.parametrize(("speed", "length"), [(2.0, 0.5), (6.0, 0.5), (60.0, 0.5)])
def test_a_plate_along_the_wind_has_the_boundary_layers_number(speed, length):
    """Laminar and turbulent, on both faces."""
    nu, k, pr = film(AIR + 0.2)
    re = speed * length / nu
    number = 0.664 * re**0.5 if re < 5e5 else 0.037 * re**0.8 - 871
    expected = number * pr ** (1 / 3) * k / length
    h = coefficients(Wind((speed, 0.0, 0.0), AIR), plate(), AIR + 0.2)
    assert_allclose(faces(plate(), h), [expected, expected], rtol=3e-3)


def test_a_plate_across_the_wind_has_a_windward_and_a_leeward_side():
    nu, k, pr = film(AIR + 20.0)
    re = 2.0 * SIDE / nu
    per_length = pr ** (1 / 3) * k / SIDE
    expected = np.array([0.191 * re ** (2 / 3), 0.86 * re**0.5]) * per_length
    h = coefficients(Wind((0.0, 0.0, 2.0), AIR), plate(), AIR + 20.0)
    assert_allclose(faces(plate(), h), expected, rtol=3e-3)


def test_nothing_jumps_over_the_angle_of_attack():
    h = []
    for degrees in np.arange(-90, 91):
        angle = np.radians(degrees)
        wind = (3.0 * float(np.cos(angle)), 0.0, 3.0 * float(np.sin(angle)))
        h.append(coefficients(Wind(wind, AIR), plate(), AIR + 20.0))
    assert np.abs(np.diff(np.log(np.stack(h)), axis=0)).max() < 0.05


def test_a_sphere_in_wind_has_whitakers_number():
    nu, k, pr = film(AIR + 20.0)
    re = 2.0 * DIAMETER / nu
    number = 2 + (0.4 * re**0.5 + 0.06 * re ** (2 / 3)) * pr**0.4
    h = coefficients(Wind((2.0, 0.0, 0.0), AIR), ball(), AIR + 20.0)
    assert_allclose(h, number * k / DIAMETER, rtol=3e-3)


def test_gusts_over_a_plate_are_the_steady_wind_at_each_moment():
    """With finite slopes down to a wind of 0 m/s."""
    seen = surface_of(plate())

    @jax.jit
    @jax.value_and_grad
    def heat(speed):
        law = law_of(Wind((1.0, 0.0, 0.2), AIR, speed=speed), seen)
        return law.flux(jnp.zeros(()), jnp.full(len(seen.area), 20.0)).mean()

    for speed in (0.0, 1e-6, 4.0):
        value, slope = heat(jnp.array(speed))
        assert np.isfinite([float(value), float(slope)]).all() and slope < 0


def law_line(term, seen):
    (binding,) = term.bind(whole(seen))
    return binding.notes[0].lines()[0]


def test_the_receipt_has_the_law_and_its_length():
    lying = surface_of(plate())
    still = law_line(FreeConvection(AIR), lying)
    assert "a plate 0.01 m thick" in still and "A / P = 0.125 m (McAdams)" in still
    assert "laminar flow along it with L = 0.5 m" in law_line(
        Wind((1, 0, 0), AIR), lying
    )
    round_body = surface_of(ball())
    assert "a sphere with L = 0.1 m" in law_line(FreeConvection(AIR), round_body)
    assert "a sphere: Whitaker with L = 0.1 m" in law_line(
        Wind((1, 0, 0), AIR), round_body
    )
    rod = surface_of(upright_cylinder())
    assert "1 upright with L = 0.1 m" in law_line(FreeConvection(AIR), rod)


def test_the_shape_and_the_length_may_be_given():
    as_rod = coefficients(FreeConvection(AIR, body_shape="cylinder"), plate(), 340.0)
    as_plate = coefficients(FreeConvection(AIR), plate(), 340.0)
    assert np.ptp(as_rod) == 0 and np.ptp(as_plate) > 2
    _, k, _ = film(340.0)
    longer = coefficients(FreeConvection(AIR, length=0.2), plate(), 340.0)
    down = 0.27 * rayleigh(340.0, 0.2) ** 0.25 * k / 0.2
    assert faces(plate(), longer)[1] == pytest.approx(down, rel=3e-3)
    cubic = Wind((2.0, 0.0, 0.0), AIR, body_shape="sphere")
    assert np.ptp(coefficients(cubic, plate(), 340.0)) < 1e-9


def test_bodies_of_several_shapes_keep_their_laws():
    """One binding for each law, and every fragment in one of them."""
    bodies = [surface_of(grid, body=n) for n, grid in enumerate((plate(), ball()))]
    results = FreeConvection(AIR).bind(whole(*bodies))
    bindings = [binding for binding in results if isinstance(binding, Binding)]
    assert len(bindings) == len(results) == 2
    acting = np.stack([binding.acting for binding in bindings])
    assert (acting.sum(axis=0) == 1).all()
    count = len(bodies[0].area)
    h = [flux_at(binding.law, 340.0) / -40 for binding in bindings]
    alone = [coefficients(FreeConvection(AIR), g, 340.0) for g in (plate(), ball())]
    assert_allclose(h[0][:count], alone[0], rtol=1e-12)
    assert_allclose(h[1][count:], alone[1], rtol=1e-12)


def test_a_bad_shape_is_refused():
    wrong: Any = "disc"
    with pytest.raises(InputError, match="FreeConvection.body_shape='disc'"):
        FreeConvection(AIR, body_shape=wrong)
    with pytest.raises(InputError, match="Wind.body_shape='disc'"):
        Wind((1.0, 0.0, 0.0), AIR, body_shape=wrong)
