"""Mistakes in the description of a flow, each in one line before the run."""

import jax
import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.flow.body import RoundBody
from jaxthermo.flow.channel import Channel
from jaxthermo.flow.run import simulate_flow


def mask(rows, columns):
    """A body of cells in a channel of 20 x 40."""
    solid = np.zeros((20, 40), bool)
    solid[rows, columns] = True
    return solid


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"speed": 0.1}, "Mach number 0.173 is not between 0 and 0.15.*below 0.0866"),
        ({"speed": 0.06, "inlet": "poiseuille"}, "Mach number 0.155.*below 0.058"),
        ({"speed": -0.1}, "finite speed of at least 0|Mach number"),
        ({"speed": np.nan}, "Mach number|finite speed"),
        ({"viscosity": 0.0}, "above 0 and up to 1"),
        ({"viscosity": 3.0}, "above 0 and up to 1"),
        ({"viscosity": 1e-3}, "Reynolds number of a cell is 50, above 12: use more"),
        ({"diffusivity": -1.0}, "diffusivity=-1"),
        ({"inlet": "jet"}, "plug or poiseuille"),
        ({"walls": "rough"}, "no_slip or slip or periodic"),
        ({"ends": "closed"}, "open or periodic"),
        ({"shape": (2, 40)}, "at least 4 x 4"),
        ({"body": RoundBody((10.0, 10.0), 17.0)}, "blocks the channel"),
        ({"body": RoundBody((10.0, 5.0), 8.0)}, "touches the lower wall"),
        ({"body": RoundBody((10.0, 14.9), 8.0)}, "touches the upper wall"),
        ({"body": RoundBody((5.0, 10.0), 8.0)}, "touches the inlet"),
        ({"body": RoundBody((35.0, 10.0), 8.0)}, "touches the outlet"),
        ({"body": RoundBody((10.0, 10.0), 0.5)}, "smaller than a cell"),
        ({"body": RoundBody((10.0, np.nan), 5.0)}, "no cylinder"),
        ({"body": mask(slice(None), 5)}, "blocks the channel"),
        ({"body": mask(slice(1, 5), 5)}, "touches the lower wall"),
        ({"body": mask(slice(5, 9), -1)}, "touches the outlet"),
        ({"body": mask(0, slice(0, 0))}, "no cell is solid"),
        ({"body": np.ones((3, 3), bool)}, "of shape"),
    ],
)
def test_a_mistake_is_one_line(options, words):
    usual = {"shape": (20, 40), "speed": 0.05, "viscosity": 0.05, "body": None}
    with pytest.raises(InputError, match=words) as raised:
        Channel(**{**usual, **options})
    assert "\n" not in str(raised.value)


def test_traced_numbers_are_not_refused():
    speed_of_channel = jax.jit(lambda speed: Channel((20, 40), speed, 0.05).speed)
    assert float(speed_of_channel(0.4)) == 0.4


def test_at_least_one_step_is_taken():
    with pytest.raises(InputError, match="whole number"):
        simulate_flow(Channel((20, 40), 0.05, 0.05), 0)


def test_a_flow_too_large_for_memory_is_refused():
    with pytest.raises(InputError, match="use fewer cells"):
        simulate_flow(Channel((10**6, 10**6), 0.05, 0.05), 20)
