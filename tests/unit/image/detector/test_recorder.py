"""Frames of a recorder: optics, lag, noise and counts of a detector."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.detector.effects import integrate_pixels
from jaxthermo.image.radiance.band import LONG_WAVE
from jaxthermo.image.radiance.image import Image, block_means
from jaxthermo.image.render import _Recording, in_order


def flat(radiance: np.ndarray, time: float = 0.0) -> Image:
    """An image of radiances, with nothing else."""
    shape = radiance.shape
    return Image(
        time=jnp.asarray(time),
        temperature=np.full(shape, 300.0),
        radiance=radiance,
        emissivity=np.ones(shape),
        depth=np.ones(shape),
        object_id=np.zeros(shape, np.int32),
        normal=np.zeros((*shape, 3)),
        band=LONG_WAVE,
    )


def seen(radiance: np.ndarray, *effects, time: float = 0.0) -> np.ndarray:
    chain = in_order(effects)
    image = _Recording(lambda k: flat(radiance, time), [time], chain).frame(0)
    return np.asarray(image.radiance)


def test_a_pixel_is_the_mean_of_its_samples():
    values = np.random.default_rng(0).random((8, 12))
    expected = values.reshape(4, 2, 6, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(block_means(values, 2), expected, rtol=1e-14)
    traced = block_means(jnp.asarray(values), 2)
    np.testing.assert_allclose(traced, expected, rtol=1e-14)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_blurred_edge_is_the_error_function(samples):
    """Of the step response of a Gaussian, integrated over each pixel."""
    columns = 40
    sigma = 1.5
    edge = np.repeat((np.arange(columns * samples) >= 20 * samples)[None] * 1.0, 6, 0)
    blurred = integrate_pixels(np.repeat(edge, samples, 0), samples, sigma)[3]

    def integral(x: float) -> float:
        """Of the error function's ramp from the edge."""
        z = x / (sigma * math.sqrt(2))
        bell = sigma / math.sqrt(2 * math.pi) * math.exp(-(z**2))
        return x * (1 + math.erf(z)) / 2 + bell

    exact = [integral(k + 1 - 20) - integral(k - 20) for k in range(columns)]
    # A spot in samples is a sum: the finer, the closer.
    np.testing.assert_allclose(blurred, exact, atol=0.02 / samples**2)


@pytest.mark.parametrize("samples", [1, 2])
def test_blur_keeps_energy_constants_and_is_the_same_in_jax(samples):
    values = np.random.default_rng(1).random((24 * samples, 30 * samples))
    values[: 9 * samples] = values[-9 * samples :] = 0
    values[:, : 9 * samples] = values[:, -9 * samples :] = 0
    blurred = integrate_pixels(values, samples, 1.2)
    assert blurred.sum() * samples**2 == pytest.approx(values.sum(), rel=1e-4)
    traced = integrate_pixels(jnp.asarray(values), samples, 1.2)
    np.testing.assert_allclose(traced, blurred, rtol=1e-12, atol=1e-14)
    constant = integrate_pixels(np.full((10 * samples, 8 * samples), 3.0), samples, 2.0)
    np.testing.assert_allclose(constant, 3.0, rtol=1e-14)


def test_airy_spot_of_a_common_camera():
    # 10 um, f/1: the first dark ring at 12.2 um, about a pixel of 12 um.
    assert jt.DiffractionBlur().spread == pytest.approx(0.35)
    assert jt.DiffractionBlur(f_number=2.0).spread == pytest.approx(0.7)


@pytest.mark.slow
@pytest.mark.slice
def test_noise_has_its_netd_over_many_frames():
    radiance = np.full((20, 24), float(LONG_WAVE.radiance(250.0)))
    noise = jt.DetectorNoise(netd=0.05, seed=7)
    frames = [seen(radiance, noise, time=0.1 * k) for k in range(1000)]
    kelvin = np.asarray(LONG_WAVE.temperature(np.array(frames)))
    # Listed: 50 mK at 300 K are 90 mK at 250 K.
    slopes = [float(LONG_WAVE.slope(k)) for k in (300.0, 250.0)]
    assert 0.05 * slopes[0] / slopes[1] == pytest.approx(0.0904, abs=1e-4)
    over_frames = kelvin.std(axis=0)
    assert over_frames.mean() == pytest.approx(0.0904, rel=0.03)
    assert kelvin.std(axis=(1, 2)).mean() == pytest.approx(0.0904, rel=0.03)
    assert kelvin.mean() == pytest.approx(250.0, abs=0.001)
    # Independent from frame to frame, and from pixel to pixel.
    earlier = kelvin[:-1] - 250.0
    later = kelvin[1:] - 250.0
    assert abs((earlier * later).mean()) < 0.01 * 0.09**2
    neighbour_product = (
        (kelvin[:, :, 1:] - 250.0) * (kelvin[:, :, :-1] - 250.0)
    ).mean()
    assert abs(neighbour_product) < 0.01 * 0.09**2


def test_noise_is_that_of_its_seed_and_time():
    radiance = np.full((4, 5), 60.0)
    first, again = (seen(radiance, jt.DetectorNoise(seed=3), time=2.0) for _ in "ab")
    np.testing.assert_array_equal(first, again)
    other_time = seen(radiance, jt.DetectorNoise(seed=3), time=3.0)
    other_seed = seen(radiance, jt.DetectorNoise(seed=4), time=2.0)
    assert (first != other_time).all() and (first != other_seed).all()


def test_fixed_pattern_is_the_same_in_all_frames():
    radiance = np.full((200, 300), float(LONG_WAVE.radiance(300.0)))
    pattern = jt.FixedPatternNoise(netd=0.02, columns=0.05, seed=1)
    first, second = (seen(radiance, pattern, time=t) for t in (0.0, 5.0))
    np.testing.assert_array_equal(first, second)
    kelvin = np.asarray(LONG_WAVE.temperature(first)) - 300.0
    columns = kelvin.mean(axis=0)
    assert columns.std() == pytest.approx(0.05, rel=0.1)
    assert (kelvin - columns).std() == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize("bits", [8, 14, 16])
def test_counts_are_steps_of_radiance_within_the_range(bits):
    kelvin = np.linspace(270.0, 330.0, 400).reshape(20, 20)
    radiance = np.asarray(LONG_WAVE.radiance(kelvin))
    read = seen(radiance, jt.Counts(280.0, 320.0, bits=bits))
    low, high = (float(LONG_WAVE.radiance(k)) for k in (280.0, 320.0))
    step = (high - low) / (2**bits - 1)
    counts = (read - low) / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
    assert counts.min() == pytest.approx(0) and counts.max() == pytest.approx(
        2**bits - 1
    )
    inside = (radiance > low) & (radiance < high)
    # The look-up table of a band on the host is not exact.
    assert np.abs(read - radiance)[inside].max() < step / 2 * 1.001


def test_a_bolometer_follows_a_ramp_with_its_time_constant():
    tau = 0.3
    slope = 2.0
    times = np.array([0.0, 0.1, 0.25, 0.6, 1.5])
    frames = [flat(np.full((2, 2), 50.0 + slope * t), t) for t in times]
    lag = in_order((jt.BolometerLag(tau),))
    for k, time in enumerate(times):
        image = _Recording(frames.__getitem__, times, lag).frame(k)
        # y = L - slope tau (1 - exp(-t / tau)) from y = L at the start.
        behind = slope * tau * (1 - math.exp(-time / tau))
        expected = 50.0 + slope * time - behind
        np.testing.assert_allclose(image.radiance, expected, rtol=1e-12)


def test_a_bolometer_forgets_what_was_long_ago():
    times = np.arange(0.0, 100.0)
    drawn = []

    def reaching(k: int) -> Image:
        drawn.append(k)
        return flat(np.full((2, 2), 50.0 + k), times[k])

    lag = in_order((jt.BolometerLag(0.01),))
    image = _Recording(reaching, times, lag).frame(99)
    assert min(drawn) == 98
    np.testing.assert_allclose(image.radiance, 149.0 - 0.01, rtol=1e-12)


def test_noise_on_a_sky_without_radiance_has_a_temperature_still():
    dark = seen(np.zeros((30, 30)), jt.DetectorNoise(0.05))
    assert (dark > 0).all()
    assert np.isfinite(np.asarray(LONG_WAVE.temperature(dark))).all()


def test_frames_in_order_are_drawn_once_and_as_if_alone():
    times = np.array([0.0, 0.05, 0.3, 0.4, 2.0])
    drawn = []

    def reaching(k: int) -> Image:
        drawn.append(k)
        return flat(np.full((2, 2), 50.0 + 3 * k**2), times[k])

    lag = in_order((jt.BolometerLag(0.2),))
    detector = _Recording(reaching, times, lag)
    in_turn = [np.asarray(detector.frame(k).radiance) for k in (0, 2, 3, 4)]
    assert drawn == [0, 2, 1, 3, 4]
    for k, radiance in zip((0, 2, 3, 4), in_turn, strict=True):
        alone = _Recording(reaching, times, lag).frame(k).radiance
        np.testing.assert_allclose(radiance, alone, rtol=1e-12)
    # Back in time nothing later is remembered.
    again = np.asarray(detector.frame(2).radiance)
    np.testing.assert_array_equal(again, in_turn[1])
