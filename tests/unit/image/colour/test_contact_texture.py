"""Contact textures show what touches, in the layer and at the place where it is."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box
from jaxthermo.image.colour.contact_texture import _UNTOUCHED, contact_images
from jaxthermo.image.colour.palette import palette_table
from jaxthermo.voxels.textures import _BACKGROUND
from jaxthermo.voxels.voxelize import voxelize


GRID = voxelize(box((6.0, 4.0, 2.0)), 1.0)
TOP = GRID.fragment_normal[:, 2] > 0.9
CORNER = TOP & (GRID.fragment_position[:, :2] > (2.0, 1.0)).all(1)


def test_a_corner_of_the_upper_side_in_contact():
    values = np.where(CORNER, 1.0, np.nan)
    images = contact_images(GRID, values)
    assert list(images) == ["z_contact"]
    bottom, top = images["z_contact"]
    assert bottom.shape == top.shape == (4, 6, 3)
    assert (bottom == _UNTOUCHED).all()
    hot = (top == palette_table("iron")[-1]).all(-1)
    # Seen along +z with y up, x runs to the left.
    assert np.argwhere(hot).tolist() == [[0, 0]]
    assert (top[~hot] == _UNTOUCHED).all()


def test_values_share_the_colours_of_the_palette():
    values = np.where(TOP, np.linspace(0.0, 8.0, len(TOP)), np.nan)
    top = contact_images(
        GRID, values, low=0.0, high=8.0, palette="white-hot", quantity="flux"
    )["z_flux"][-1]
    levels = np.sort(top[..., 0].reshape(-1))
    expected = np.rint(255 * np.sort(values[TOP]) / 8.0)
    assert levels.tolist() == expected.astype(np.uint8).tolist()


def test_without_contact_there_is_no_image():
    assert contact_images(GRID, np.full(len(TOP), np.nan)) == {}
    with pytest.raises(InputError, match="palette"):
        contact_images(GRID, np.zeros(len(TOP)), palette="none")


def test_the_layer_that_has_less_is_dark_where_it_ends():
    values = np.where(GRID.fragment_normal[:, 0] > 0.9, 0.5, np.nan)
    images = contact_images(GRID, values)["x_contact"]
    assert len(images) == 2 and all(i.shape == (2, 4, 3) for i in images)
    assert not (images[1] == _BACKGROUND).all(-1).any()
