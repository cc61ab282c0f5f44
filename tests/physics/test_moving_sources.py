"""Moving sources are evaluated at snapshots; varying strengths need none."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.physics.radiation.area_source import AreaSource
from jaxthermo.physics.radiation.source import PointSource, Sun


def turning(time):
    return (-np.cos(0.1 * time), 0.0, -np.sin(0.1 * time))


def rising(time):
    return [0.0, 0.1, 0.5 + 0.1 * time]


SUN = Sun(turning, 800.0)
LAMP = PointSource(rising, 10.0)
PANEL = AreaSource(rising, (0, 0, -1.0), (0.2, 0.1), radiance=100.0)


@pytest.mark.parametrize("source", [SUN, LAMP, PANEL], ids=lambda s: s.name)
def test_frozen_they_stand_still(source):
    assert source.moves
    for time in (0.0, 3.5):
        still = source.at(time)
        assert not still.moves and type(still) is type(source)
        assert still.at(99.0) is still
        assert still.strength is source.strength
    position = np.array([[0.0, 0.0, 0.0]])
    up = np.array([[0.0, 0.0, 1.0]])
    none = np.zeros((0, 3, 3))
    first, second = (
        source.at(t).exposure(none, position, up, 0.01)[0] for t in (1.0, 5.0)
    )
    assert first > 0 and second > 0 and abs(first / second - 1) > 0.3


def test_where_they_are_frozen():
    assert SUN.at(2.0).direction == pytest.approx(turning(2.0))
    assert LAMP.at(2.0).position == pytest.approx((0.0, 0.1, 0.7))
    assert PANEL.at(2.0).centre == pytest.approx((0.0, 0.1, 0.7))
    assert PANEL.at(2.0).size == PANEL.size
    still = Sun([0, 0, -1], 800.0)
    assert still.direction == (0.0, 0.0, -1.0) and not still.moves


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda f: Sun(f, 1.0), "direction"),
        (lambda f: PointSource(f, 1.0), "position"),
        (lambda f: AreaSource(f, (0, 0, 1.0), (1.0, 1.0), radiance=1.0), "centre"),
    ],
)
def test_a_path_that_goes_nowhere_is_refused_when_it_does(make, says):
    with pytest.raises(jt.InputError, match=says):
        make(lambda time: "up")
    lost = make(lambda time: (0.0, 1.0, 1.0) if time < 1 else (0.0, 0.0))
    with pytest.raises(jt.InputError, match=f"{says}=.* at 5 s"):
        lost.at(5.0)
