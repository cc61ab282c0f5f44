"""What a fit does next, of steps that are written down."""

import jax.numpy as jnp
import pytest

from calibrate.solvers.checkpoint import Step
from calibrate.solvers.stopping_rule import next_of


SIZE = 4


def look(loss=1.0):
    return Step(1, loss, True, 0.0, (), fresh=True, look=True)


def went(loss, fresh=False):
    return Step(1, loss, True, 0.1, (), fresh)


def refused(loss, fresh=False, reach=0.01):
    return Step(1, loss, False, reach, (), fresh)


def then(*steps, done=False):
    return next_of(list(steps), done, SIZE, 1e-3, jnp.float32)


def test_a_fit_begins_with_a_look_and_then_tries():
    assert then() == "look"
    assert then(look()) == "try"
    # What the solver says of a step that went nowhere does not count.
    assert then(look(), done=True) == "try"


def test_it_tries_on_while_the_loss_falls():
    assert then(look(), went(0.5)) == "try"
    assert then(look(), went(0.5), went(0.4), went(0.39)) == "try"


def test_a_trial_that_fails_by_kept_derivatives_asks_for_others():
    assert then(look(), went(0.5), refused(0.5)) == "look"
    # Here they were found: the trial was too long.
    assert then(look(), refused(1.0)) == "try"
    assert then(look(), went(0.5, fresh=True), refused(0.5)) == "try"


def test_a_look_is_no_trial_and_two_are_asked_for_after_it():
    before = [look(), went(0.5), refused(0.5), look(0.5)]
    assert then(*before, refused(0.5)) == "try"
    assert then(*before, refused(0.5), refused(0.5)) == "end"
    assert then(*before, went(0.49995), went(0.4999)) == "end"
    assert then(*before, refused(0.5), went(0.4)) == "try"


def test_trials_that_went_far_are_not_the_last():
    far = refused(1.0, reach=0.5)
    assert then(look(), far, far) == "try"
    assert then(look(), far, refused(1.0), refused(1.0)) == "end"


@pytest.mark.parametrize("done", [False, True])
def test_it_does_not_end_by_derivatives_of_other_points(done):
    still = [look(), went(0.5), went(0.3), went(0.3), went(0.3)]
    assert then(*still, done=done) == "look"
    assert then(*still, look(0.3), went(0.3), went(0.3), done=done) == "end"


def test_it_does_not_look_again_where_the_last_look_was_not_worth_it():
    """Of four numbers: worth three times the tolerance."""
    before = [look(), went(0.5), refused(0.5), look(0.5)]
    for loss, what in ((0.499, "end"), (0.498, "look")):
        assert then(*before, went(loss), refused(loss)) == what
        assert then(*before, went(loss), went(loss), went(loss)) == what
        assert then(*before, went(loss), done=True) == "end"
        assert then(*before, went(loss), went(loss - 1e-5), done=True) == what


def test_the_solver_ends_a_fit_by_one_trial_from_found_derivatives():
    assert then(look(), went(0.5), done=True) == "end"
    assert then(look(), went(0.5), went(0.3), done=True) == "look"
    assert then(look(), went(0.5, True), went(0.3, True), done=True) == "end"


def test_a_loss_at_its_rounding_is_still():
    tiny = 1.0 - 1e-7
    steps = [look(), went(tiny), went(tiny)]
    assert next_of(steps, False, SIZE, 0.0, jnp.float32) == "end"
    assert next_of(steps, False, SIZE, 0.0, jnp.float64) == "try"
