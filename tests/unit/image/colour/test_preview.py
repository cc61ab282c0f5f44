"""Previews show which body is where in the frame, and which way is up."""

import numpy as np
import pytest

from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.image.colour.preview import _AXES, _BACKGROUND, draw_preview
from jaxthermo.image.surface.camera import Camera, OrthographicCamera
from jaxthermo.image.surface.visible import WorldMesh


BOX = shapes.box((0.1, 0.1, 0.1))
LEVEL = OrthographicCamera(
    (0.0, -1.0, 0.0), (0.0, 0.0, 0.0), view_height=0.4, width=240, height=200
)


def at(x=0.0):
    """The box in the world, moved along x."""
    return WorldMesh(BOX.vertices + np.array([x, 0.0, 0.0]), BOX.faces)


def drawn(bodies, camera):
    image, numbers = draw_preview(bodies, camera, "title")
    return np.asarray(image)[: camera.height, : camera.width], numbers


def spot(pixels, colour):
    """Mean row and column of the pixels of one colour."""
    return np.argwhere((pixels == colour).all(-1)).mean(0)


def test_a_block_covers_the_pixels_that_its_size_says():
    pixels, numbers = drawn([at()], LEVEL)
    # 0.1 m of 0.4 m over 200 pixels; the axes are in a corner.
    middle = pixels[:, 90:150]
    covered = (middle != _BACKGROUND).any(-1)
    assert numbers == [0]
    assert covered.sum() == 50 * 50 and covered[75:125, 5:55].all()


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_the_axes_point_where_they_point_in_the_image(up):
    camera = OrthographicCamera(
        (0.0, -1.0, 0.0), (0.0, 0.0, 0.0), view_height=0.4, up=up, width=240, height=200
    )
    pixels, _ = drawn([at()], camera)
    x, z = (spot(pixels, dict(_AXES)[name]) for name in "xz")
    # Looking along +y with z up, x is to the right; with x up, z is to the left.
    if up[2]:
        assert z[0] < x[0] - 10 and z[1] < x[1] - 10
    else:
        assert x[0] < z[0] - 10 and z[1] < x[1] - 10


def test_bodies_in_the_frame_are_named():
    _, numbers = drawn([at(), at(3.0), at(0.12)], LEVEL)
    assert numbers == [0, 2]


def test_a_body_with_a_name_is_called_by_it():
    bodies = [at(-0.08), at(0.08)]
    by_number, _ = drawn(bodies, LEVEL)
    by_name = np.asarray(draw_preview(bodies, LEVEL, "title", ["lid", ""])[0])
    changed = (by_number != by_name[: LEVEL.height, : LEVEL.width]).any(-1)
    # The label of the first body alone, whose middle is at column 80.
    assert changed.any() and not changed[:, 120:].any()
    with_numbers = draw_preview(bodies, LEVEL, "title", ["body 0", "body 1"])[0]
    np.testing.assert_array_equal(
        np.asarray(with_numbers)[: LEVEL.height, : LEVEL.width], by_number
    )


def test_a_name_at_the_border_is_in_the_picture():
    def letters(x):
        picture, _ = draw_preview([at(x), at(0.3)], LEVEL, "", ["back plate", ""])
        return (np.asarray(picture) > 200).all(-1).sum()

    assert letters(0.0) > 50
    for x in (-0.25, 0.25):
        assert letters(x) == pytest.approx(letters(0.0), rel=0.05)


def test_a_camera_that_sees_nothing_is_refused():
    camera = Camera((0.0, -1.0, 0.0), (0.0, -2.0, 0.0), width=20, height=20)
    with pytest.raises(InputError, match="sees no body"):
        draw_preview([at()], camera)
