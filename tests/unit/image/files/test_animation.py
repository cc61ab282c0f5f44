"""Animations: all pictures are there, in their colours, for their time."""

import importlib.util
from pathlib import Path

import av
import numpy as np
import pytest
from frames import frame
from PIL import Image as Pictures

import jaxthermo as jt
from jaxthermo.choices import Palette
from jaxthermo.errors import InputError
from jaxthermo.image.files import animation
from jaxthermo.image.files.animation import default_rate, write_animation


RAMP = np.broadcast_to(np.linspace(290.0, 330.0, 97), (71, 97))


def pictures(palette: Palette = "iron"):
    """Three pictures of odd width: a ramp that gets warmer."""
    images = [frame(RAMP + shift, time=shift) for shift in (-12.0, 0.0, 9.0)]
    drawn = [jt.picture(image, 280.0, 340.0, palette=palette) for image in images]
    assert drawn[0].width % 2 == 1
    return drawn


def frames_of(path):
    """Pictures of an animation by Pillow, and their durations [ms]."""
    with Pictures.open(path) as animation_file:
        decoded = []
        durations = []
        for k in range(getattr(animation_file, "n_frames", 1)):
            animation_file.seek(k)
            decoded.append(np.asarray(animation_file.convert("RGB")).astype(int))
            durations.append(animation_file.info["duration"])
        return decoded, durations


@pytest.mark.parametrize("ending", [".png", ".apng"])
def test_an_apng_is_exact(tmp_path, ending):
    path = tmp_path / f"run{ending}"
    assert write_animation(path, iter(pictures()), 4.0) == 3
    decoded, durations = frames_of(path)
    assert durations == [250.0] * 3
    for pixels, original in zip(decoded, pictures(), strict=True):
        np.testing.assert_array_equal(pixels, original)


@pytest.mark.parametrize("palette", ["iron", "rainbow", "white-hot"])
def test_a_gif_has_even_colours_and_no_dither(tmp_path, palette):
    write_animation(tmp_path / "run.gif", pictures(palette), 4.0, palette)
    decoded, durations = frames_of(tmp_path / "run.gif")
    assert durations == [250] * 3
    for pixels, original in zip(decoded, pictures(palette), strict=True):
        exact = np.asarray(original).astype(int)
        # The frame itself: a step of the table of colours at most, also where colours
        # are in one picture only.
        assert np.abs(pixels - exact)[:71, :97].max() <= 8
        # With dither, rows of one temperature would not have one colour.
        assert (pixels[:71, :97] == pixels[:1, :97]).all()


def test_a_gif_without_a_palette_takes_the_colours_of_the_first_picture(tmp_path):
    write_animation(tmp_path / "run.gif", pictures(), 4.0)
    decoded, _ = frames_of(tmp_path / "run.gif")
    assert np.abs(decoded[0] - np.asarray(pictures()[0])).mean() < 1
    assert (decoded[0][:71, :97] == decoded[0][:1, :97]).all()


def test_an_mp4_has_even_edges_and_the_right_colours(tmp_path):
    path = tmp_path / "run.mp4"
    assert write_animation(path, iter(pictures()), 7.5) == 3
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        assert stream.average_rate == 7.5
        decoded = [
            video_frame.to_ndarray(format="rgb24")
            for video_frame in file.decode(stream)
        ]
    assert len(decoded) == 3
    for pixels, original in zip(decoded, pictures(), strict=True):
        exact = np.asarray(original).astype(int)
        height, width = exact.shape[:2]
        assert pixels.shape == (height + height % 2, width + width % 2, 3)
        # Colours of neighbours are shared: of smooth parts alone they are near.
        difference = np.abs(pixels[:71, :97].astype(int) - exact[:71, :97])
        assert difference.mean() < 4


def test_arrays_are_pictures_too_and_the_rate_follows_from_their_number(tmp_path):
    arrays = [np.full((8, 9, 3), level, np.uint8) for level in range(40)]
    assert write_animation(tmp_path / "run.png", arrays) == 40
    assert frames_of(tmp_path / "run.png")[1] == [250.0] * 40
    assert [default_rate(n) for n in (1, 20, 100, 1000)] == [2.0, 2.0, 10.0, 25.0]


def test_mistakes_are_one_line_and_leave_no_file(tmp_path, monkeypatch):
    grey = np.zeros((8, 9, 3), np.uint8)
    for name, images, message in [
        ("run.avi", [grey], "name an animation .png"),
        ("run.gif", [], "at least one picture"),
        ("run.png", [grey, grey[:, 1:]], "picture 1 is of 8 x 8 .* first of 9 x 8"),
        ("run.mp4", [grey, grey[1:]], "give one size"),
    ]:
        with pytest.raises(InputError, match=message):
            write_animation(tmp_path / name, images)
    for rate in (0.0, -1.0, 101.0, float("nan")):
        with pytest.raises(InputError, match="give pictures a second"):
            write_animation(tmp_path / "run.gif", [grey], rate)
    monkeypatch.setattr(animation, "MAX_BYTES", 3 * 72 * 2)
    with pytest.raises(InputError, match="more than 2 pictures .* write an MP4"):
        write_animation(tmp_path / "run.gif", [grey] * 3)
    assert write_animation(tmp_path / "run.mp4", [grey] * 3) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["run.mp4"]


@pytest.mark.parametrize("wrong", [np.full((8, 9, 3), np.nan), "frame.png", None])
def test_what_is_no_picture(wrong):
    # Not by the function itself, of which tests check the types.
    with pytest.raises(
        InputError, match="picture 0 is .* give pictures as of `picture`"
    ):
        list(animation._Counted([wrong], Path("run.gif"), limited=True))


def test_an_mp4_without_its_package_names_the_command(tmp_path, monkeypatch):
    find = importlib.util.find_spec

    def missing(name):
        return None if name == "av" else find(name)

    monkeypatch.setattr(importlib.util, "find_spec", missing)
    with pytest.raises(InputError, match=r"pip install '\.\[video\]'"):
        write_animation(tmp_path / "run.mp4", pictures())
    assert not list(tmp_path.iterdir())
