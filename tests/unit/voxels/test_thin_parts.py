"""What is thinner than a voxel is reported; what has no voxel is said to be lost."""

import numpy as np
import pytest
from voxel_bodies import BALL, joined

from jaxthermo.geometry import shapes
from jaxthermo.voxels.voxelize import voxelize


def block_and_plate(height):
    """A block of 6 x 6 x 6 voxels beside a plate 0.4 voxel thick at some height."""
    plate = shapes.box((8.0, 8.0, 0.4)).moved((12.0, 0.0, height))
    return joined(shapes.box((6.0, 6.0, 6.0)), plate)


def test_a_plate_on_voxel_centres_is_thin():
    grid = voxelize(block_and_plate(0.5), 1.0)
    assert grid.thin.thin_area == pytest.approx(128.0, rel=0.05)
    assert grid.thin.lost_fragments == 0 and grid.thin.lost_area == 0.0
    assert grid.solid_count == 216 + 64
    region = grid.thin.regions[0]
    assert region["thickness_m"] == pytest.approx(0.4, abs=1e-6)
    assert region["lost_share"] == 0.0
    assert 8.0 < region["centre_m"][0] < 16.0
    assert sum(p["area_m2"] for p in grid.thin.regions) == pytest.approx(
        grid.thin.thin_area
    )


def test_a_plate_between_voxel_centres_is_lost():
    grid = voxelize(block_and_plate(0.0), 1.0)
    assert grid.thin.lost_area == pytest.approx(128.0, rel=0.1)
    assert grid.solid_count == 216
    assert grid.thin.regions[0]["lost_share"] == 1.0
    # None of it is left among the fragments.
    assert grid.fragment_position[:, 0].max() < 4.0
    # The rest does not stand for it.
    assert grid.area_ratio == 1.0
    represented = grid.represented
    assert represented is not None and represented.is_off
    assert "area" in grid.unscaled_because or represented.area.error < -0.3


def test_thick_bodies_have_no_thin_parts():
    for mesh, pitch in ((BALL, 0.1), (shapes.box(5.0), 1.0)):
        thin = voxelize(mesh, pitch).thin
        assert (thin.thin_fragments, thin.lost_fragments, thin.regions) == (0, 0, ())
        assert thin.thin_area == thin.lost_area == 0.0


def test_thickness_is_along_the_normal():
    """A plate tilted by 40 degrees: the rays' own way through it is longer."""
    tilt = np.radians(40.0)
    turn = np.array(
        [[np.cos(tilt), 0, -np.sin(tilt)], [0, 1, 0], [np.sin(tilt), 0, np.cos(tilt)]]
    )
    plate = shapes.box((20.0, 20.0, 0.9))
    plate = type(plate)(plate.vertices @ turn.T, plate.faces, "plate")
    grid = voxelize(plate, 1.0)
    thickness = grid.thin.regions[0]["thickness_m"]
    assert thickness is not None
    assert thickness <= 0.9 + 1e-9
    assert grid.thin.thin_area > 0.8 * plate.area
    assert not voxelize(plate, 0.85).thin.thin_area > 0.2 * plate.area


def test_at_most_ten_places_are_named():
    rng = np.random.default_rng(1)
    chips = [
        shapes.box((3.0, 3.0, 0.3)).moved(40 * np.array([i % 3, i // 3 % 3, i // 9]))
        for i in range(20)
    ]
    grid = voxelize(
        joined(shapes.box(6.0).moved(-20 * rng.uniform(size=3)), *chips), 1.0
    )
    assert 0 < len(grid.thin.regions) <= 10
    areas = [p["area_m2"] for p in grid.thin.regions]
    assert areas == sorted(areas, reverse=True)
