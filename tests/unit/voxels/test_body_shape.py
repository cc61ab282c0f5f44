"""Shape of a body by its proportions: plates, spheres, and all others."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxthermo.errors import InputError
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh, Pose
from jaxthermo.voxels.body_shape import Plate, Sphere, check_body_shape, shape_of
from jaxthermo.voxels.cylinders import Cylinder
from jaxthermo.voxels.from_array import grid_from_voxels
from jaxthermo.voxels.voxelize import voxelize
from tests.bodies import hollow


TURNED = Pose(
    (0.0, 0.0, 0.0), ((0.6, -0.8, 0.0), (0.8 * 0.6, 0.6 * 0.6, -0.8), (0.64, 0.48, 0.6))
)


def shape_of_mesh(mesh: Mesh, pitch: float):
    return shape_of(voxelize(mesh, pitch))


def frame() -> np.ndarray:
    """Square of rods, which is flat and open."""
    solid = np.ones((30, 30, 2), bool)
    solid[3:-3, 3:-3] = False
    return solid


@pytest.mark.parametrize(
    ("mesh", "kind"),
    [
        (shapes.box((0.1, 0.1, 0.025)), Plate),
        (shapes.box((0.1, 0.3, 0.026)), type(None)),
        (shapes.box((0.1, 0.02, 0.02)), type(None)),
        (shapes.box((0.2, 0.04, 0.01)), Plate),
        (shapes.cylinder(0.05, 0.02), Plate),
        (shapes.cylinder(0.05, 0.1), type(None)),
        (shapes.box(0.1), type(None)),
        (shapes.sphere(0.05), Sphere),
        (shapes.hemisphere(0.05), type(None)),
        (hollow(shapes.box((0.2, 0.2, 0.05)), shapes.box((0.17, 0.17, 0.02))), Plate),
        (hollow(shapes.sphere(0.05), shapes.sphere(0.03)), Sphere),
        (shapes.figurine(0.1), type(None)),
    ],
)
def test_the_proportions_decide(mesh, kind):
    assert type(shape_of_mesh(mesh, 0.005)) is kind


def test_a_frame_is_no_plate():
    assert shape_of(grid_from_voxels(frame(), 0.01)) is None
    assert type(shape_of(grid_from_voxels(np.ones((9, 9, 2), bool), 0.01))) is Plate


@pytest.mark.parametrize("pose", [Pose(), TURNED])
def test_a_plate_has_the_lengths_of_its_mesh_however_it_is_turned(pose):
    plate = shape_of_mesh(shapes.box((0.3, 0.2, 0.01)).placed(pose), 0.01)
    assert isinstance(plate, Plate)
    assert_allclose(
        [plate.area, plate.perimeter, plate.thickness, plate.long_side],
        [0.06, 1.0, 0.01, 0.3],
        rtol=1e-6,
    )
    x, y, z = np.asarray(pose.rotate(np.eye(3)))
    assert abs(plate.normal @ z) == pytest.approx(1)
    diagonal = (x + y) / np.sqrt(2)
    lengths = plate.mean_length(np.stack([x, y, diagonal, -y + z]))
    expected = [0.3, 0.2, 0.06 / (0.5 / np.sqrt(2)), 0.2]
    assert_allclose(lengths, expected, rtol=1e-3)


def test_a_disc_and_a_sphere_have_their_diameters():
    disc = shape_of_mesh(shapes.cylinder(0.1, 0.02), 0.01)
    assert isinstance(disc, Plate)
    assert disc.length == pytest.approx(0.05, rel=2e-3)
    ball = shape_of_mesh(shapes.sphere(0.05), 0.01)
    assert isinstance(ball, Sphere) and ball.diameter == pytest.approx(0.1, rel=2e-3)


def test_the_shape_may_be_given():
    cube = voxelize(shapes.box(0.1), 0.02)
    assert type(shape_of(cube, "plate")) is Plate
    assert type(shape_of(cube, "sphere")) is Sphere
    plate = voxelize(shapes.box((0.1, 0.1, 0.01)), 0.01)
    assert shape_of(plate, "cylinder") is None
    rod = Cylinder((0.0, 0.0, 0.0), (0, 0, 1), 0.1, body=1)
    assert shape_of(plate, cylinders=(rod,), body=1) is None
    assert type(shape_of(plate, cylinders=(rod,), body=0)) is Plate


@pytest.mark.parametrize(
    ("body_shape", "cylinders", "words"),
    [
        ("disc", (), "Wind.body_shape='disc'.: give one of plate, cylinder, sphere"),
        (3, (), "give one of plate"),
        ("plate", (Cylinder((0, 0, 0), (0, 0, 1), 1.0),), "give one of the two"),
    ],
)
def test_a_mistake_is_one_line(body_shape, cylinders, words):
    with pytest.raises(InputError, match=words) as raised:
        check_body_shape(body_shape, cylinders, "Wind")
    assert "\n" not in str(raised.value)
