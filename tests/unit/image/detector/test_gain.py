"""Automatic gain by the histogram of a frame."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.image.detector.gain import plateau_gain


GENERATOR = np.random.default_rng(5)
ALL = np.ones((60, 80), bool)


def test_an_equalized_frame_uses_all_positions_alike():
    kelvin = 300 + 4 * GENERATOR.standard_normal(ALL.shape)
    gain = plateau_gain(kelvin, ALL, low=280.0, high=330.0, plateau=1.0)
    positions = np.sort(gain.positions(kelvin).ravel())
    even = (np.arange(ALL.size) + 0.5) / ALL.size
    # To the width of a bin.
    np.testing.assert_allclose(positions, even, atol=0.01)


def test_an_even_temperature_does_not_take_all_levels():
    """Nine tenths of the frame at one temperature, the rest spread over 10 K."""
    kelvin = np.full(ALL.shape, 290.0)
    few = GENERATOR.random(ALL.shape) < 0.1
    kelvin[few] = 300 + 10 * GENERATOR.random(int(few.sum()))
    equal, cut = (
        plateau_gain(kelvin, ALL, low=280.0, high=320.0, plateau=p)
        for p in (1.0, 0.002)
    )
    widths = [float(np.ptp(gain.positions(kelvin[few]))) for gain in (equal, cut)]
    assert widths[0] < 0.11 and widths[1] > 0.9


def test_positions_are_monotone_and_keep_the_ends_and_nan():
    kelvin = 300 + 30 * GENERATOR.random(ALL.shape)
    gain = plateau_gain(kelvin, ALL, low=305.0, high=320.0)
    line = np.linspace(290.0, 340.0, 500)
    positions = gain.positions(line)
    assert (np.diff(positions) >= 0).all()
    assert positions[0] == 0 and positions[-1] == 1
    assert np.isnan(gain.positions(np.array([np.nan]))).all()
    # Uniformly spread temperatures stay linear.
    inside = (line > 306) & (line < 319)
    np.testing.assert_allclose(positions[inside], (line[inside] - 305) / 15, atol=0.2)


def test_only_pixels_of_bodies_count():
    kelvin = np.where(np.arange(80) < 40, 285.0, 300 + 10 * GENERATOR.random(ALL.shape))
    bodies = np.broadcast_to(np.arange(80) >= 40, ALL.shape)
    gain = plateau_gain(kelvin, bodies, low=280.0, high=320.0)
    assert gain.positions(np.array([285.0]))[0] == 0
    none = plateau_gain(kelvin, ~ALL, low=280.0, high=320.0)
    assert none.positions(np.array([300.0]))[0] == pytest.approx(0.5)


@pytest.mark.parametrize("plateau", [0.0, -1.0, 1.5, float("nan")])
def test_a_plateau_beyond_its_range_is_refused(plateau):
    with pytest.raises(jt.InputError, match="plateau"):
        plateau_gain(
            np.full(ALL.shape, 300.0), ALL, low=280.0, high=320.0, plateau=plateau
        )
