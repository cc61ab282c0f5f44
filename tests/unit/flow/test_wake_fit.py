"""Fits of wakes: known curves are found again, and the shipped data are reproduced."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxthermo
from experiments.thesis.wake_data import fitted
from jaxthermo.flow.wake_fit import FAMILIES, fit_family, tail_length, write_fits
from jaxthermo.flow.wake_runs import (
    SHEDDING_REYNOLDS,
    STEADY_REYNOLDS,
    WakeProfile,
    WakeSetup,
    wake_profile,
    wake_run,
    wake_setup,
    write_profiles,
)


DATA = Path(jaxthermo.__file__).parent / "data"
X = np.linspace(0.5, 25.0, 60)
TRUE = {
    "exponential": (0.9, 5.0),
    "power": (1.1, 2.5, 0.6),
    "confined": (1.1, 2.5, 0.6, 20.0),
    "remainder": (1.3, 4.0, 0.25),
}


def read_profiles(path: Path) -> tuple[WakeProfile, ...]:
    """Profiles from a CSV file."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    profiles = []
    for reynolds in np.unique(rows[:, 0]):
        x, y, ratio = rows[rows[:, 0] == reynolds, 1:].T
        profiles.append(WakeProfile(float(reynolds), x=x, y=y, ratio=ratio))
    return tuple(profiles)


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_a_known_curve_is_found_again(family):
    exact = np.asarray(family.curve(jnp.asarray(TRUE[family.name]), jnp.asarray(X)))
    fit = fit_family(family, X, exact)
    np.testing.assert_allclose(fit.values, TRUE[family.name], rtol=1e-4)
    assert fit.rms < 1e-6


def test_standard_errors_are_the_scatter_of_repeated_fits():
    family = FAMILIES[1]
    random = np.random.default_rng(3)
    exact = np.asarray(family.curve(jnp.asarray(TRUE["power"]), jnp.asarray(X)))
    fits = [
        fit_family(family, X, exact + random.normal(0, 0.01, 60)) for _ in range(25)
    ]
    scatter = np.std([fit.values for fit in fits], axis=0)
    stated = np.median([fit.errors for fit in fits], axis=0)
    np.testing.assert_allclose(stated / scatter, 1.0, atol=0.4)
    assert np.median([fit.rms for fit in fits]) == pytest.approx(0.01, rel=0.1)


def test_a_wake_without_a_scale_leaves_amplitude_and_length_undetermined():
    """Of 1 - c x^(-p) the power family finds p, but of A and l only A l^p = c."""
    fit = fit_family(FAMILIES[1], X, 1 - 0.6 * X**-0.4)
    a, length, exponent = fit.values
    assert exponent == pytest.approx(0.4, rel=1e-4)
    assert a * length**exponent == pytest.approx(0.6, rel=1e-4)
    assert (fit.errors[:2] > fit.values[:2]).all() and fit.errors[2] < 1e-3


def test_the_length_of_a_tail():
    assert tail_length(X, 1 - np.exp(-X / 3)) == pytest.approx(3 * np.log(10), abs=0.02)
    assert tail_length(X, 0.95 + 0 * X) == 0.0
    assert tail_length(X, 0.5 + 0 * X) == np.inf


def test_profiles_are_written_and_read(tmp_path):
    slow = WakeProfile(reynolds=20.0, x=X, y=0 * X, ratio=1 - np.exp(-X))
    fast = WakeProfile(reynolds=100.0, x=X, y=0.5 + 0 * X, ratio=1 - np.exp(-2 * X))
    write_profiles(tmp_path / "a.csv", [slow, fast])
    profiles = read_profiles(tmp_path / "a.csv")
    assert [profile.reynolds for profile in profiles] == [20.0, 100.0]
    np.testing.assert_allclose(profiles[1].ratio, fast.ratio, atol=1e-5)
    np.testing.assert_allclose(profiles[1].x, X, rtol=1e-3)


def test_the_shipped_fit_is_that_of_the_shipped_profiles(tmp_path):
    profiles = read_profiles(DATA / "wake_profiles.csv")
    numbers = tuple(profile.reynolds for profile in profiles)
    assert numbers == (*STEADY_REYNOLDS, *SHEDDING_REYNOLDS)
    fits = fitted(profiles)
    assert max(fit.rms for fit in fits) < 0.03
    write_fits(tmp_path / "fit.csv", fits)

    def read(path):
        return np.genfromtxt(
            path, delimiter=",", skip_header=1, usecols=(1, 2, 3, 5, 7)
        )

    shipped = read(DATA / "wake_fit.csv")
    np.testing.assert_allclose(
        read(tmp_path / "fit.csv"), shipped, rtol=2e-3, atol=1e-9
    )


# The flow behind a cylinder is computed by default in `test_cylinder`.
@pytest.mark.slow
@pytest.mark.slice
def test_a_coarse_flow_gives_the_wake_within_a_few_percent():
    """A tenth of the size, in a narrow channel."""
    setup = WakeSetup(cells=6, height=16.0, upstream=6.0, downstream=12.0, passes=3.0)
    profile = wake_profile(wake_run(20.0, setup), 20.0)
    shipped = read_profiles(DATA / "wake_profiles.csv")[1]
    middle = shipped.y == 0
    near = (profile.y == 0) & (profile.x < 6)
    expected = np.interp(profile.x[near], shipped.x[middle], shipped.ratio[middle])
    assert np.abs(profile.ratio[near] - expected).max() < 0.08
    assert wake_setup(60.0, 7).cells == 7


@pytest.mark.slow
@pytest.mark.parametrize("reynolds", [20.0, 100.0])
def test_the_command_makes_the_shipped_profiles_again(reynolds):
    profile = wake_profile(wake_run(reynolds), reynolds)
    profiles = {p.reynolds: p for p in read_profiles(DATA / "wake_profiles.csv")}
    np.testing.assert_allclose(profile.ratio, profiles[reynolds].ratio, atol=5e-3)
