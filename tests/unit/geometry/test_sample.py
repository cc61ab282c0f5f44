"""Points on a mesh: on its triangles, by area, the same for the same seed."""

import numpy as np
import pytest
import trimesh

import jaxthermo as jt
from jaxthermo.errors import InputError


BOX = jt.shapes.box((0.1, 0.2, 0.4))


def test_points_lie_on_their_triangles_with_their_normals():
    sample = jt.mesh_sample(BOX, 500)
    half = np.array([0.05, 0.1, 0.2])
    assert (np.abs(sample.position) <= half + 1e-12).all()
    # On the side that the normal names, and nowhere else outward.
    np.testing.assert_allclose(
        (sample.position * sample.normal).sum(1),
        (np.abs(sample.normal) * half).sum(1),
        rtol=1e-12,
    )
    triangle = BOX.triangles[sample.face]
    height = ((sample.position - triangle[:, 0]) * sample.normal).sum(1)
    np.testing.assert_allclose(height, 0, atol=1e-12)


def test_the_number_of_points_goes_by_area():
    """Within four standard deviations of the binomial distribution on each side."""
    count = 20_000
    normal = jt.mesh_sample(BOX, count).normal
    area = np.array([0.2 * 0.4, 0.1 * 0.4, 0.1 * 0.2])
    expected = area / area.sum()
    for axis in range(3):
        share = (np.abs(normal[:, axis]) > 0.5).mean()
        spread = np.sqrt(expected[axis] * (1 - expected[axis]) / count)
        assert abs(share - expected[axis]) < 4 * spread


def test_a_mean_over_points_is_a_mean_over_the_area():
    """Of z^2 over a sphere of radius 1: 1/3, with the standard deviation sqrt(4/45)."""
    sample = jt.mesh_sample(jt.shapes.sphere(1.0, subdivisions=4))
    mean = (sample.position[:, 2] ** 2).mean()
    assert mean == pytest.approx(1 / 3, abs=4 * np.sqrt(4 / 45) / 100)


def test_a_seed_gives_the_same_points():
    first, same, different = (jt.mesh_sample(BOX, 50, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.position, same.position)
    assert (first.position != different.position).any()
    by_trimesh = jt.mesh_sample(trimesh.Trimesh(BOX.vertices, BOX.faces), 50, 3)
    np.testing.assert_allclose(by_trimesh.position, first.position, atol=1e-15)


def test_a_sample_is_placed_as_its_body():
    turned = jt.Pose(
        (1.0, 0.0, 0.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    )
    placed = jt.mesh_sample(BOX, 20).placed(turned)
    sample_of_placed = jt.mesh_sample(BOX.placed(turned), 20)
    np.testing.assert_allclose(placed.position, sample_of_placed.position, atol=1e-12)
    np.testing.assert_allclose(placed.normal, sample_of_placed.normal, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((BOX, 0), "mesh_sample(count=0): give a whole number of at least 1"),
        ((BOX, 10, -1), "mesh_sample(seed=-1): give a whole number of at least 0"),
        ((jt.Mesh(np.zeros((3, 3)), np.zeros((0, 3), int)),), "0 faces and no area"),
    ],
)
def test_mistakes_are_one_line(arguments, words):
    with pytest.raises(InputError) as caught:
        jt.mesh_sample(*arguments)
    assert words in str(caught.value) and "\n" not in str(caught.value)
