"""Ways along and across faces, and which links have any along."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.structures.partition.links import (
    _MIN_NORMAL_FRACTION,
    _face_normals,
    link_axes,
    link_distance,
    non_orthogonal_links,
)
from tests.bodies import blocks, slanted


PITCH = 0.01


@pytest.fixture(scope="module", name="slanted")
def slanted_body():
    return slanted(PITCH)


def _kinds(grid):
    return {
        "aggregate": jt.Aggregate(grid, factor=3, alignment=0.0, min_time_constant=0.0),
        "core": jt.ShellOverCore(grid, factor=3),
        "octree": jt.Octree(grid, levels=2),
    }


@pytest.mark.parametrize("name", ["aggregate", "core", "octree"])
def test_a_way_is_its_parts_across_and_along(slanted, name):
    structure = _kinds(slanted)[name]
    links = structure.links()
    location = structure.nodes().location
    normal = _face_normals(structure)
    corrected = non_orthogonal_links(structure)
    np.testing.assert_allclose(normal**2, link_axes(structure), atol=1e-14)
    way = (location[links.dst] - location[links.src])[corrected.link]
    straight = np.linalg.norm(way, axis=1)
    across = way - corrected.offset
    length = np.linalg.norm(across, axis=1)
    assert len(corrected.link) > 20
    assert (length >= _MIN_NORMAL_FRACTION * straight * (1 - 1e-12)).all()
    assert (across * normal[corrected.link] > -1e-12).all()
    free = length > _MIN_NORMAL_FRACTION * straight * (1 + 1e-9)
    assert free.mean() > 0.8
    turned = np.einsum("ei,ei->e", corrected.offset, normal[corrected.link])
    np.testing.assert_allclose(turned[free], 0, atol=1e-12 * PITCH)
    stretch = corrected.length_ratio[corrected.link]
    np.testing.assert_allclose(stretch * length, link_distance(length, straight))


def test_links_in_line_have_no_way_along(slanted):
    for structure in (
        jt.SingleShell(slanted),
        jt.Aggregate(slanted, factor=1),
        jt.Aggregate(blocks(np.ones((6, 6, 6), bool), PITCH), factor=2),
    ):
        corrected = non_orthogonal_links(structure)
        assert len(corrected.link) == 0
        np.testing.assert_array_equal(corrected.length_ratio, 1.0)


def test_normals_turn_with_their_links():
    structure = jt.FullVolume(blocks(np.ones((3, 2, 2), bool), PITCH))
    links = structure.links()
    centre = structure.nodes().centre
    way = (centre[links.dst] - centre[links.src]) / PITCH
    np.testing.assert_allclose(_face_normals(structure), way, atol=1e-12)
