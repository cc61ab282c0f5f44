"""A sheet of frames: one scale, every time, and no more than can be read."""

import numpy as np
import pytest
from frames import frame

import jaxthermo as jt
from jaxthermo.errors import InputError
from jaxthermo.image.colour.palette import palette_table
from jaxthermo.report.frame_sheet import _MAX_SHEET, _MAX_TILES, shown_on_sheet


def frames(count, height=60, width=80):
    levels = np.linspace(290.0, 330.0, count)
    return [
        frame(np.full((height, width), level), time=60.0 * k)
        for k, level in enumerate(levels)
    ]


def test_every_frame_is_there_in_the_colour_of_the_one_scale():
    pixels = np.asarray(jt.frame_sheet(frames(5), 290.0, 330.0, "iron"))
    table = palette_table("iron")
    for k in range(5):
        colour = table[round(255 * k / 4)]
        # A tile of 60 x 80, and what the bar has of the colour.
        assert (pixels == colour).all(axis=-1).sum() >= 60 * 80


@pytest.mark.parametrize("quantity", ["apparent", "surface"])
def test_the_scale_is_of_the_quantity(quantity):
    images = [frame(np.full((60, 80), 300.0), np.full((60, 80), 320.0))]
    pixels = np.asarray(jt.frame_sheet(images, 290.0, 330.0, "iron", quantity))
    kelvin = 300.0 if quantity == "apparent" else 320.0
    colour = palette_table("iron")[round(255 * (kelvin - 290.0) / 40.0)]
    assert (pixels == colour).all(axis=-1).sum() >= 60 * 80


def test_many_frames_are_thinned_out_and_large_ones_shrunk():
    assert shown_on_sheet(5) == [0, 1, 2, 3, 4]
    indices = shown_on_sheet(1000)
    assert (len(indices), indices[0], indices[-1]) == (_MAX_TILES, 0, 999)
    assert set(np.diff(indices)) == {21, 22}
    for sheet in (
        jt.frame_sheet(frames(60), 290.0, 330.0),
        jt.frame_sheet(frames(7, 900, 1200), 290.0, 330.0),
    ):
        # With the gaps between tiles and the lines of text.
        assert max(sheet.size) < 1.15 * _MAX_SHEET


def test_a_scale_is_pointed_where_temperatures_are_beyond_it():
    bars = [
        np.asarray(jt.frame_sheet(frames(5), low, high))[-66:]
        for low, high in ((290.0, 330.0), (300.0, 330.0), (290.0, 320.0))
    ]
    for end, pointed in ((0, bars[1]), (-1, bars[2])):
        is_end = [(bar == palette_table("iron")[end]).all(axis=-1) for bar in bars]
        points = (pointed == palette_table("iron")[end]).all(axis=-1).sum()
        assert points > min(map(np.count_nonzero, is_end)) + 20


def test_a_sheet_of_some_frames_says_so():
    small = {"height": 6, "width": 8}
    heads = [
        np.asarray(jt.frame_sheet(frames(count, **small), 290.0, 330.0))[:30]
        for count in (_MAX_TILES, _MAX_TILES + 1)
    ]
    assert [len(np.unique(head.reshape(-1, 3), axis=0)) > 1 for head in heads] == [
        False,
        True,
    ]


def test_a_scale_of_one_temperature():
    jt.frame_sheet(frames(1), 300.0, 300.0, "lava")


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ([], "none: give frames of one size"),
        ([*frames(1), *frames(1, 50, 80)], "80 x 50, 80 x 60: give frames of one size"),
        ([frame(np.full((6, 8), np.nan))], "48 of 48 pixels is not finite"),
    ],
)
def test_mistakes(images, message):
    with pytest.raises(InputError, match=message):
        jt.frame_sheet(images, 290.0, 330.0)
