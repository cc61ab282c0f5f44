"""Object temperatures from radiances and counts, against published numbers."""

from typing import TypedDict

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.radiance.band import LONG_WAVE, Band
from jaxthermo.image.radiance.response import BANDS


MID_WAVE = Band(BANDS["mid-wave"])
FLIR = jt.FlirCalibration()


class _Path(TypedDict):
    """Arguments of the path of radiation from an object to a camera."""

    emissivity: float
    reflected_temperature: float
    transmissivity: float
    air_temperature: float


def test_the_measured_signal_of_the_example():
    """0.9 of 350 K before 293.15 K through 0.95 of air at 290 K, 7.5 to 14 um."""
    radiance = float(jt.measured_radiance(350.0, 0.9, 293.15, 0.95, 290.0))
    assert radiance == pytest.approx(107.672617, abs=1e-6)
    assert float(LONG_WAVE.temperature(radiance)) == pytest.approx(343.048911, abs=1e-6)
    back = float(jt.object_temperature(radiance, 0.9, 293.15, 0.95, 290.0))
    assert back == pytest.approx(350.0, abs=1e-9)


@pytest.mark.parametrize(
    ("emissivity", "expected"),
    [(0.95, 309.217275), (0.8, 306.835584), (0.5, 301.910518), (0.1, 294.963569)],
)
def test_apparent_temperatures_by_emissivity(emissivity, expected):
    radiance = jt.measured_radiance(310.0, emissivity, 293.15)
    assert float(LONG_WAVE.temperature(radiance)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("band", [None, LONG_WAVE, MID_WAVE])
def test_object_temperature_is_the_inverse(band):
    kelvin = np.array([250.0, 300.0, 450.0])
    path: _Path = {
        "emissivity": 0.7,
        "reflected_temperature": 280.0,
        "transmissivity": 0.9,
        "air_temperature": 285.0,
    }
    radiance = jt.measured_radiance(kelvin, **path, band=band)
    inverse = jt.object_temperature(radiance, **path, band=band)
    np.testing.assert_allclose(inverse, kelvin, rtol=1e-10)
    traced = jax.jit(lambda r: jt.object_temperature(r, **path, band=band))
    on_device = traced(radiance)
    np.testing.assert_allclose(on_device, kelvin, rtol=1e-10)


def test_derivatives_of_the_measured_temperature():
    def found(values):
        emissivity, around, passed, air = values
        return jt.object_temperature(jnp.asarray(90.0), emissivity, around, passed, air)

    at = np.array([0.85, 290.0, 0.95, 285.0])
    value_and_gradient = jax.jit(jax.value_and_grad(found))
    gradient = value_and_gradient(at)[1]
    for k, step in enumerate((1e-5, 1e-3, 1e-5, 1e-3)):
        by = step * np.eye(4)[k]
        ends = [float(value_and_gradient(at + sign * by)[0]) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert float(gradient[k]) == pytest.approx(slope, rel=1e-6)


def test_counts_of_a_published_camera():
    """Of gtatters/Thermimage's example, worked out from its formulas."""
    assert float(FLIR.counts(300.0)) == pytest.approx(18714.925, rel=1e-6)
    assert float(FLIR.temperature(18109)) - 273.15 == pytest.approx(23.624326, abs=1e-6)
    plain = FLIR.object_temperature(18109)
    assert float(plain) - 273.15 == pytest.approx(23.6243, abs=1e-4)
    room = 293.15
    behind_window = FLIR.object_temperature(
        18109, 0.95, room, 1.0, room, 0.5, 0.96, room
    )
    assert float(behind_window) - 273.15 == pytest.approx(24.0002, abs=1e-4)


def test_counts_and_temperatures_are_inverse_and_smooth():
    kelvin = jnp.array([250.0, 300.0, 380.0])
    np.testing.assert_allclose(
        FLIR.temperature(FLIR.counts(kelvin)), kelvin, rtol=1e-12
    )
    slope = jax.grad(lambda s: FLIR.temperature(s))(jnp.asarray(18109.0))
    ends = [float(FLIR.temperature(18109.0 + sign)) for sign in (1e-1, -1e-1)]
    assert float(slope) == pytest.approx((ends[0] - ends[1]) / 2e-1, rel=1e-6)


def test_a_cold_pixel_costs_that_pixel():
    counts = np.array([18109.0, 7340.0, np.nan, 0.0])
    kelvin = FLIR.temperature(counts)
    assert kelvin[0] - 273.15 == pytest.approx(23.624326, abs=1e-6)
    assert np.isnan(kelvin[1:]).all()
    behind_air = FLIR.object_temperature(counts, 0.9, 300.0, distance=10.0)
    np.testing.assert_array_equal(np.isnan(behind_air), np.isnan(kelvin))
    radiance = jt.measured_radiance(np.array([310.0, 320.0]), 0.5, 300.0)
    radiance[1] = 1.0
    found = jt.object_temperature(radiance, 0.5, 300.0)
    assert found[0] == pytest.approx(310.0, abs=1e-9)
    assert np.isnan(found[1])


@pytest.mark.parametrize("distance", [2.0, 20.0, 100.0])
def test_what_is_seen_through_air_is_corrected_for_the_same_air(distance):
    """A surface of 350 K, drawn behind air and measured, is 350 K again."""
    grid = jt.voxelize(jt.shapes.box((4.0, 4.0, 0.4)), pitch=0.4)
    matter = jt.Material(1e3, 1e3, 1e3, emissivity=1.0)
    body = jt.Body(jt.FullVolume(grid), matter, temperature=350.0)
    solution = jt.simulate(jt.Scene((body,)), 0.0)
    camera = jt.Camera(
        (0.0, 0.0, distance + 0.2),
        (0.0, 0.0, 0.2),
        up=(0.0, 1.0, 0.0),
        field_of_view=1 / distance,
        width=3,
        height=3,
    )
    other_flir = jt.FlirCalibration(b=1415.0)
    other_air = jt.AirConstants(0.73, 1.2e-8, 1.1e-8, 0.0032, 0.0032, b=1415.0)
    for flir, constants in ((FLIR, jt.AirConstants()), (other_flir, other_air)):
        air = jt.Atmosphere(293.15, 0.5, constants=constants)
        image = jt.render(solution, camera, effects=(air,))
        seen = float(np.asarray(image.apparent_temperature)[1, 1])
        assert seen < 349.9
        corrected = flir.object_temperature(
            flir.counts(seen), distance=distance, air_constants=constants
        )
        assert float(corrected) == pytest.approx(350.0, abs=5e-4)


@pytest.mark.parametrize(
    "call",
    [
        lambda: jt.measured_radiance(300.0, 1.2),
        lambda: jt.measured_radiance(300.0, 0.9, transmissivity=-0.1),
        lambda: jt.object_temperature(60.0, 0.0),
        lambda: jt.object_temperature(60.0, 0.5, transmissivity=0.0),
        # All that arrives would be reflected.
        lambda: jt.object_temperature(20.0, 0.5, 300.0),
        lambda: FLIR.temperature(np.array([7339.0, 7340.0])),
        lambda: FLIR.object_temperature(18109.0, 1.5),
        lambda: FLIR.object_temperature(18109.0, relative_humidity=50.0),
        lambda: FLIR.object_temperature(18109.0, distance=-1.0),
        lambda: jt.FlirCalibration(b=-1501.0),
    ],
)
def test_impossible_values_are_refused(call):
    with pytest.raises(jt.InputError):
        call()


SEEN = jt.FlirThermogram(np.full((2, 2), 18109), FLIR, emissivity=0.7)


@pytest.mark.parametrize(
    "call",
    [
        lambda **option: SEEN.object_temperature(reflected_temperature=20.0, **option),
        lambda **option: SEEN.object_temperature(window_temperature=20.0, **option),
        lambda **option: SEEN._replace(air_temperature=20.0).object_temperature(
            **option
        ),
        lambda **option: FLIR.object_temperature(18109, 0.7, 20.0, **option),
        lambda **option: FLIR.counts(20.0, **option),
        lambda **option: jt.measured_radiance(20.0, **option),
        lambda **option: jt.measured_radiance(300.0, 0.9, 20.0, **option),
        lambda **option: jt.measured_radiance(jnp.asarray([300.0, 7e3]), **option),
        lambda **option: jt.object_temperature(60.0, 0.9, 20.0, **option),
        lambda **option: jt.object_temperature(
            60.0, transmissivity=0.9, air_temperature=20.0, **option
        ),
    ],
)
def test_degrees_celsius_for_kelvin_are_refused(call):
    """Of 20 for 20 degC the object would be 21 K too warm."""
    with pytest.raises(jt.InputError, match="20 K is below 150 K|7000 K is above") as e:
        call()
    assert "allow_extreme_temperatures=True" in str(e.value)
    assert "\n" not in str(e.value)
    assert np.isfinite(np.asarray(call(allow_extreme_temperatures=True))).all()


def test_the_pixels_that_leave_the_limits_are_counted_with_their_place():
    frame = np.full((3, 4), 300.0)
    frame[2, 1] = 0.5
    frame[1, 3] = 20.0
    with pytest.raises(jt.InputError, match="2 of 12") as caught:
        jt.measured_radiance(frame)
    assert "20 K at row 1, column 3, 0.5 K at row 2, column 1" in str(caught.value)
