"""Direction of the sun against published values, axes, zones and mistakes."""

import importlib.util
from datetime import UTC, datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from jaxthermo.errors import InputError
from jaxthermo.weather.sun_position import Place, instant, rays, sun_path


GOLDEN = Place(39.742476, -105.1786, 1830.14)
MOUNTAIN = timezone(timedelta(hours=-7))
SPA_TIME = datetime(2003, 10, 17, 12, 30, 30, tzinfo=MOUNTAIN)


def directions(place, times):
    return rays(place, np.array([instant(time) for time in times]))


def test_published_position():
    """Reda and Andreas (2004), table A5.1, there with 820 hPa and 11 degC."""
    x, y, z = -directions(GOLDEN, [SPA_TIME])[0]
    assert_allclose(np.degrees(np.arccos(z)), 50.11162, atol=3e-4)
    assert_allclose(np.degrees(np.arctan2(x, y)) % 360, 194.34024, atol=1e-4)


def test_zones_of_one_instant_agree():
    rows = directions(GOLDEN, [SPA_TIME, SPA_TIME.astimezone(UTC)])
    assert_array_equal(rows[0], rows[1])


def test_rays_travel_west_in_the_morning_and_north_at_noon():
    equinox = datetime(2024, 3, 20, tzinfo=UTC)
    hours = [equinox + timedelta(hours=h) for h in (7, 12, 17, 0)]
    morning, noon, evening, night = directions(Place(45.0, 0.0), hours)
    assert morning[0] < -0.5 and evening[0] > 0.5
    assert noon[1] > 0.6 and noon[2] < -0.6
    assert night[2] > 0.6


def test_north_turns_the_scene():
    plain = directions(GOLDEN, [SPA_TIME])[0]
    turned_place = Place(39.742476, -105.1786, 1830.14, north=(2.0, 0.0))
    turned = directions(turned_place, [SPA_TIME])[0]
    assert_allclose(turned, [plain[1], -plain[0], plain[2]], atol=1e-14)


def test_polar_night():
    start = datetime(2024, 12, 21, tzinfo=UTC)
    path = sun_path(Place(80.0, 20.0), start, 86400.0)
    assert all(path(time)[2] > 0 for time in np.linspace(0.0, 86400.0, 25))


def test_path_over_a_leap_day():
    start = datetime(2024, 2, 28, 12, tzinfo=UTC)
    path = sun_path(GOLDEN, start, 2 * 86400.0)
    leap_noon = datetime(2024, 2, 29, 12, tzinfo=UTC)
    exact = directions(GOLDEN, [leap_noon])[0]
    assert_allclose(path(86400.0), exact, atol=1e-9)


def test_path_over_a_change_of_the_clock():
    """Zürich's clocks jumped from 2 to 3 o'clock on 31 March 2024."""
    start = datetime(2024, 3, 30, 12, tzinfo=ZoneInfo("Europe/Zurich"))
    path = sun_path(Place(47.4, 8.5), start, 86400.0)
    exact = sun_path(Place(47.4, 8.5), start.astimezone(UTC), 86400.0)
    assert_array_equal(path(86400.0), exact(86400.0))


def test_mistakes(monkeypatch):
    with pytest.raises(InputError, match="latitude=.*91"):
        Place(91.0, 0.0)
    with pytest.raises(InputError, match="has no direction"):
        Place(0.0, 0.0, north=(0.0, 0.0))
    with pytest.raises(InputError, match="has no zone"):
        directions(GOLDEN, [datetime(2024, 1, 1)])
    with pytest.raises(InputError, match="give positive"):
        sun_path(GOLDEN, SPA_TIME, 0.0)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install '\.\[weather\]'"):
        directions(GOLDEN, [SPA_TIME])
