"""Next action of a fit after given histories of steps."""

import jax.numpy as jnp
import pytest

from calibrate.solvers.progress import StepRecord, next_action


SIZE = 4


def step(loss, accepted, length=0.0, exact=True, refresh=False):
    return StepRecord(
        number=1,
        loss=loss,
        accepted=accepted,
        length=length,
        values=(),
        exact=exact,
        refresh=refresh,
    )


def refreshed(loss=1.0):
    return step(loss, accepted=True, refresh=True)


def accepted(loss, exact=False):
    return step(loss, accepted=True, length=0.1, exact=exact)


def rejected(loss, exact=False, length=0.01):
    return step(loss, accepted=False, length=length, exact=exact)


def then(*steps, done=False):
    return next_action(
        list(steps), done=done, size=SIZE, tolerance=1e-3, dtype=jnp.float32
    )


def after_second_refresh(*steps, done=False):
    """Return the action after a failed trial, an exact Jacobian and these steps."""
    return then(
        refreshed(),
        accepted(0.5),
        rejected(0.5),
        refreshed(0.5),
        *steps,
        done=done,
    )


def after_standstill(*steps, done=False):
    """Return the action after two trials that left the loss as it was, and these."""
    return then(
        refreshed(),
        accepted(0.5),
        accepted(0.3),
        accepted(0.3),
        accepted(0.3),
        *steps,
        done=done,
    )


def test_a_fit_begins_with_an_exact_jacobian_and_then_tries():
    assert then() == "refresh"
    assert then(refreshed()) == "try"
    # What the solver says of a step that went nowhere does not count.
    assert then(refreshed(), done=True) == "try"


def test_it_tries_on_while_the_loss_falls():
    assert then(refreshed(), accepted(0.5)) == "try"
    assert then(refreshed(), accepted(0.5), accepted(0.4), accepted(0.39)) == "try"


def test_a_trial_that_fails_by_a_kept_jacobian_asks_for_an_exact_one():
    assert then(refreshed(), accepted(0.5), rejected(0.5)) == "refresh"
    # Here it was exact: the trial was too long.
    assert then(refreshed(), rejected(1.0)) == "try"
    assert then(refreshed(), accepted(0.5, exact=True), rejected(0.5)) == "try"


def test_a_refresh_is_no_trial_and_two_trials_follow_it():
    assert after_second_refresh(rejected(0.5)) == "try"
    assert after_second_refresh(rejected(0.5), rejected(0.5)) == "end"
    assert after_second_refresh(accepted(0.49995), accepted(0.4999)) == "end"
    assert after_second_refresh(rejected(0.5), accepted(0.4)) == "try"


def test_long_trials_are_not_the_last():
    far = rejected(1.0, length=0.5)
    assert then(refreshed(), far, far) == "try"
    assert then(refreshed(), far, rejected(1.0), rejected(1.0)) == "end"


@pytest.mark.parametrize("done", [False, True])
def test_it_does_not_end_by_a_jacobian_of_other_points(done):
    assert after_standstill(done=done) == "refresh"
    assert (
        after_standstill(refreshed(0.3), accepted(0.3), accepted(0.3), done=done)
        == "end"
    )


def test_it_does_not_refresh_again_where_the_last_refresh_was_not_worth_it():
    """Of four numbers: worth three times the tolerance."""
    for loss, action in ((0.499, "end"), (0.498, "refresh")):
        assert after_second_refresh(accepted(loss), rejected(loss)) == action
        assert (
            after_second_refresh(accepted(loss), accepted(loss), accepted(loss))
            == action
        )
        assert after_second_refresh(accepted(loss), done=True) == "end"
        assert (
            after_second_refresh(accepted(loss), accepted(loss - 1e-5), done=True)
            == action
        )


def test_the_solver_ends_a_fit_by_one_trial_from_an_exact_jacobian():
    assert then(refreshed(), accepted(0.5), done=True) == "end"
    assert then(refreshed(), accepted(0.5), accepted(0.3), done=True) == "refresh"
    assert (
        then(refreshed(), accepted(0.5, True), accepted(0.3, True), done=True) == "end"
    )


def test_a_loss_at_its_rounding_is_stagnant():
    tiny = 1.0 - 1e-7
    steps = [refreshed(), accepted(tiny), accepted(tiny)]
    assert (
        next_action(steps, done=False, size=SIZE, tolerance=0.0, dtype=jnp.float32)
        == "end"
    )
    assert (
        next_action(steps, done=False, size=SIZE, tolerance=0.0, dtype=jnp.float64)
        == "try"
    )
