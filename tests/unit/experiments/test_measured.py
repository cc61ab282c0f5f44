"""The measured cases: their data, their folds, and what happens without them."""

import numpy as np
import pytest

from experiments import catalogue
from experiments.measured import data, peers
from experiments.measured.folds import Residuals, left_out, rms


def test_without_the_folder_a_line_says_so(monkeypatch, tmp_path, capsys):
    monkeypatch.delenv(data.VARIABLE, raising=False)
    (experiment,) = catalogue.find("measured")
    with pytest.raises(SystemExit) as ended:
        catalogue.run(experiment, tmp_path)
    assert ended.value.code == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert data.VARIABLE in line


def test_days_that_are_apart_follow_each_other(monkeypatch, tmp_path):
    rows = ["2020-03-18 23:59:00,1", "2020-03-20 00:01:00,2", "2020-03-20 00:02:00,"]
    (tmp_path / "a.csv").write_text("\n".join(["time,air", *rows]) + "\n")
    monkeypatch.setenv(data.VARIABLE, str(tmp_path))
    columns = data.read_module("a.csv")
    np.testing.assert_array_equal(columns["time"], [0.0, 120.0, 180.0])
    np.testing.assert_array_equal(columns["day"], [0, 1, 1])
    np.testing.assert_array_equal(columns["air"], [1.0, 2.0, np.nan])


def test_a_fold_is_computed_with_the_numbers_of_the_others():
    """A mean: the error of each fold is the mean of the others less its values."""
    values = np.array([1.0, 2.0, 4.0, 7.0])
    mean = Residuals(lambda z: z[0] - values, lambda z: np.ones((4, 1)), 1)
    fold = np.array([0, 0, 1, 2])
    errors = left_out(mean, fold, used=np.array([True, True, True, False]))
    np.testing.assert_allclose(errors, [3.0, 2.0, -2.5, 7 / 3 - 7], rtol=1e-6)
    assert rms(np.array([3.0, 4.0])) == pytest.approx(np.sqrt(12.5))


def test_faiman_with_a_lag_follows_a_step():
    time = np.arange(0.0, 3000.0, 60.0)
    one = np.ones(len(time))
    columns = {
        "time": time,
        "day": 0 * one,
        "irradiance_plane_W_m2": np.where(time < 600.0, 0.0, 1000.0),
        "wind_speed_m_s": 2 * one,
        "air_temperature_C": 20 * one,
        "module_temperature_C": 20 * one,
    }
    excess = peers.faiman_with_lag(columns).at(np.zeros(3))
    steady = 1000.0 / (25.0 + 2 * 6.84)
    expected = steady * (1 - np.exp(-(time - 540.0) / 600.0))
    np.testing.assert_allclose(excess, np.maximum(expected, 0.0)[1:], rtol=1e-9)
