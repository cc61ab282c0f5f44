"""C18: a ball on a plate touches over the cap that lies within the threshold."""

import numpy as np
import pytest

from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.physics.contact.search import find_contacts
from jaxthermo.voxels.voxelize import voxelize


def cap_area(radius, threshold):
    """Area of the part of a plane within a threshold of a ball that touches it."""
    return np.pi * (radius**2 - (radius - threshold) ** 2)


def ball_on_plate(voxels, plate_pitch=1.0, threshold=None):
    """A ball of radius 1 on a plate just wide enough; pitches in the ball's voxels."""
    pitch = 2.0 / voxels
    mesh = sphere(1.0, 4 if voxels < 64 else 6)
    ball = voxelize(mesh, pitch)
    width = 2.2 * np.sqrt(2 * (threshold or 2 * pitch)) + 2 * pitch
    plate = voxelize(box((float(width), float(width), 4 * pitch)), plate_pitch * pitch)
    # Off the lattice's symmetry, as bodies are.
    height = -float(mesh.bounds[0, 2])
    return (
        PlacedGrid(ball, Pose((0.013 * pitch, 0.21 * pitch, height)), "ball"),
        PlacedGrid(plate, Pose((0.0, 0.0, -2 * pitch)), "plate"),
    )


@pytest.mark.parametrize("plate_pitch", [1.0, 0.8, 1.5])
@pytest.mark.parametrize(
    ("voxels", "within"), [(16, 0.03), pytest.param(64, 0.01, marks=pytest.mark.slow)]
)
def test_the_area_is_that_of_the_cap(voxels, within, plate_pitch):
    ball, plate = ball_on_plate(voxels, plate_pitch)
    threshold = 2.0 / voxels * min(1.0, plate_pitch)
    expected = cap_area(1.0, threshold)
    areas = [find_contacts(*pair).area.sum() for pair in ((ball, plate), (plate, ball))]
    assert areas == pytest.approx([expected, expected], rel=within)
    assert areas[0] == pytest.approx(areas[1], rel=within)


def test_a_fixed_threshold_has_one_area_at_every_resolution():
    areas = [
        find_contacts(*ball_on_plate(voxels, threshold=0.1), 0.1).area.sum()
        for voxels in (16, 24)
    ]
    assert areas == pytest.approx([cap_area(1.0, 0.1)] * 2, rel=0.02)


def test_gaps_grow_with_the_square_of_the_distance():
    """The ball's own height over the plate: R - sqrt(R^2 - r^2)."""
    ball, plate = ball_on_plate(24, threshold=0.1)
    pairs = find_contacts(ball, plate, 0.1)
    where = plate.world_fragments[pairs.fragment_b]
    centre = np.array(ball.pose.translation)
    distance = np.linalg.norm((where - centre)[:, :2], axis=1)
    expected = 1.0 - np.sqrt(1.0 - distance**2)
    # A pair's mean over a voxel, against the height at its middle.
    slope = distance / np.sqrt(1.0 - distance**2)
    assert (np.abs(pairs.gap - expected) < (0.05 + slope) * ball.pitch).all()
    assert pairs.area @ pairs.gap == pytest.approx(pairs.area @ expected, rel=0.03)
