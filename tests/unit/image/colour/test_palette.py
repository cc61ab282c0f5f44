"""Palettes: what they look like in numbers, and what a value becomes."""

import subprocess
import sys
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from jaxthermo.errors import InputError
from jaxthermo.image.colour import palette_design
from jaxthermo.image.colour.palette import (
    BACKGROUND,
    apply_palette,
    palette_names,
    palette_table,
)


def test_baked_tables_regenerate():
    built = palette_design._build_palettes()
    assert tuple(built) == palette_names()
    for name in palette_names():
        difference = built[name].astype(int) - palette_table(name).astype(int)
        assert np.abs(difference).max() <= 1, name


def test_bake_writes_what_is_read(tmp_path):
    palette_design._bake(tmp_path / "palettes.json")
    assert (tmp_path / "palettes.json").read_text() == palette_design._BAKED.read_text()


EVEN = ("ember", "arctic", "lava")


@pytest.mark.parametrize("name", EVEN)
def test_even_palettes_take_equal_steps_and_brighten(name):
    ucs = palette_design._even_ucs(palette_design._CONTROLS[name])
    step = np.linalg.norm(np.diff(ucs, axis=0), axis=1)
    assert step.std() / step.mean() < 1e-3
    assert (np.diff(ucs[:, 0]) > 0.3 * step).all()
    rgb = palette_design._ucs_to_rgb(ucs)
    assert rgb.min() > 0.0 and rgb.max() < 1.0


@pytest.mark.parametrize("name", EVEN)
def test_baked_even_palettes_are_uniform_but_for_eight_bits(name):
    ucs = palette_design._rgb_to_ucs(palette_table(name) / 255.0)
    assert (np.diff(ucs[:, 0]) > 0.0).all()
    step = np.linalg.norm(ucs[8:] - ucs[:-8], axis=1)
    assert step.std() / step.mean() < 0.04


@pytest.mark.parametrize("name", ["iron", "white-hot"])
def test_lightness_rises(name):
    lightness = palette_design._rgb_to_ucs(palette_table(name) / 255.0)[:, 0]
    assert (np.diff(lightness) > 0.0).all()


def test_black_hot_is_white_hot_reversed():
    assert (palette_table("black-hot") == palette_table("white-hot")[::-1]).all()


def test_colour_leaves_no_stand_in_modules_and_still_works():
    code = (
        "import sys, warnings; warnings.simplefilter('error')\n"
        "import numpy as np\n"
        "from jaxthermo.image.colour import palette_design as build\n"
        "assert not [k for k in sys.modules if k.startswith('matplotlib')]\n"
        "ucs = build._rgb_to_ucs(np.ones((1, 3)))\n"
        "assert abs(ucs[0, 0] - 100.0) < 0.1\n"
        "assert not [k for k in sys.modules if k.startswith('matplotlib')]\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_reading_palettes_does_not_import_colour():
    code = (
        "import sys\n"
        "from jaxthermo.image.colour.palette import palette_names\n"
        "palette_names()\n"
        "assert 'colour' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_ends_middle_and_outside():
    values = np.array([[280.0, 290.0, 300.0], [310.0, np.inf, -np.inf]])
    table = palette_table("iron")
    image = apply_palette(values, low=290.0, high=300.0, name="iron")
    assert image.dtype == np.uint8 and image.shape == (2, 3, 3)
    assert (image[0] == table[[0, 0, 255]]).all()
    assert (image[1] == table[[255, 255, 0]]).all()


def test_nan_gets_its_own_colour():
    values = np.array([[np.nan, 1.0]], np.float32)
    grey = apply_palette(values, low=0.0, high=1.0, name="ember")
    assert grey[0, 0].tolist() == [128, 128, 128]
    black = apply_palette(values, low=0.0, high=1.0, name="ember", invalid=(0, 0, 0))
    assert black[0, 0].tolist() == [0, 0, 0]


def test_equal_limits_are_safe():
    values = np.array([[1.0, 2.0, 3.0, np.nan]])
    image = apply_palette(values, low=2.0, high=2.0, name="white-hot")
    assert image[0, :, 0].tolist() == [0, 128, 255, 128]


def test_jax_arrays_and_float32_limits():
    values = np.array([[0.0, 0.5, 1.0]], np.float32)
    plain = apply_palette(values, low=0, high=1, name="iron")
    on_device = apply_palette(
        jnp.asarray(values), low=np.float32(0), high=np.float32(1), name="iron"
    )
    assert (plain == on_device).all()


@pytest.mark.parametrize(("low", "high"), [(1.0, 0.0), (np.nan, 1.0), (0.0, np.inf)])
def test_bad_limits(low, high):
    with pytest.raises(InputError, match="low <= high"):
        apply_palette(np.zeros((2, 2)), low=low, high=high, name="iron")


def test_unknown_palette_lists_the_names():
    unknown: Any = "jet"
    with pytest.raises(InputError, match="'jet' is not known: use one of iron, ember"):
        apply_palette(np.zeros((2, 2)), low=0.0, high=1.0, name=unknown)


@pytest.fixture(scope="module")
def report():
    return palette_design.palette_report()


def test_report_covers_every_palette_with_plain_numbers(report):
    assert tuple(report) == palette_names()
    for facts in report.values():
        assert all(type(value) is float for value in facts.values())
        assert 0.0 < facts["step_min"] <= facts["step_mean"] <= facts["step_max"]


def test_report_of_greys_is_that_of_the_reversed_greys_and_of_no_cone(report):
    """Grey is grey to everyone, so that no kind of vision changes it."""
    grey = report["white-hot"]
    assert report["black-hot"] == pytest.approx(grey)
    for vision in ("protanopia", "deuteranopia", "tritanopia"):
        assert grey[f"apart_{vision}"] == pytest.approx(grey["apart_normal"], rel=1e-3)


def test_report_finds_that_a_rainbow_repeats_colours_for_the_colour_blind(report):
    assert (
        report["rainbow"]["apart_protanopia"] < 1.0 < report["rainbow"]["apart_normal"]
    )
    for name in ("iron", *EVEN):
        for vision in ("normal", "protanopia", "deuteranopia", "tritanopia"):
            # Without red cones a dark red, the colour of lava, is nearly black.
            smallest = 3.0 if (name, vision) == ("lava", "protanopia") else 5.0
            assert report[name][f"apart_{vision}"] > smallest, (name, vision)


def test_arctic_keeps_its_differences_without_any_kind_of_cone(report):
    apart = [value for key, value in report["arctic"].items() if key[:5] == "apart"]
    assert min(apart) > 0.85 * max(apart)


def test_even_palettes_are_more_uniform_than_iron(report):

    def ratio(facts):
        return facts["step_max"] / facts["step_mean"]

    for name in EVEN:
        assert ratio(report[name]) < ratio(report["iron"]), name


def test_colour_difference_of_frames():
    frame = np.random.default_rng(0).integers(0, 256, (4, 5, 3)).astype(np.uint8)
    assert (palette_design._colour_difference(frame, frame) == 0.0).all()
    black = np.zeros((1, 1, 3), np.uint8)
    white = np.full((1, 1, 3), 255, np.uint8)
    difference = palette_design._colour_difference(black, white)
    assert difference.shape == (1, 1)
    np.testing.assert_allclose(difference, 100.0, atol=0.01)


def test_colour_difference_of_middle_greys_is_that_of_lightness():
    """CIEDE2000 weighs lightness by S_L = 1 at L* = 50."""
    levels = np.array([[119, 119, 119], [120, 120, 120]], np.uint8)
    difference = palette_design._colour_difference(levels[:1], levels[1:])
    lightness = 116 * np.cbrt(_linear(levels[:, 0] / 255)) - 16
    np.testing.assert_allclose(difference[0], np.diff(lightness)[0], rtol=5e-3)


def _linear(value):
    return ((value + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize("name", palette_names())
def test_the_background_is_told_from_every_colour(name):
    colours = rgb2lab(palette_table(name)[None] / 255.0)[0]
    behind = rgb2lab(np.array([[BACKGROUND]]) / 255.0)[0]
    # A difference of 1 is just noticeable, one of 10 at a glance.
    assert deltaE_ciede2000(colours, behind).min() > 12
