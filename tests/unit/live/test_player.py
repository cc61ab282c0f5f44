"""Play, pause and reset against a clock, and the times of a finished run."""

import math

import numpy as np
import pytest
from scipy.sparse import csr_array

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.integrate.run.solution_file import load_run
from jaxthermo.live.playback import Playback
from jaxthermo.live.player import Player
from tests.bodies import blocks


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    grid = blocks(np.ones((2, 2, 3), bool), 0.01)
    body = jt.Body(jt.FullVolume(grid), jt.materials["copper"], temperature=350.0)
    terms = jt.Sun((-1.0, 0.0, -1.0), 800.0), jt.Surroundings(280.0)
    scene = jt.Scene((body,), terms)
    folder = tmp_path_factory.mktemp("run")
    jt.simulate(scene, 40.0, [10.0, 20.0, 40.0]).save(folder)
    return load_run(folder)


@pytest.fixture
def playback(stored):
    return Playback(stored)


def test_a_finished_run_is_linear_between_saved_times(playback, stored):
    rows = np.asarray(stored.surface_temperature)
    assert (playback.start, playback.time, playback.end) == (10.0, 10.0, 40.0)
    np.testing.assert_array_equal(playback.temperature, rows[0])
    playback.advance_to(15.0)
    np.testing.assert_allclose(playback.temperature, rows[:2].mean(axis=0), rtol=1e-6)
    playback.seek(99.0)
    assert playback.finished
    np.testing.assert_allclose(playback.temperature, rows[2], rtol=1e-7)
    received = playback.irradiance()
    last = [rows[-1] for rows in stored.irradiances]
    for actual, expected in zip(received, last, strict=True):
        np.testing.assert_allclose(actual, expected, rtol=1e-6)
    playback.reset()
    assert playback.time == 10.0


def test_curves_of_a_finished_run_are_its_saved_times(playback, stored):
    weights = np.zeros((1, stored.surface_temperature.shape[1]))
    weights[0, 5] = 1
    curves = playback.curves(csr_array(weights))
    assert curves.times.tolist() == [10.0, 20.0, 40.0]
    np.testing.assert_array_equal(curves.kelvin[0], stored.surface_temperature[:, 5])


def test_a_run_with_one_saved_time_is_refused(stored):
    kelvin = stored.surface_temperature[:1]
    single = StoredSolution(stored.times[:1], kelvin, stored.surfaces)
    with pytest.raises(InputError, match="saved one time only"):
        Playback(single)


def test_playing_follows_the_clock(playback):
    player = Player(playback, 10.0)
    assert not player.tick(5.0)
    player.play()
    # The first reading only starts the clock.
    assert not player.tick(5.0)
    assert player.tick(5.1)
    assert playback.time == pytest.approx(11.0)
    player.set_rate(20.0)
    assert player.tick(5.2)
    assert playback.time == pytest.approx(13.0)
    player.pause()
    assert not player.tick(5.3)
    player.play()
    player.tick(9.0)
    assert playback.time == pytest.approx(13.0)
    player.reset()
    assert (playback.time, player.playing) == (10.0, False)


def test_a_clock_that_stood_still_makes_no_jump(playback):
    player = Player(playback, 10.0)
    player.play()
    player.tick(0.0)
    player.tick(100.0)
    assert playback.time <= 10.0 + 0.25 * 10.0


def test_the_end_stops_and_play_begins_again(playback):
    player = Player(playback, 200.0)
    player.play()
    for k in range(5):
        player.tick(0.1 * k)
    assert playback.finished and not player.playing
    player.play()
    assert playback.time == 10.0 and player.playing


def test_speeds_are_those_of_the_last_seconds(playback):
    player = Player(playback, 2.0)
    assert player.speeds() is None
    player.play()
    for k in range(101):
        player.tick(0.05 * k)
    assert player.speeds() == (pytest.approx(2.0), pytest.approx(20.0))
    player.pause()
    assert player.speeds() is None


def test_a_tick_that_shows_nothing_new_is_no_frame(playback, monkeypatch):
    player = Player(playback, 2.0)
    player.play()
    seek = playback.seek

    def seek_whole_steps(time: float) -> None:
        # As a simulation whose steps are as long as two ticks.
        seek(0.2 * math.floor(time / 0.2 + 1e-6))

    monkeypatch.setattr(playback, "seek", seek_whole_steps)
    for k in range(101):
        player.tick(0.05 * k)
    assert player.speeds() == (pytest.approx(2.0), pytest.approx(10.0))


@pytest.mark.parametrize("rate", [0.0, -1.0, float("inf"), float("nan")])
def test_a_rate_must_be_positive(playback, rate):
    with pytest.raises(InputError, match="simulated seconds"):
        Player(playback, rate)
