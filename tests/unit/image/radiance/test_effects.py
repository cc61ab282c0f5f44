"""Effects between a surface and the signal of a camera."""

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.radiance.atmosphere import transmissivity
from jaxthermo.image.radiance.band import LONG_WAVE, Band
from jaxthermo.image.radiance.directional import _above_horizon
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.radiance.effect import AbstractEffect
from jaxthermo.image.radiance.response import BANDS
from jaxthermo.image.render import in_order
from jaxthermo.image.surface.view import compute_view
from tests.imaging import apparent, metal


MID_WAVE = Band(BANDS["mid-wave"])
CAMERA = jt.Camera(
    (0.5, -0.3, 0.2), (0.0, 0.0, 0.0), field_of_view=0.2, width=24, height=20
)
# Before noise and counts.
SMOOTH: tuple[AbstractEffect, ...] = (
    jt.AngularEmissivity(),
    jt.SpecularReflection(0.6, 30.0),
    jt.Atmosphere(300.0),
    jt.Blur(0.7),
    jt.DiffractionBlur(),
    jt.BolometerLag(),
)


def ball(emissivity=0.8, absorptivity=0.5, kelvin: Any = 300.0) -> jt.Body:
    grid = jt.voxelize(jt.shapes.sphere(0.02), 0.004)
    return jt.Body(
        jt.FullVolume(grid), metal(emissivity, absorptivity), temperature=kelvin
    )


def at_start(*terms: Any, **body: Any) -> jt.Solution:
    scene = jt.Scene((ball(**body),), terms, dtype="float64")
    return jt.simulate(scene, 0.0)


@pytest.fixture(scope="module")
def isothermal() -> dict[float, jt.Solution]:
    return {e: at_start(jt.Surroundings(300.0), emissivity=e) for e in (1.0, 0.6)}


@pytest.fixture(scope="module")
def sunlit() -> jt.Solution:
    sun = jt.Sun((-1.0, 0.8, -0.6), 900.0)
    sky = jt.Surroundings(250.0, ground=290.0)
    return at_start(sun, sky, kelvin=310.0)


@pytest.mark.parametrize("band", [None, LONG_WAVE, MID_WAVE])
@pytest.mark.parametrize("emissivity", [1.0, 0.6])
@pytest.mark.parametrize("count", range(1, len(SMOOTH) + 1))
def test_isothermal_bodies_show_their_temperature(isothermal, band, emissivity, count):
    solution = isothermal[emissivity]
    image = jt.render(solution, CAMERA, band=band, samples=2, effects=SMOOTH[:count])
    seen = apparent(image)
    np.testing.assert_allclose(seen, 300.0, atol=1e-3)


def test_reflection_in_all_directions_is_the_limit_of_the_directional_one(sunlit):
    none = jt.SpecularReflection(0.0)
    for band in (None, LONG_WAVE):
        plain, directional = (
            jt.render(sunlit, CAMERA, band=band, effects=effects)
            for effects in ((), (none,))
        )
        np.testing.assert_allclose(directional.radiance, plain.radiance, rtol=1e-12)


def test_apparent_temperature_at_the_normal_and_by_the_angle():
    """Listed: 300 K of emissivity 0.91 before 250 K shows 296.4424 K, face on."""
    solution = at_start(jt.Surroundings(250.0), emissivity=0.91)
    far = jt.OrthographicCamera(
        CAMERA.position, CAMERA.look_at, 0.05, width=41, height=41
    )
    image = jt.render(solution, far, band=None, effects=(jt.AngularEmissivity(),))
    seen = np.asarray(image.object_id) == 0
    normal = np.asarray(image.normal)[seen]
    sight = np.subtract(CAMERA.position, CAMERA.look_at)
    cosine = (normal @ sight / np.linalg.norm(sight)).clip(0)
    kelvin = apparent(image)[seen]
    facing = cosine.argmax()
    assert cosine[facing] > 0.998
    assert kelvin[facing] == pytest.approx(296.4424, abs=2e-3)
    emissivity = np.asarray(image.emissivity)[seen]
    np.testing.assert_allclose(emissivity, 0.91 * (1 - (1 - cosine) ** 5), rtol=1e-12)
    expected = (emissivity * 300.0**4 + (1 - emissivity) * 250.0**4) ** 0.25
    np.testing.assert_allclose(kelvin, expected, rtol=1e-12)
    assert emissivity.min() < 0.7


def test_a_glossy_ball_has_its_highlight_where_a_mirror_has(sunlit):
    polished = (jt.SpecularReflection(1.0, 300.0),)
    image = jt.render(sunlit, CAMERA.finer(4), band=None, effects=polished)
    plain = jt.render(sunlit, CAMERA.finer(4), band=None)
    added = np.asarray(image.radiance) - np.asarray(plain.radiance)
    added[np.asarray(image.object_id) < 0] = 0
    brightest = np.unravel_index(added.argmax(), added.shape)
    normal = np.asarray(image.normal)[brightest]
    sight = np.subtract(CAMERA.position, CAMERA.look_at)
    halfway = sight / np.linalg.norm(sight) - np.array([-1.0, 0.8, -0.6]) / math.sqrt(2)
    assert normal @ halfway / np.linalg.norm(halfway) > 0.995


def test_a_glossy_surface_reflects_as_much_as_a_matt_one():
    """Over all directions the lobe has the power of the diffuse part."""
    exponent = 40.0
    turns = 400
    angle = (np.arange(turns) + 0.5) * (math.pi / 2 / turns)
    # Rays along the normal: the mirror direction is the normal.
    lobe = (exponent + 2) / (2 * math.pi) * np.cos(angle) ** exponent
    power = lobe * np.cos(angle) * np.sin(angle) * 2 * math.pi
    assert power.sum() * math.pi / 2 / turns == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("exponent", [1.0, 20.0, 1000.0])
def test_part_of_a_lobe_above_the_horizon(exponent):
    """Monte Carlo over the lobe, whose axis stands at several elevations."""
    generator = np.random.default_rng(3)
    cosine = generator.random(200_000) ** (1 / (exponent + 1))
    turn = generator.random(200_000) * 2 * math.pi
    sine = np.sqrt(1 - cosine**2)
    for elevation in (-1.2, -0.1, 0.0, 0.03, 0.6, math.pi / 2):
        up = math.sin(elevation) * cosine + math.cos(elevation) * sine * np.cos(turn)
        fraction = float(_above_horizon(np.array([elevation]), exponent)[0])
        assert fraction == pytest.approx((up > 0).mean(), abs=4e-3)


def test_daylight_from_everywhere_has_no_highlight():
    """The lobe of a sun is the same with and without daylight."""
    sun = jt.Sun((-1.0, 0.8, -0.6), 900.0)
    day = jt.DiffuseSky(120.0, 30.0)
    glossy = (jt.SpecularReflection(0.7, 50.0),)

    def added(*terms: Any) -> np.ndarray:
        solution = at_start(jt.Surroundings(280.0), *terms)
        radiances = [
            jt.render(solution, CAMERA, band=None, effects=effects).radiance
            for effects in (glossy, ())
        ]
        return np.asarray(radiances[0]) - np.asarray(radiances[1])

    np.testing.assert_allclose(added(day), 0.0, atol=1e-12)
    np.testing.assert_allclose(added(day, sun), added(sun), atol=1e-12)


def test_a_polished_ball_mirrors_the_sky_above_and_the_ground_below():
    terms = jt.Surroundings(250.0, ground=300.0)
    solution = at_start(terms, emissivity=0.0, kelvin=280.0)
    level = jt.OrthographicCamera(
        (0.0, -0.5, 0.0), (0.0, 0.0, 0.0), 0.05, width=21, height=21
    )
    polished = (jt.SpecularReflection(1.0, 3000.0),)
    image = jt.render(solution, level, band=None, effects=polished)
    seen = apparent(image)[:, 10]
    assert seen[5] == pytest.approx(250.0, abs=1.0)
    assert seen[15] == pytest.approx(300.0, abs=1.0)


def test_transmissivity_is_the_listed_one():
    distance = np.array([1.0, 10.0, 50.0, 100.0, 500.0])
    passed = transmissivity(distance, temperature=293.15, relative_humidity=0.5, xp=np)
    listed = [0.993943, 0.980699, 0.956235, 0.937455, 0.853766]
    np.testing.assert_allclose(passed, listed, atol=6e-7)


def test_air_at_a_distance_hides_a_surface():
    solution = at_start(jt.Surroundings(300.0), emissivity=1.0, kelvin=350.0)
    opaque = (jt.Atmosphere(280.0, transmissivity=0.0),)
    image = jt.render(solution, CAMERA, effects=opaque)
    on_body = np.asarray(image.object_id) == 0
    seen = apparent(image)
    np.testing.assert_allclose(seen[on_body], 280.0, atol=1e-3)
    np.testing.assert_allclose(seen[~on_body], 300.0, atol=1e-3)
    half = (jt.Atmosphere(280.0, transmissivity=0.5),)
    mixed = jt.render(solution, CAMERA, effects=half)
    expected = (LONG_WAVE.radiance(350.0) + LONG_WAVE.radiance(280.0)) / 2
    np.testing.assert_allclose(np.asarray(mixed.radiance)[on_body], expected, rtol=1e-6)
    far = jt.Camera((50.0, 0.0, 0.0), (0.0, 0.0, 0.0), field_of_view=0.002)
    small = dataclasses.replace(far, width=24, height=20)
    image = jt.render(solution, small, effects=(jt.Atmosphere(293.15),))
    centre = float(np.asarray(image.radiance)[10, 12])
    half = transmissivity(25.0 - 0.01, temperature=293.15, relative_humidity=0.5, xp=np)
    passed = half**2
    # Air mixes the counts of a camera, which count a black surface as 1/(e^(B/T) - 1).
    hot, air = 1 / np.expm1(1501.0 / np.array([350.0, 293.15]))
    kelvin = 1501.0 / np.log1p(1 / (passed * hot + (1 - passed) * air))
    assert centre == pytest.approx(float(LONG_WAVE.radiance(kelvin)), rel=1e-5)


def test_derivatives_through_surface_and_air_are_those_of_differences(sunlit):
    """By humidity, air, gloss and the temperature of the body."""

    def centre(values: Any) -> Any:
        air, humidity, gloss, kelvin = values
        effects = (
            jt.AngularEmissivity(),
            jt.SpecularReflection(gloss, 30.0),
            jt.Atmosphere(air, humidity),
            jt.Blur(0.6),
        )
        warmer = dataclasses.replace(
            sunlit, surface_temperature=sunlit.surface_temperature * 0 + kelvin
        )
        return jt.render(warmer, CAMERA, samples=2, effects=effects).radiance[9, 12]

    at = np.array([285.0, 0.6, 0.4, 305.0])
    # Values with a derivative too, since images without are of tables.
    value_and_gradient = jax.jit(jax.value_and_grad(centre))
    gradient = value_and_gradient(at)[1]
    for k, step in enumerate((1e-2, 1e-4, 1e-4, 1e-2)):
        by = step * np.eye(4)[k]
        moved = [float(value_and_gradient(at + sign * by)[0]) for sign in (1, -1)]
        slope = (moved[0] - moved[1]) / (2 * step)
        assert float(gradient[k]) == pytest.approx(slope, rel=1e-6)


def test_what_is_not_asked_for_is_not_in_the_program(sunlit):
    surfaces = sunlit.surfaces
    terms = sunlit.terms
    view = compute_view(surfaces, terms, CAMERA)
    received = sunlit.irradiance(0)

    def operations(*effects: Any) -> int:
        def radiance(kelvin: Any) -> Any:
            return draw(
                view,
                Moment(
                    surfaces=surfaces,
                    terms=terms,
                    temperature=kelvin,
                    received=received,
                    time=sunlit.times[0],
                ),
                effects=in_order(effects),
            ).radiance

        return len(jax.make_jaxpr(radiance)(sunlit.surface_temperature[0]).jaxpr.eqns)

    plain = operations()
    # Those of the detector follow later, on the host.
    assert operations(jt.Blur(1.0), jt.DetectorNoise(), jt.Counts(280, 300)) == plain
    angle = operations(jt.AngularEmissivity())
    gloss = operations(jt.AngularEmissivity(), jt.SpecularReflection())
    assert plain < operations(jt.Atmosphere(290.0))
    assert plain < angle < gloss


def test_effects_are_sorted_and_each_is_given_once():
    effects = in_order(SMOOTH[::-1] + (jt.Counts(280.0, 320.0), jt.DetectorNoise()))
    assert [type(e).__name__ for e in effects.surface] == [
        "AngularEmissivity",
        "SpecularReflection",
    ]
    assert [type(e).__name__ for e in effects.detector] == ["DetectorNoise", "Counts"]
    assert effects.spread == pytest.approx(math.hypot(0.7, 0.35))
    with pytest.raises(jt.InputError, match="Blur twice"):
        in_order((jt.Blur(1.0), jt.Blur(2.0)))
    with pytest.raises(jt.InputError, match="effects"):
        in_order((1.0,))


@pytest.mark.parametrize(
    "make",
    [
        lambda: jt.AngularEmissivity(0.5),
        lambda: jt.SpecularReflection(1.5),
        lambda: jt.SpecularReflection(0.5, 0.0),
        lambda: jt.Atmosphere(20.0),
        lambda: jt.Atmosphere(jnp.asarray(20.0)),
        lambda: jt.Atmosphere("290 K"),
        lambda: jt.Atmosphere(290.0, 50.0),
        lambda: jt.Atmosphere(290.0, transmissivity=-0.1),
        lambda: jt.Blur(0.0),
        lambda: jt.DiffractionBlur(f_number=-1.0),
        lambda: jt.BolometerLag(0.0),
        lambda: jt.DetectorNoise(-0.05),
        lambda: jt.DetectorNoise(0.05, reference_temperature=20.0),
        lambda: jt.FixedPatternNoise(columns=math.nan),
        lambda: jt.Counts(300.0, 280.0),
        lambda: jt.Counts(280.0, 300.0, bits=40),
    ],
)
def test_values_beyond_their_range_are_refused(make):
    with pytest.raises(jt.InputError):
        make()


def test_frames_of_all_times_are_those_that_are_drawn_alone():
    scene = jt.Scene((ball(),), (jt.Surroundings(400.0),), dtype="float64")
    solution = jt.simulate(scene, 3.0, save_at=[1.0, 2.0, 3.0])
    effects = (jt.BolometerLag(0.8), jt.Blur(0.5), jt.DetectorNoise())
    images = list(jt.frames(solution, CAMERA, effects=effects))
    assert [float(image.time) for image in images] == [1.0, 2.0, 3.0]
    for k, image in enumerate(images):
        alone = jt.render(solution, CAMERA, k, effects=effects)
        np.testing.assert_allclose(image.radiance, alone.radiance, rtol=1e-12)
    with pytest.raises(jt.InputError, match="effects"):
        jt.frames(solution, CAMERA, effects=(0.5,))
