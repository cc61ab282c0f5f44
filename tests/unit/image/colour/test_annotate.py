"""Frames: ticks and labels that tell the truth, sizes that fit."""

from datetime import datetime
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFont

from jaxthermo.choices import Palette
from jaxthermo.errors import InputError
from jaxthermo.image.colour.annotate import annotate, contact_sheet, write_png
from jaxthermo.image.colour.canvas import drawable
from jaxthermo.image.colour.palette import apply_palette, palette_names
from jaxthermo.image.colour.ticks import (
    decimals_of,
    end_decimals,
    label,
    nice_ticks,
    time_label,
)


def frame(height, width, low=290.0, high=350.0, palette: Palette = "iron", **options):
    ramp = np.broadcast_to(np.linspace(low, high, width), (height, width))
    colours = apply_palette(ramp, low=low, high=high, name=palette)
    options = {"time": 90.0, **options}
    return colours, annotate(colours, low=low, high=high, palette=palette, **options)


@pytest.mark.parametrize("span", [1e-4, 0.013, 0.7, 1.0, 9.99, 10.0, 58.7, 333.0, 9e4])
@pytest.mark.parametrize("low", [-40.0, 0.0, 19.95])
def test_four_to_eight_round_ticks_inside(low, span):
    ticks = np.array(nice_ticks(low, low + span))
    assert 4 <= len(ticks) <= 8
    slack = 1e-6 * span
    assert ticks[0] >= low - slack and ticks[-1] <= low + span + slack
    steps = np.diff(ticks)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-4)
    mantissa = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-6)
    assert np.isclose(mantissa, [1.0, 2.0, 2.5, 5.0], rtol=1e-4).any()


def test_ticks_of_known_scales():
    np.testing.assert_allclose(nice_ticks(16.9, 75.9), [20, 30, 40, 50, 60, 70])
    np.testing.assert_allclose(nice_ticks(0.0, 1.0), [0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert nice_ticks(20.0, 20.0) == [20.0]


def test_labels():
    assert label(-0.04, 1) == "0.0"
    assert label(-12.5, 1) == "-12.5"
    assert [decimals_of(s) for s in (10.0, 0.5, 0.25, 0.01)] == [0, 1, 2, 2]
    assert [end_decimals(0.0, s) for s in (100.0, 10.0, 1.0, 0.1, 0.0)] == [
        1,
        1,
        1,
        2,
        1,
    ]


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (0.0, "t = 0 s"),
        (0.25, "t = 0.25 s"),
        (9.99996, "t = 10 s"),
        (90.0, "t = 90 s"),
        (119.97, "t = 2 min 00 s"),
        (750.0, "t = 12 min 30 s"),
        (3599.7, "t = 1 h 00 min"),
        (11100.0, "t = 3 h 05 min"),
        (-30.0, "t = -30 s"),
    ],
)
def test_time_label(time, text):
    assert time_label(time) == text


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (0.0, "22:30, t = 0 s"),
        (5430.0, "00:00:30, t = 1 h 30 min"),
        (7199.9999, "00:30, t = 2 h 00 min"),
    ],
)
def test_the_time_of_day_follows_from_the_start(time, text):
    """It is that of the start's own zone."""
    start = datetime.fromisoformat("2026-06-21T22:30+02:00")
    assert time_label(time, start) == text


@pytest.mark.parametrize(
    ("height", "width"), [(48, 64), (64, 64), (16, 200), (480, 640), (120, 4000)]
)
def test_image_is_kept_and_sizes_fit(height, width):
    colours, image = frame(height, width, title="a title that may be far too long" * 3)
    pixels = np.asarray(image)
    assert (pixels[:height, :width] == colours).all()
    assert image.height > height and image.width > width
    if min(height, width) > 200:
        assert image.width < 1.3 * width and image.height < 1.2 * height
    # Nothing touches the rim of the panel and the strip: no text is cut off.
    paper = np.array([16, 17, 20])
    assert (pixels[:, -2:] == paper).all() and (pixels[-2:] == paper).all()


def test_bar_runs_from_the_coldest_to_the_hottest_colour():
    colours, image = frame(480, 640)
    panel = np.asarray(image)[:480, 640:].astype(int)
    hottest = colours[0, -1].astype(int)
    coldest = colours[0, 0].astype(int)
    hot_rows = np.flatnonzero((panel == hottest).all(-1).any(1))
    cold_rows = np.flatnonzero((panel == coldest).all(-1).any(1))
    assert hot_rows.size and cold_rows.size
    assert hot_rows.max() < cold_rows.min()
    assert cold_rows.max() - hot_rows.min() > 380


@pytest.mark.parametrize("limits", [(293.15, 293.15), (293.15, 293.1501), (1.0, 6e3)])
def test_odd_limits(limits):
    frame(100, 120, *limits)


@pytest.mark.parametrize(("height", "width"), [(48, 64), (480, 640)])
def test_an_end_that_is_exceeded_has_a_point_in_its_colour(height, width):
    colours, plain = frame(height, width)
    hottest = colours[0, -1]
    coldest = colours[0, 0]
    pale = np.asarray(plain)[:, width:]

    def rows(panel: np.ndarray, colour: np.ndarray) -> np.ndarray:
        return np.flatnonzero((panel == colour).all(-1).any(1))

    for beyond in [(False, True), (True, False), (True, True)]:
        _, marked = frame(height, width, beyond=beyond)
        # Frames of one run have one size, whatever they exceed.
        assert marked.size == plain.size
        panel = np.asarray(marked)[:, width:]
        higher = rows(panel, hottest).min() < rows(pale, hottest).min()
        lower = rows(panel, coldest).max() > rows(pale, coldest).max()
        assert (lower, higher) == beyond


def test_the_scale_is_named_by_its_quantity():
    _, plain = frame(480, 640)
    _, named = frame(480, 640, quantity="apparent")
    # The first line above the bar, next to the image.
    widths = [
        np.flatnonzero((np.asarray(image)[:35, 640:] > 150).any((0, 2))).max()
        for image in (plain, named)
    ]
    assert widths[1] > 2 * widths[0]


def test_a_title_has_only_letters_that_the_font_has():
    """Pillow's draws others as a box."""
    letters = ImageFont.load_default(size=20)

    def mask(letter):
        image = Image.new("L", (40, 40))
        ImageDraw.Draw(image).text((0, 0), letter, 255, font=letters)
        return image.tobytes()

    box = mask("\uffff")
    title = "Geh\u00e4use, Stra\u00dfe, 3 m\u00b2 at 5 \u00b0C \u00b1 1\u2026"
    title += " \u2013 \u96ea"
    assert mask("\u00e4") == box
    drawn = drawable(title)
    assert drawn == "Gehause, Strasse, 3 m2 at 5 \u00b0C \u00b1 1\u2026 - ?"
    assert all(mask(letter) != box for letter in drawn)
    _, image = frame(120, 400, title=title)
    _, same = frame(120, 400, title=drawn)
    assert image.tobytes() == same.tobytes()


def test_every_palette():
    sheet = contact_sheet([frame(48, 64, palette=p)[1] for p in palette_names()], 3)
    assert sheet.width > sheet.height


def test_bad_input():
    pixels = np.zeros((8, 8, 3), np.uint8)
    unknown: Any = "jet"
    with pytest.raises(InputError, match="is not known"):
        annotate(pixels, low=1.0, high=2.0, palette=unknown, time=0.0)
    with pytest.raises(InputError, match="low <= high"):
        annotate(pixels, low=3.0, high=2.0, palette="iron", time=0.0)
    with pytest.raises(InputError, match="at least one"):
        contact_sheet([], 3)
    with pytest.raises(InputError, match="at least one"):
        contact_sheet([Image.new("RGB", (4, 4))], 0)


def test_contact_sheet_places_all_images():
    reds = [Image.new("RGB", (20 + k, 30), (200 + k, 0, 0)) for k in range(5)]
    sheet = np.asarray(contact_sheet(reds, 2))
    for k in range(5):
        count = (sheet == np.array([200 + k, 0, 0])).all(-1).sum()
        assert count == (20 + k) * 30
    assert contact_sheet(reds[:1], 9).width < 30


def test_each_row_of_a_contact_sheet_is_as_high_as_its_images():
    low, high = (Image.new("RGB", (40, height)) for height in (20, 60))
    gap = contact_sheet([low], 1).height - 20
    assert contact_sheet([low, low, high, low], 2).height == 20 + 60 + 3 * gap // 2


def test_write_png(tmp_path):
    path = tmp_path / "frame.png"
    _, image = frame(48, 64)
    write_png(path, image)
    with Image.open(path) as read:
        assert (np.asarray(read) == np.asarray(image)).all()
    assert [p.name for p in tmp_path.iterdir()] == ["frame.png"]
    with pytest.raises(InputError, match="cannot write"):
        write_png(tmp_path / "no" / "frame.png", image)
