"""Radiance within bands, brightness temperatures, and images of them."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.arrays import precision
from jaxthermo.constants import SOLAR_TEMPERATURE
from jaxthermo.image.radiance.band import Band
from jaxthermo.image.radiance.response import BANDS
from tests.imaging import apparent, at_start, block, metal, on_body


SIGMA = 5.670374419e-8
LONG_WAVE, MID_WAVE = (Band(BANDS[name]) for name in ("long-wave", "mid-wave"))

# Radiance [W/(m^2 sr)] and its derivative by temperature at 250, 300, 350, 400 K: the
# series of exponentials, checked against quadrature to 1e-9.
LISTED = {
    LONG_WAVE: (
        (23.5608, 59.3117, 117.075, 197.667),
        (0.513635, 0.928314, 1.38456, 1.83546),
    ),
    MID_WAVE: (
        (0.217035, 1.86596, 8.97435, 29.8473),
        (0.0110886, 0.0676983, 0.244250, 0.633793),
    ),
}
KELVIN = np.array([250.0, 300.0, 350.0, 400.0])


def fraction(z: float) -> float:
    """Fraction of a black body's radiation up to a wavelength, z = c2 / (l T)."""
    n = np.arange(1, 2000)
    terms = z**3 / n + 3 * z**2 / n**2 + 6 * z / n**3 + 6 / n**4
    return 15 / math.pi**4 * float((np.exp(-n * z) * terms).sum())


@pytest.mark.parametrize("band", [LONG_WAVE, MID_WAVE])
def test_radiances_are_the_listed_ones(band):
    radiance, slope = LISTED[band]
    np.testing.assert_allclose(band.radiance(KELVIN), radiance, rtol=6e-6)
    np.testing.assert_allclose(band.slope(KELVIN), slope, rtol=6e-6)


@pytest.mark.parametrize("kelvin", [60.0, 200.0, 300.0, 1000.0, 5800.0])
@pytest.mark.parametrize("edges", [(7.5e-6, 14e-6), (3e-6, 5e-6), (2e-7, 2e-4)])
def test_radiance_is_the_series_of_exponentials(edges, kelvin):
    rate = 1.438776877503933e-2 / kelvin
    ends = [fraction(rate / edge) for edge in edges]
    expected = SIGMA / math.pi * kelvin**4 * (ends[1] - ends[0])
    # The widest band has nearly all the radiation: a table of one follows it better.
    wavelengths = np.geomspace(edges[0], edges[1], 40)
    radiance = Band(wavelengths.tolist()).radiance(kelvin)
    assert float(radiance) == pytest.approx(expected, rel=1e-7)
    if edges[0] > 1e-6:
        assert float(Band(edges).radiance(kelvin)) == pytest.approx(expected, rel=1e-9)


def test_a_table_of_responses_weighs_wavelengths():
    full = Band((8e-6, 14e-6))
    half = Band((8e-6, 14e-6), (0.5, 0.5))
    assert float(half.radiance(300.0)) == pytest.approx(
        float(full.radiance(300.0)) / 2, rel=1e-12
    )
    table = Band((8e-6, 10e-6, 14e-6))
    assert float(table.radiance(300.0)) == pytest.approx(
        float(full.radiance(300.0)), rel=1e-10
    )
    # A triangle against its own quadrature.
    edges = (8e-6, 11e-6, 14e-6)
    response = (0.0, 1.0, 0.0)
    at = np.linspace(8e-6, 14e-6, 60_001)
    planck = 1.191042972397188e-16 / at**5 / np.expm1(1.438776877503933e-2 / at / 310.0)
    expected = np.trapezoid(np.interp(at, edges, response) * planck, at)
    radiance = Band(edges, response).radiance(310.0)
    assert float(radiance) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("band", [LONG_WAVE, MID_WAVE])
def test_brightness_temperature_is_the_inverse(band):
    kelvin = np.geomspace(60.0, 9000.0, 500)
    radiance = band.radiance(kelvin)
    np.testing.assert_allclose(band.temperature(radiance), kelvin, rtol=1e-11)
    inverse = eqx.filter_jit(band.temperature)
    np.testing.assert_allclose(inverse(radiance), kelvin, rtol=1e-11)
    # The tables of images, to 1 mK, in either precision.
    np.testing.assert_allclose(band.table.radiance(kelvin), radiance, rtol=1e-6)
    np.testing.assert_allclose(band.table.temperature(radiance), kelvin, atol=1e-3)
    scene = np.linspace(200.0, 500.0, 1000, dtype=np.float32)
    again = band.table.temperature(band.table.radiance(scene))
    assert again.dtype == np.float32
    np.testing.assert_allclose(again, scene, atol=1e-3)
    # On devices too float32 stays what it is, to a few units of its last place.
    again = inverse(eqx.filter_jit(band.radiance)(scene))
    assert again.dtype == np.float32
    np.testing.assert_allclose(again, scene, rtol=1e-6)


def test_listed_spectral_radiance():
    """Listed for 800 K at 4 um by `ht`: 1311692056 W/(m^2 sr) per metre.

    With constants from before 2019: c2 / (l T) = 4.5 times their change is 1.5e-6.
    """
    narrow = Band((3.9999e-6, 4.0001e-6))
    spectral = float(narrow.radiance(800.0)) / 2e-10
    assert spectral == pytest.approx(1311692056.0, rel=2e-6)


def test_listed_inverses():
    assert float(LONG_WAVE.temperature(60.0)) == pytest.approx(300.738830, abs=1e-6)
    assert float(MID_WAVE.temperature(2.0)) == pytest.approx(301.923589, abs=1e-6)


@pytest.mark.parametrize("band", [LONG_WAVE, MID_WAVE])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_compiled_derivatives_of_arrays_are_those_of_the_host(band, dtype):
    """A compiler may rewrite what is right when it runs step by step."""

    def slope(law: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return jax.jit(lambda x: jax.jvp(law, (x,), (jnp.ones_like(x),))[1])

    expected = band.slope(np.linspace(250.0, 350.0, 1000))
    with precision(dtype):
        kelvin = jnp.linspace(250.0, 350.0, 1000)
        slopes = slope(band.radiance)(kelvin)
        inverse = slope(band.temperature)(band.radiance(kelvin))
    np.testing.assert_allclose(slopes, expected, rtol=2e-5)
    np.testing.assert_allclose(inverse, 1 / expected, rtol=2e-5)


def value_and_derivatives(function):
    """A compiled function of a number: value, first and second derivative."""
    slope = jax.grad(function)
    return jax.jit(lambda x: (function(x), slope(x), jax.grad(slope)(x)))


@pytest.mark.parametrize("band", [LONG_WAVE, MID_WAVE])
def test_derivatives_are_differences(band):
    for function, at, step in (
        (band.radiance, 300.0, 1e-3),
        (band.temperature, float(band.radiance(300.0)), 1e-5),
    ):
        three = value_and_derivatives(function)
        below, middle, above = (three(at + s) for s in (-step, 0.0, step))
        difference = float(above[0] - below[0]) / (2 * step)
        assert float(middle[1]) == pytest.approx(difference, rel=1e-6)
        second = float(middle[2])
        slopes = [float(above[1]), float(below[1])]
        assert second == pytest.approx((slopes[0] - slopes[1]) / (2 * step), rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (((7.5e-6,),), "two or more"),
        (((14e-6, 7e-6),), "increasing"),
        (((7.5, 14.0),), "metres"),
        (((8e-6, "x"),), "finite numbers"),
        (((8e-6, 9e-6), (1.0,)), "1 values for 2"),
        (((8e-6, 9e-6), (1.0, -0.1)), "fractions"),
        (((8e-6, 9e-6), (0.0, 0.0)), "no energy"),
        (((8e-6, 9e-6), (1.0, np.nan)), "finite"),
    ],
)
def test_bad_bands_are_refused(arguments, words):
    with pytest.raises(jt.InputError, match=words):
        Band(*arguments)


def test_radiance_beyond_the_range_is_refused():
    with pytest.raises(jt.InputError, match="black surface between 50 and 10000 K"):
        LONG_WAVE.temperature(np.array([60.0, -1.0]))


def cube(emissivity=1.0, absorptivity=1.0, kelvin=300.0) -> jt.Body:
    return block((0.04, 0.04, 0.04), kelvin, metal(emissivity, absorptivity))


CAMERA = jt.OrthographicCamera(
    (0.2, 0.0, 0.0), (0.0, 0.0, 0.0), 0.1, width=20, height=20
)
ANY_BAND = pytest.mark.parametrize("band", [None, LONG_WAVE, MID_WAVE])


@ANY_BAND
@pytest.mark.parametrize("emissivity", [1.0, 0.6])
def test_bodies_in_isothermal_surroundings_show_their_temperature(band, emissivity):
    solution = at_start([cube(emissivity)], jt.Surroundings(300.0))
    image = jt.render(solution, CAMERA, band=band)
    np.testing.assert_allclose(apparent(image), 300.0, atol=1e-3)
    assert image.band is band


def test_a_grey_body_in_surroundings_of_another_temperature():
    """Listed: 310 K at emissivity 0.8 before 293.15 K, from 7.5 to 14 um."""
    solution = at_start([cube(0.8, kelvin=310.0)], jt.Surroundings(293.15))
    image = jt.render(solution, CAMERA, band=LONG_WAVE)
    np.testing.assert_allclose(apparent(image)[on_body(image)], 306.835584, atol=1e-3)


def test_only_the_share_of_the_sun_within_the_band_is_reflected():
    sun = jt.Sun((-1.0, 0.0, 0.0), 1000.0)
    cold = jt.Surroundings(280.0)
    solution = at_start([cube(0.9, 0.5)], cold, sun)
    share = float(LONG_WAVE.share(SOLAR_TEMPERATURE))
    assert share == pytest.approx(0.00137006, rel=1e-5)
    emitted = 0.9 * float(LONG_WAVE.radiance(300.0))
    around = 0.1 * float(LONG_WAVE.radiance(280.0))
    lit = 0.1 * share * 1000.0 / math.pi
    expected = float(LONG_WAVE.temperature(emitted + around + lit))
    middle = (10, 10)
    image = jt.render(solution, CAMERA, band=LONG_WAVE)
    seen = float(image.apparent_temperature[middle])
    assert seen == pytest.approx(expected, abs=1e-3)
    # Over all wavelengths it is far too hot for a long-wave camera.
    total = jt.render(solution, CAMERA, band=None).apparent_temperature
    assert float(total[middle]) > seen + 40


def test_a_warm_panel_is_reflected_with_its_own_spectrum():
    kelvin = 500.0
    strength = SIGMA * kelvin**4 / math.pi
    shares = []
    at = (0.1, 0.0, 0.0)
    towards = (-1.0, 0.0, 0.0)
    for panel in (
        jt.AreaSource(at, towards, (0.1, 0.1), temperature=kelvin),
        jt.AreaSource(at, towards, (0.1, 0.1), radiance=strength),
    ):
        scene = jt.Scene(
            (cube(0.5, 0.5),),
            (jt.Surroundings(0.0), panel),
            dtype="float64",
            allow_extreme_temperatures=True,
        )
        solution = jt.simulate(scene, 0.0)
        behind = jt.OrthographicCamera(
            (0.3, 0.0, 0.2), (0.0, 0.0, 0.0), 0.1, width=40, height=40
        )
        image = jt.render(solution, behind, band=LONG_WAVE)
        emitted = 0.5 * float(LONG_WAVE.radiance(300.0))
        shares.append(np.asarray(image.radiance)[on_body(image)].max() - emitted)
    warm, as_sun = (float(LONG_WAVE.share(t)) for t in (kelvin, SOLAR_TEMPERATURE))
    assert shares[0] / shares[1] == pytest.approx(warm / as_sun, rel=1e-6)


def test_traced_images_are_those_of_the_host():
    solution = at_start([cube(0.7, 0.5)], jt.Surroundings(280.0))
    plain = jt.render(solution, CAMERA, band=LONG_WAVE).radiance

    @jax.jit
    @jax.value_and_grad
    def middle(kelvin):
        surface = kelvin + 0 * solution.surface_temperature
        uniform = dataclasses.replace(solution, surface_temperature=surface)
        return jt.render(uniform, CAMERA, band=LONG_WAVE).radiance[10, 10]

    value, slope = middle(300.0)
    assert float(value) == pytest.approx(float(plain[10, 10]), rel=1e-6)
    assert float(slope) == pytest.approx(0.7 * float(LONG_WAVE.slope(300.0)), rel=1e-9)
