"""A camera sees the radiation of the heat balance: its irradiation, and no other."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN as SIGMA
from jaxthermo.image.surface.view import compute_view
from tests.bodies import body_at
from tests.imaging import apparent, at_start, block, metal, on_body, radiosity
from tests.radiating import room


def seen_radiosity(solution):
    """The same in pixels, by the radiance that `draw` gives the nearest fragment."""
    camera = jt.Camera((0.3, -0.2, 0.2), (0.02, 0.0, 0.0), width=48, height=36)
    view = compute_view(solution.surfaces, solution.terms, camera, smooth=False)
    radiance = jt.render(solution, camera, smooth=False, band=None).radiance
    weights: Any = view.weights
    return np.pi * radiance.reshape(-1)[view.pixel], weights.indices


def irradiation(solution, index=-1):
    """Thermal radiation and that of sources that reaches each fragment [W/m^2]."""
    time = solution.times[index]
    with jax.enable_x64(True):
        kelvin = jnp.asarray(solution.surface_temperature[index])
        irradiance = solution.radiation.at(time).irradiance(jnp.asarray(time), kelvin)
    return [np.asarray(irradiance.thermal), np.asarray(irradiance.sources).sum(0)]


def ball(kelvin, emissivity, pitch=0.0125):
    grid = jt.voxelize(jt.shapes.sphere(0.05), pitch)
    return jt.Body(jt.FullVolume(grid), metal(emissivity), temperature=kelvin)


BALL = ball(320.0, 0.5)
FRONT = jt.Camera((0.5, 0.0, 0.0), (0.0, 0.0, 0.0), width=40, height=40)
EXCHANGES = {
    "exchange": jt.RadiativeExchange(250.0, max_patches=60, directions=16),
    "surroundings": jt.Surroundings(250.0, ground=310.0, occlusion=32),
}
LIGHTS = (
    jt.Sun((-1.0, 0.3, -1.0), 800.0),
    jt.PointSource((0.2, 0.0, 0.1), 30.0),
    jt.AreaSource((0.0, 0.0, 0.3), (0.0, 0.0, -1.0), (0.1, 0.2), temperature=700.0),
)


# By default a block in exchange leaves what the closed form says.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["exchange", "surroundings"])
def test_power_that_leaves_the_surface_is_that_of_the_ledger(name):
    """Leaving minus arriving radiation of each body is minus the heat of its terms."""
    bodies = (
        block((0.04, 0.04, 0.04), 320.0, metal(0.3, 0.6)),
        block((0.02, 0.04, 0.06), 400.0, metal(0.8, 0.2), at=(0.05, 0.0, 0.0)),
    )
    terms = (EXCHANGES[name], *LIGHTS)
    dt = 1e-4
    solution = jt.simulate(
        jt.Scene(bodies, terms, dtype="float64"), dt, solver=jt.ForwardEuler(dt=dt)
    )
    leaving = radiosity(solution)
    seen, fragment = seen_radiosity(solution)
    assert len(set(fragment)) > 20
    assert_allclose(seen, leaving[fragment], rtol=1e-12)
    net = leaving - sum(irradiation(solution))
    first = 0
    for number, surface in enumerate(solution.surfaces):
        area = surface.geometry.fragment_area
        leaves = float(area @ net[first : first + len(area)])
        first += len(area)
        heat = solution.energy.bodies[number].mechanisms
        rates = [float(heat_over_time[-1]) / dt for heat_over_time in heat.values()]
        size = sum(map(abs, rates))
        assert size > 0.1
        assert leaves == pytest.approx(-sum(rates), abs=1e-5 * size)


# By default a block does, in exchange with sky and ground.
@pytest.mark.slow
def test_a_grey_sphere_reflects_the_surroundings_of_the_exchange():
    solution = at_start((BALL,), EXCHANGES["exchange"])
    image = jt.render(solution, FRONT, band=None)
    expected = (0.5 * (320.0**4 + 250.0**4)) ** 0.25
    assert expected == pytest.approx(291.2546, abs=1e-4)
    assert_allclose(apparent(image)[on_body(image)], expected, atol=1e-3)
    assert_allclose(apparent(image)[~on_body(image)], 250.0, atol=1e-3)


def test_a_sphere_between_sky_and_ground():
    """View factors of an unobstructed surface, (1 + n_z) / 2 and (1 - n_z) / 2."""
    sky = 250.0
    ground = 350.0
    kelvin = 290.0
    body = ball(kelvin, 0.5, pitch=0.05 / 16)
    solution = at_start((body,), jt.Surroundings(sky, ground=ground))

    def closed_form(up):
        back = (1 + up) / 2 * sky**4 + (1 - up) / 2 * ground**4
        return 0.5 * kelvin**4 + 0.5 * back

    normal = body.structure.grid.fragment_normal
    exact = SIGMA * closed_form(normal[:, 2])
    assert_allclose(radiosity(solution), exact, rtol=1e-12)
    # On the image, the normal of the sphere itself at the point that a pixel shows.
    image = jt.render(solution, FRONT, band=None)
    visible = on_body(image)
    origin, step = FRONT.rays()
    depth = np.asarray(image.depth).reshape(-1, 1)
    height = (origin + np.where(np.isinf(depth), 0, depth) * step)[:, 2]
    up = np.clip(height.reshape(visible.shape)[visible] / 0.05, -1, 1)
    error = apparent(image)[visible] - closed_form(up) ** 0.25
    assert np.sqrt((error**2).mean()) < 0.5 and np.abs(error).max() < 2.0
    # The background is the scene's: the camera looks along the horizon.
    behind = apparent(image)
    assert_allclose(behind[0, 0], sky, atol=1e-3)
    assert_allclose(behind[-1, 0], ground, atol=1e-3)


def test_a_block_in_exchange_with_sky_and_ground():
    """Sides between both, top under the sky, bottom over the ground: (1 + n_z) / 2."""
    sky = 250.0
    ground = 350.0
    kelvin = 290.0
    body = block((0.04, 0.04, 0.04), kelvin, metal(0.5))
    exchange = jt.RadiativeExchange(sky, ground=ground, max_patches=60, directions=16)
    solution = at_start((body,), exchange)
    up = body.structure.grid.fragment_normal[:, 2]
    back = (1 + up) / 2 * sky**4 + (1 - up) / 2 * ground**4
    exact = SIGMA * 0.5 * (kelvin**4 + back)
    assert_allclose(radiosity(solution), exact, rtol=1e-9)
    image = jt.render(solution, FRONT, band=None)
    side = (0.5 * kelvin**4 + 0.25 * (sky**4 + ground**4)) ** 0.25
    assert_allclose(apparent(image)[20, 20], side, atol=1e-6)
    assert_allclose(apparent(image)[0, 0], sky, atol=1e-6)
    assert_allclose(apparent(image)[-1, 0], ground, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "emissivity"),
    [
        # By default exchange crosses a cavity in test_closed_cavity.
        pytest.param("exchange", 0.3, marks=pytest.mark.slow),
        pytest.param("exchange", 1.0, marks=pytest.mark.slow),
        # They do not act in the cavity, which sees itself.
        ("open", 0.3),
    ],
)
def test_an_isothermal_enclosure_shows_its_temperature(name, emissivity):
    """Seen from inside, through its own exchange, with other surroundings outside."""
    grid = jt.voxelize(room(0.08, 0.12), 0.01)
    body = jt.Body(jt.FullVolume(grid), metal(emissivity), temperature=350.0)
    outside = {
        "exchange": (EXCHANGES["exchange"], LIGHTS[0]),
        "open": (jt.Surroundings(250.0), LIGHTS[0], jt.Convection(10.0, 280.0)),
    }
    solution = at_start((body,), *outside[name])
    inside = jt.Camera(
        (-0.03, -0.02, 0.01), (0.03, 0.01, 0.0), width=20, height=20, field_of_view=1.5
    )
    image = jt.render(solution, inside, band=None)
    assert on_body(image).all()
    assert_allclose(apparent(image), 350.0, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["exchange", "surroundings"])
def test_isothermal_surroundings_hide_a_body(name):
    term = {
        "exchange": jt.RadiativeExchange(300.0, max_patches=60, directions=32),
        "surroundings": jt.Surroundings(300.0, ground=300.0, occlusion=32),
    }[name]
    neighbour = block((0.02, 0.02, 0.02), 300.0, metal(0.1), at=(0.1, 0.0, 0.0))
    bodies = ball(300.0, 0.5), neighbour
    image = jt.render(at_start(bodies, term), FRONT, band=None)
    assert_allclose(apparent(image), 300.0, atol=1e-3)


def _facing_plates(n, side, gap, emissivities, kelvins, around):
    """Irradiation of the second plate's centre by quadrature over n^2 patches each."""
    line = (np.arange(n) + 0.5) / n * side - side / 2
    x, y = (axis.reshape(-1) for axis in np.meshgrid(line, line, indexing="ij"))
    square = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2 + gap**2
    factor = gap**2 / (np.pi * square**2) * (side / n) ** 2
    black = [SIGMA * kelvin**4 for kelvin in (*kelvins, around)]
    radiosities = [np.full(n * n, black[0]), np.full(n * n, black[1])]
    for _ in range(200):
        received = [
            factor @ radiosities[1 - k] + (1 - factor.sum(1)) * black[2] for k in (0, 1)
        ]
        radiosities = [
            e * b + (1 - e) * h
            for e, b, h in zip(emissivities, black[:2], received, strict=True)
        ]
    return received[1].reshape(n, n)[n // 2, n // 2]


@pytest.mark.slow
@pytest.mark.slice
def test_a_mirror_shows_the_hot_plate_before_it():
    """0.2 m squares 40 mm apart, against a quadrature of their radiosity."""
    side = 0.2
    gap = 0.04
    size = (side, side, 0.01)
    hot = block(size, 600.0, metal(0.9), at=(0.0, 0.0, gap + 0.01))
    mirror = block(size, 293.0, metal(0.1))
    solution = at_start((mirror, hot), jt.RadiativeExchange(293.0, max_patches=256))
    # Between the plates, towards the middle of the mirror.
    camera = jt.OrthographicCamera(
        (0.0, 0.0, 0.03), (0.0, 0.0, 0.0), 0.02, up=(0.0, 1.0, 0.0), width=8, height=8
    )
    seen = apparent(jt.render(solution, camera, band=None))[3:5, 3:5].mean()
    arrives = _facing_plates(
        41,
        side=side,
        gap=gap,
        emissivities=(0.9, 0.1),
        kelvins=(600.0, 293.0),
        around=293.0,
    )
    expected = (0.1 * 293.0**4 + 0.9 * arrives / SIGMA) ** 0.25
    assert expected > 450.0
    assert seen == pytest.approx(expected, rel=0.005)


def test_without_radiation_a_surface_shows_its_own_temperature():
    """What is not in the heat balance is not in the image; the air is behind it."""
    image = jt.render(at_start((BALL,), jt.Convection(10.0, 280.0)), FRONT, band=None)
    visible = on_body(image)
    assert_allclose(apparent(image)[visible], 320.0, atol=1e-9)
    assert_allclose(apparent(image)[~visible], 280.0, atol=1e-9)


def test_what_a_surface_held_at_a_temperature_reflects():
    held = jt.FixedTemperature(320.0)
    body = block((0.04, 0.04, 0.04), 300.0, metal(0.4))
    leaving = radiosity(at_start((body,), held, jt.Surroundings(250.0)))
    expected = 0.4 * SIGMA * 300.0**4 + 0.6 * SIGMA * 250.0**4
    assert_allclose(leaving, expected, rtol=1e-12)


@pytest.mark.slow
def test_occlusion_reaches_the_image():
    """A wall before half of a mirror hides the cold sky, as the view factor says."""
    bodies = [
        block((0.08, 0.08, 0.02), 300.0, metal(0.2)),
        block((0.02, 0.08, 0.08), 300.0, metal(0.2), at=(0.05, 0.0, 0.03)),
    ]
    cold = jt.Surroundings(200.0, occlusion=32)
    solution = at_start(bodies, cold)
    leaving = radiosity(solution)[: len(solution.surfaces[0].geometry.fragment_area)]
    reflected = (leaving / SIGMA - 0.2 * 300.0**4) / 0.8
    factor = (300.0**4 - reflected) / (300.0**4 - 200.0**4)
    grid = bodies[0].structure.grid
    up = grid.fragment_normal[:, 2] > 0.5
    away = 0.04 - grid.fragment_position[:, 0]
    inner = up & (np.abs(grid.fragment_position[:, 1]) < 0.01)
    # A wall as long as it is wide: nearly the half strip (1 + cos) / 2 of 2D.
    near = factor[inner & (away < 0.01)]
    far = factor[inner & (away > 0.07)]
    assert near.mean() < 0.7 < 0.85 < far.mean() <= 1.0


@pytest.mark.slow
def test_pixels_have_gradients_through_the_exchange():
    """With respect to an emissivity and the surroundings, by central differences."""
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.04)), 0.01)

    def pixel(values):
        emissivity, around = values
        bodies = (
            body_at(grid, metal(emissivity), 300.0),
            body_at(grid, metal(0.9), 500.0, at=(0.0, 0.07, 0.0)),
        )
        term = jt.RadiativeExchange(around, max_patches=30, directions=8)
        scene = jt.Scene(bodies, (term,), dtype="float64")
        solution = jt.simulate(scene, 0.0, solver=jt.ForwardEuler(dt=0.01))
        return solution.reflected(-1)[:96].mean()

    start = jnp.asarray([0.4, 280.0])
    step = jnp.asarray([1e-4, 1e-2])
    slopes = jax.jit(jax.jacfwd(pixel))(start)
    run = jax.jit(pixel)
    for k in range(2):
        move = jnp.where(jnp.arange(2) == k, step, 0.0)
        slope = (run(start + move) - run(start - move)) / (2 * step[k])
        assert abs(float(slope)) > 1e-3
        assert float(slopes[k]) == pytest.approx(float(slope), rel=1e-5)
