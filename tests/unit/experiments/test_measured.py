"""The measured cases: their data, their folds, and what happens without them."""

import numpy as np
import pytest

from calibrate.problem.parameters import Parameter, ParameterSet
from experiments import catalogue
from experiments.harness.case import REPORTED, Group, Row, case, check, near
from experiments.measured import data, literature, peers, soil
from experiments.measured.folds import Residuals, fitted, judged, left_out, rms
from experiments.measured.rows import by_group, fitted_values, limited


def test_without_the_folder_a_line_says_so(monkeypatch, tmp_path, capsys):
    """The cases of the literature are compared all the same."""

    @case("one", title="a number", source="none", requirement="1 +- 0.1")
    def one():
        yield near("number", 1.0, 1.0, tolerance=0.1)

    monkeypatch.setattr(literature, "GROUP", Group("Literature", (one,)))
    monkeypatch.delenv(data.VARIABLE, raising=False)
    (experiment,) = catalogue.find("measured")
    catalogue.run(experiment, tmp_path)
    line, *table = capsys.readouterr().out.splitlines()
    assert data.VARIABLE in line
    assert "1 of 1 cases pass" in "".join(table)


def test_days_that_are_apart_follow_each_other(monkeypatch, tmp_path):
    rows = ["2020-03-18 23:59:00,1", "2020-03-20 00:01:00,2", "2020-03-20 00:02:00,"]
    (tmp_path / "a.csv").write_text("\n".join(["time,air", *rows]) + "\n")
    monkeypatch.setenv(data.VARIABLE, str(tmp_path))
    columns = data.read_module("a.csv")
    np.testing.assert_array_equal(columns["time"], [0.0, 120.0, 180.0])
    np.testing.assert_array_equal(columns["day"], [0, 1, 1])
    np.testing.assert_allclose(columns["hour"], [24 - 1 / 60, 1 / 60, 1 / 30])
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


def _night(rows=30):
    one = np.ones(rows)
    return {
        "time": 60.0 * np.arange(rows),
        "irradiance_plane_W_m2": 0 * one,
        "wind_speed_m_s": 2 * one,
        "air_temperature_C": 20 * one,
    }


def test_only_peers_with_a_sky_are_colder_than_the_air_at_night():
    models = dict(peers.MODELS)
    assert (models.pop("Fuentes (pvlib)")(_night())[10:] < 19.0).all()
    for model in models.values():
        np.testing.assert_allclose(model(_night()), 20.0)


def test_errors_by_group():
    """Groups without a time have no row."""
    is_early = np.array([True, True, False])
    groups = {"early": is_early, "late": ~is_early, "never": np.zeros(3, bool)}
    rows = list(by_group("times", groups, {"a": np.array([3.0, -4.0, 2.0])}))
    assert [row.solver for row in rows] == ["early", "late"]
    bias, deviation = rows[0].checks
    assert bias.computed == -0.5 and deviation.computed == pytest.approx(12.5**0.5)


def test_only_numbers_with_limits_are_judged():
    free = limited("a", 2.0, np.inf)
    assert free.passes is None and Row("a", checks=(free,)).verdict == REPORTED
    assert limited("a", -2.0, 3.0).passes is True
    assert limited("a", -4.0, 3.0).passes is False


def test_fitted_values_have_standard_errors_and_verdicts():
    """A line: the textbook's standard errors, and one value that has no effect."""
    x = np.linspace(-1.0, 1.0, 41)
    noise = 0.1 * np.cos(7 * np.arange(41.0))
    columns = np.stack([np.ones(41), x, 0 * x], axis=1)
    line = Residuals(
        lambda z: columns @ z - (0.5 + 0.2 * x + noise), lambda z: columns, 3
    )
    names = ("a", "b", "c")
    # Without bounds a value is 1 + z.
    parameters = ParameterSet(tuple(Parameter(name, (1.0,)) for name in names))
    used = np.ones(41, bool)
    z = fitted(line, used)
    exact, *_ = np.linalg.lstsq(columns[:, :2], 0.5 + 0.2 * x + noise, rcond=None)
    np.testing.assert_allclose(z[:2], exact, atol=1e-5)
    sd = np.sqrt(np.sum(line.at(z) ** 2) / (41 - 3))
    identified = judged(parameters, line, z=z, used=used)
    a, b, c = fitted_values(identified, dict(zip(names, names, strict=True)))
    assert a.checks[0].computed == pytest.approx(1 + z[0], rel=1e-6)
    assert a.checks[1].computed == pytest.approx(sd / 41**0.5, rel=1e-6)
    assert b.checks[1].computed == pytest.approx(sd / np.sum(x**2) ** 0.5, rel=1e-6)
    assert c.seen == "dead" and np.isnan(c.checks[1].computed)


def test_soil_with_a_linear_profile_stays_as_it_is():
    depths = (0.0, 0.5, 1.0, 2.0)
    names = ("ground_0cm_degC", *(f"ground_{100 * d:.0f}cm_degC" for d in depths[1:]))
    columns = {
        name: np.full(4, 10.0 + 3.0 * depth)
        for name, depth in zip(names, depths, strict=True)
    }
    columns["time_s"] = 600.0 * np.arange(4.0)
    errors = soil.errors(columns, "moist_soil")
    assert list(errors) == ["ground_50cm_degC", "ground_100cm_degC"]
    np.testing.assert_allclose(list(errors.values()), 0.0, atol=1e-9)


def test_the_worst_number_is_the_one_nearest_to_its_limit():
    """What is only reported is behind all that has a limit."""

    @case("one", title="errors", source="none", requirement="1 K, 5 K")
    def one():
        yield Row(checks=(limited("reported", 9.0, np.inf),))
        yield Row(checks=(limited("near", -0.9, 1.0), limited("far", 2.0, 5.0)))

    worst = check(one).worst
    assert worst is not None
    assert worst.name == "near"
