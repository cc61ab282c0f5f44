"""The wake's function: its limits, its fit to a computed wake, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.physics.convection.wake import WakeDeficit, wake_speed_ratio
from tests.slopes import check_gradient


# Centreline of a computed steady wake at Re 20: x / D from the centre, u / U.
DISTANCE = [2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0]
SHARE = [0.06025, 0.11338, 0.16275, 0.24769, 0.31599, 0.43587]
SHARE += [0.51193, 0.60210, 0.65397, 0.71253, 0.74630, 0.77073]


def test_the_defaults_fit_the_computed_wake():
    speed_ratio = WakeDeficit()(jnp.asarray(np.array(DISTANCE) - 0.5))
    error = np.asarray(speed_ratio) - SHARE
    assert np.sqrt((error**2).mean()) < 0.02 and np.abs(error).max() < 0.04


def test_it_rises_from_nearly_still_to_the_undisturbed_wind():
    x = jnp.asarray(np.concatenate([[0.0], np.geomspace(1e-3, 1e8, 200)]))
    share = np.asarray(WakeDeficit()(x))
    assert 0 < share[0] < 0.05 and share[-1] == pytest.approx(1.0, abs=2e-4)
    assert (np.diff(share) >= 0).all() and share.max() <= 1


def test_where_nothing_is_upstream_there_is_no_wake_and_no_slope():
    x = np.array([0.0, 2.0, np.inf])
    share = wake_speed_ratio(WakeDeficit(), x)
    assert share[2] == 1.0

    def undisturbed(*parameters):
        return wake_speed_ratio(WakeDeficit(*parameters), x)[2]

    assert jax.grad(undisturbed, (0, 1, 2))(1.0, 2.0, 0.5) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("x", [0.0, 0.7, 30.0])
def test_gradients_by_its_parameters_are_right(x):
    def ratio(parameters):
        amplitude, length, exponent = parameters
        return WakeDeficit(amplitude, length, exponent)(jnp.array(x))

    check_gradient(ratio, [1.1, 2.0, 0.5], step=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    "parameters",
    [{"amplitude": 0.0}, {"amplitude": 1.4}, {"length": -1.0}, {"exponent": 2.0}]
    + [{"length": np.nan}, {"exponent": 0.1}],
)
def test_parameters_out_of_range_are_refused(parameters):
    (name,) = parameters
    with pytest.raises(InputError, match=f"WakeDeficit\\({name}="):
        WakeDeficit(**parameters)


@pytest.mark.parametrize("bad", [0.0, -0.2, 1.2, np.nan])
def test_a_share_that_is_none_is_refused(bad):
    with pytest.raises(InputError, match="at x/D = 3"):
        wake_speed_ratio(lambda x: 0 * x + bad, np.array([np.inf, 3.0]))
