"""Marks and readings on pictures: where they are, and that nothing is cut off."""

import numpy as np
import pytest
from frames import frame

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.image.colour.canvas import INK, PAPER
from jaxthermo.image.colour.draw_measurements import _ISOTHERMS, _reading_in_words
from jaxthermo.image.measurements import Box, Isotherm, Line, Reading, Spot


HEIGHT = 120
WIDTH = 160
IMAGE = frame(np.broadcast_to(np.linspace(290.0, 330.0, WIDTH), (HEIGHT, WIDTH)))
NOTHING = Reading(np.nan, np.nan, np.nan, 0, 0.0)
EACH = [
    Spot((0.5, 0.5)),
    Line(((0.1, 0.9), (0.6, 0.9)), "base"),
    Box(((0.6, 0.2), (0.9, 0.6))),
    Isotherm(above=310.0),
]


def type_name(measurement):
    return type(measurement).__name__


def drawn(measurements):
    plain = jt.picture(IMAGE, 290.0, 330.0, palette="white-hot")
    marked = jt.draw_measurements(plain, IMAGE, measurements)
    return np.asarray(plain), np.asarray(marked)


def changed(measurements):
    """Rows and columns of the frame that differ from the picture without marks."""
    plain, marked = drawn(measurements)
    differs = (plain != marked[: len(plain)]).any(axis=-1)
    # The scale and the time stay as they are.
    assert not differs[HEIGHT:].any() and not differs[:, WIDTH:].any()
    return np.nonzero(differs[:HEIGHT, :WIDTH])


def test_nothing_is_added_without_measurements():
    plain, marked = drawn([])
    np.testing.assert_array_equal(plain, marked)


@pytest.mark.parametrize("measurement", EACH, ids=type_name)
def test_a_mark_is_at_its_pixels(measurement):
    rows, columns = changed([measurement])
    expected_rows, expected_columns = measurement.pixels(np.asarray(IMAGE.temperature))
    if isinstance(measurement, Isotherm):
        # The outline of the warm half, and its rim.
        assert abs(columns.min() - WIDTH // 2) <= 2
        assert set(columns) < set(range(WIDTH // 2 - 3, WIDTH // 2 + 4))
        return
    assert abs(int(np.min(expected_rows)) - rows.min()) < 30
    assert rows.min() <= expected_rows.min() and rows.max() >= expected_rows.max()
    assert columns.min() <= expected_columns.min()
    assert columns.max() >= expected_columns.max()


def test_a_spot_leaves_its_own_pixel_visible():
    plain, marked = drawn([EACH[0]])
    np.testing.assert_array_equal(marked[60, 80], plain[60, 80])


def test_each_reading_is_a_line_below_the_picture():
    plain, marked = drawn(EACH)
    shorter = drawn(EACH[:2])[1]
    assert marked.shape[1] == plain.shape[1]
    assert len(marked) > len(shorter) > len(plain)
    below = marked[len(plain) :]
    # Thin letters are blends with the paper.
    for ink in (INK, _ISOTHERMS[0]):
        assert np.abs(below.astype(int) - ink).sum(axis=-1).min() < 40
    # No text is cut off.
    assert (below[-2:] == PAPER).all() and (below[:, -2:] == PAPER).all()


@pytest.mark.parametrize("at", [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_names_in_corners_are_whole(at):
    """The number of light pixels of a name is that in the middle of the image."""

    def count(at, name):
        _, marked = drawn([Spot(at, name)])
        return (marked[:HEIGHT, :WIDTH] == INK).all(axis=-1).sum()

    middle = count((0.5, 0.5), "mmmm") - count((0.5, 0.5), "m")
    assert count(at, "mmmm") - count(at, "m") == pytest.approx(middle, rel=0.15)


@pytest.mark.parametrize(
    ("measurement", "reading", "words"),
    [
        (EACH[0], Reading(300.0, 300.0, 300.0, 1, 0.1), "26.9 °C"),
        (EACH[2], Reading(300.0, 301.0, 303.0, 9, 0.1), "26.9 to 29.9, mean 27.9 °C"),
        (EACH[2], NOTHING, "background"),
        (EACH[3], Reading(310.0, 312.0, 315.0, 9, 0.123), "> 36.9 °C: 12.3 % of"),
        (Isotherm(below=300.0), NOTHING, "< 26.9 °C: 0.0 % of"),
        (Isotherm(300.0, 310.0), NOTHING, "26.9 to 36.9 °C: "),
    ],
)
def test_readings_in_words(measurement, reading, words):
    assert _reading_in_words(measurement, reading).startswith(words)


def test_a_picture_of_another_frame_is_refused():
    small = frame(np.full((40, 40), 300.0))
    with pytest.raises(InputError, match="for a frame of 160 x 120"):
        jt.draw_measurements(jt.picture(small, 290.0, 330.0), IMAGE, EACH)
