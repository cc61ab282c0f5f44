"""Layer images show what the layers hold, the right way up; the report is JSON."""

import json

import numpy as np
import pytest
from voxel_bodies import BALL, joined, without

from jaxthermo.geometry import shapes
from jaxthermo.voxels.grid import voxel_report
from jaxthermo.voxels.surface import surface_voxels
from jaxthermo.voxels.textures import _BACKGROUND, AXIS_COLOURS, layer_images
from jaxthermo.voxels.voxelize import voxelize


KINDS = ("depth", "normal", "dominant", "packed")


@pytest.fixture(scope="module")
def ball_images():
    return layer_images(voxelize(BALL, 1 / 16))


def shown(image):
    return (image != _BACKGROUND).any(axis=-1)


def test_every_axis_has_every_kind(ball_images):
    assert sorted(ball_images) == sorted(f"{a}_{k}" for a in "xyz" for k in KINDS)
    for images in ball_images.values():
        assert len(images) == 2
        assert all(i.dtype == np.uint8 and i.ndim == 3 for i in images)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_balls_layers(ball_images, axis):
    name = "xyz"[axis]
    near, far = ball_images[f"{name}_depth"]
    middle = near.shape[0] // 2
    assert shown(near).mean() == pytest.approx(np.pi * 16**2 / 33**2, rel=0.02)
    assert near[middle, middle, 0] > 240 > 80 > far[middle, middle, 0]
    front, back = ball_images[f"{name}_normal"]
    outward = (front[middle, middle] / 127.5 - 1)[axis]
    assert outward == pytest.approx(-1.0, abs=0.05)
    assert (back[middle, middle] / 127.5 - 1)[axis] == pytest.approx(1.0, abs=0.05)
    colours = ball_images[f"{name}_dominant"][0]
    assert (colours[middle, middle] == AXIS_COLOURS[axis]).all()


def test_each_piece_of_surface_is_packed_once(ball_images):
    for name in "xyz":
        mine = AXIS_COLOURS["xyz".index(name)]
        dominant = [(i == mine).all(-1) for i in ball_images[f"{name}_dominant"]]
        packed = [shown(i) for i in ball_images[f"{name}_packed"]]
        # Each ray keeps as many, and they stand in front.
        assert (np.sum(dominant, axis=0) == np.sum(packed, axis=0)).all()
        assert not (packed[1] & ~packed[0]).any()


def test_images_are_the_right_way_up():
    """A post at low x, y and high z on a block: where it stands in each view."""
    post = shapes.box((1.0, 1.0, 4.0)).moved((-2.5, -1.5, 4.0))
    grid = voxelize(joined(shapes.box((6.0, 4.0, 4.0)), post), 1.0)
    images = layer_images(grid)
    first = {name: shown(images[f"{name}_depth"][0]) for name in "xyz"}
    assert first["x"].shape == (8, 4)
    # Looking along +x with z up, +y is on the left.
    assert first["x"][0].tolist() == [False, False, False, True]
    assert first["y"].shape == (8, 6)
    assert first["y"][0].tolist() == [True] + [False] * 5
    assert first["x"][4:].all() and first["y"][4:].all()
    assert first["z"].shape == (4, 6) and first["z"].all()
    # Looking along +z with y up, +x is on the left; the last layer is the post's top.
    assert np.argwhere(shown(images["z_depth"][3])).tolist() == [[3, 5]]


def test_a_report_is_plain_json():
    grid = voxelize(BALL, 1 / 16)
    report = json.loads(json.dumps(voxel_report(grid), allow_nan=False))
    assert report["pitch_m"] == 1 / 16
    assert report["surface_voxels"] == len(surface_voxels(grid.solid))
    assert report["layers"]["x"] == {"file_axis": "x", "peeled": 2, "packed": 2}
    area = report["area_m2"]
    volume = report["volume_m3"]
    ratio = area["mesh"] / area["fragments_unscaled"]
    assert ratio == pytest.approx(report["area_ratio"])
    ratio = volume["mesh"] / volume["voxels_unscaled"]
    assert ratio == pytest.approx(report["volume_ratio"])
    assert report["ratios_applied"] is True
    assert report["ratios_not_applied_because"] is None


def test_a_report_says_why_ratios_are_not_applied():
    up = BALL.area_vectors[:, 2] / np.linalg.norm(BALL.area_vectors, axis=1)
    report = voxel_report(voxelize(without(BALL, up > 0.97), 1 / 16))
    assert report["ratios_applied"] is False
    reason = report["ratios_not_applied_because"]
    assert reason is not None and "open" in reason
    assert report["volume_m3"]["mesh"] is None
    assert json.dumps(report, allow_nan=False)


def test_a_report_of_thin_sheets_has_no_infinities():
    block = shapes.box((6.0, 6.0, 6.0))
    fin = shapes.box((8.0, 8.0, 0.4)).moved((12.0, 0.0, 0.0))
    # Of the open fin only one side is left, and nothing behind it.
    fin = without(fin, fin.area_vectors[:, 2] > -1.0)
    report = voxel_report(voxelize(joined(block, fin), 1.0))
    assert report["thin_parts"]["lost_for_want_of_a_voxel"]["area_m2"] > 60.0
    assert report["thin_parts"]["largest_places"][0]["thickness_m"] is None
    assert json.dumps(report, allow_nan=False)
