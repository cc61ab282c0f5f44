"""Contact textures show what touches, in the layer and at the place where it is."""

from typing import Any

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry.shapes import box
from jaxthermo.image.colour.palette import palette_table
from jaxthermo.report.layer_sheets import _UNTOUCHED, _contact_images
from jaxthermo.voxels.textures import _BACKGROUND
from jaxthermo.voxels.voxelize import voxelize


GRID = voxelize(box((6.0, 4.0, 2.0)), 1.0)
TOP = GRID.fragment_normal[:, 2] > 0.9
CORNER = TOP & (GRID.fragment_position[:, :2] > (2.0, 1.0)).all(1)


def test_a_corner_of_the_upper_side_in_contact():
    values = np.where(CORNER, 1.0, np.nan)
    images = _contact_images(GRID, values, 0.0, 1.0, "iron")
    assert list(images) == ["z"]
    bottom, top = images["z"]
    assert bottom.shape == top.shape == (4, 6, 3)
    assert (bottom == _UNTOUCHED).all()
    hot = (top == palette_table("iron")[-1]).all(-1)
    # Seen along +z with y up, x runs to the left.
    assert np.argwhere(hot).tolist() == [[0, 0]]
    assert (top[~hot] == _UNTOUCHED).all()


def test_values_share_the_colours_of_the_palette():
    values = np.where(TOP, np.linspace(0.0, 8.0, len(TOP)), np.nan)
    top = _contact_images(GRID, values, 0.0, 8.0, "white-hot")["z"][-1]
    levels = np.sort(top[..., 0].reshape(-1))
    expected = np.rint(255 * np.sort(values[TOP]) / 8.0)
    assert levels.tolist() == expected.astype(np.uint8).tolist()


def test_without_contact_there_is_no_image():
    assert _contact_images(GRID, np.full(len(TOP), np.nan), 0.0, 1.0, "iron") == {}
    unknown: Any = "none"
    with pytest.raises(InputError, match="palette"):
        _contact_images(GRID, np.zeros(len(TOP)), 0.0, 1.0, unknown)


def test_the_layer_that_has_less_is_dark_where_it_ends():
    values = np.where(GRID.fragment_normal[:, 0] > 0.9, 0.5, np.nan)
    images = _contact_images(GRID, values, 0.0, 1.0, "iron")["x"]
    assert len(images) == 2 and all(i.shape == (2, 4, 3) for i in images)
    assert not (images[1] == _BACKGROUND).all(-1).any()
