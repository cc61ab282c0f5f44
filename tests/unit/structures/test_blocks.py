"""Nodes and links of any division of the voxels, against loops and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from voxel_volumes import labelled, links_of, members, solids

import jaxthermo as jt
from jaxthermo.errors import InputError, whole_number
from jaxthermo.structures.partition import links as links_module
from jaxthermo.structures.partition.blocks import build_blocks, number_by_first_voxel
from jaxthermo.structures.partition.links import block_links, link_distance, voxel_links
from tests.bodies import blocks


PITCH = 0.5


def numbered(labels):
    """Labels by first voxel, by a loop."""
    result = np.full(labels.shape, -1, np.int32)
    for number, cells in enumerate(members(labels).values()):
        result[tuple(np.transpose(cells))] = number
    return result


def built_of(labels, pitch=PITCH):
    numbers = numbered(labels)
    grid = blocks(labels >= 0, pitch)
    return build_blocks(grid, numbers, np.zeros(numbers.max() + 1, int)), numbers


@settings(deadline=None, max_examples=30)
@given(labelled())
def test_numbers_follow_first_voxels(labels):
    lattice = np.arange(labels.size).reshape(labels.shape)
    first = np.full(labels.shape, -1)
    for cells in members(labels).values():
        index = tuple(np.transpose(cells))
        first[index] = lattice[index].min()
    numbers, voxel = number_by_first_voxel(first)
    np.testing.assert_array_equal(numbers, numbered(labels))
    np.testing.assert_array_equal(voxel, np.unique(first[first >= 0]))


@settings(deadline=None, max_examples=30)
@given(labelled())
def test_nodes_are_counted_and_centred_voxels(labels):
    built, numbers = built_of(labels)
    for node, cells in members(numbers).items():
        assert built.nodes.volume[node] == pytest.approx(len(cells) * PITCH**3)
        expected = (np.mean(cells, axis=0) + 0.5) * PITCH
        np.testing.assert_allclose(built.nodes.centre[node], expected)


@settings(deadline=None, max_examples=60)
@given(labelled())
def test_links_are_those_of_a_loop_over_faces(labels):
    built, numbers = built_of(labels)
    links = built.links
    centre = (built.nodes.centre / PITCH).tolist()
    expected = links_of(numbers, centre)
    pairs = list(zip(links.src.tolist(), links.dst.tolist(), strict=True))
    assert pairs == sorted(expected)
    assert links.src.dtype == links.dst.dtype == np.int32
    for at, pair in enumerate(pairs):
        area, to_src, to_dst = expected[pair]
        normal = to_src + to_dst
        straight = np.linalg.norm(np.subtract(centre[pair[0]], centre[pair[1]]))
        length = link_distance(np.array([normal]), np.array([straight]))[0]
        assert links.area[at] == pytest.approx(area * PITCH**2)
        assert links.distance_src[at] == pytest.approx(to_src / normal * length * PITCH)
        assert links.distance_dst[at] == pytest.approx(to_dst / normal * length * PITCH)


@settings(deadline=None, max_examples=20)
@given(labelled(5, 30))
def test_links_do_not_depend_on_how_many_are_taken_at_a_time(labels):
    numbers = numbered(labels)
    built, _ = built_of(labels)
    centre = built.nodes.centre / PITCH
    at_once = block_links(numbers, centre, PITCH)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(links_module, "_CHUNK_FACES", 3)
        pieces = block_links(numbers, centre, PITCH)
    for expected, chunked in zip(at_once, pieces, strict=True):
        np.testing.assert_array_equal(expected, chunked)


@settings(deadline=None, max_examples=30)
@given(solids())
def test_single_voxels_are_linked_alike_with_and_without_a_sort(solid):
    numbers = np.where(solid, np.cumsum(solid).reshape(solid.shape) - 1, -1)
    numbers = numbers.astype(np.int32)
    plain = voxel_links(numbers, PITCH)
    sorted_ = block_links(numbers, np.argwhere(solid) + 0.5, PITCH)
    for plain_array, sorted_array in zip(plain, sorted_, strict=True):
        assert plain_array.dtype == sorted_array.dtype
        np.testing.assert_allclose(plain_array, sorted_array, rtol=1e-14)


def test_boxes_of_equal_height_conduct_as_bars_in_series():
    """k A / L with L between the middles, whatever their lengths."""
    labels = np.repeat([0, 1, 2], [2, 5, 3])[:, None, None] * np.ones((1, 3, 4), int)
    built, _ = built_of(labels)
    np.testing.assert_allclose(built.links.area, 12 * PITCH**2)
    np.testing.assert_allclose(built.links.distance_src, np.array([1, 2.5]) * PITCH)
    np.testing.assert_allclose(built.links.distance_dst, np.array([2.5, 1.5]) * PITCH)


def test_a_staircase_has_the_area_and_distance_of_its_slope():
    """Halves of a cube cut along a diagonal plane: |A| = sqrt(2) of its cross-section,
    and centroids that lie sqrt(2) / 6 of the edge from that plane each."""
    n = 60
    x, _, z = np.indices((n, 1, n))
    built, _ = built_of((x + z >= n).astype(int), 1.0)
    area = built.links.area[0]
    assert area == pytest.approx(np.sqrt(2) * n, rel=0.02)
    for distance in built.links.distance_src, built.links.distance_dst:
        assert distance[0] == pytest.approx(np.sqrt(2) * n / 6, rel=0.02)


def test_one_fine_voxel_on_a_coarse_one():
    """Along the normal 1.5; between the centres sqrt(1.5^2 + 0.5^2 + 0.5^2)."""
    labels = np.full((3, 2, 2), -1)
    labels[:2] = 0
    labels[2, 0, 0] = 1
    built, _ = built_of(labels, 1.0)
    links = built.links
    length = (1.5 + np.sqrt(2.75)) / 2
    assert links.area[0] == 1
    assert links.distance_src[0] == pytest.approx(length * 2 / 3)
    assert links.distance_dst[0] == pytest.approx(length / 3)


def test_a_shell_round_a_core_is_linked_on_all_six_sides():
    """Their centres fall together: faces on all sides count, and no distance is 0."""
    labels = np.zeros((5, 5, 5), int)
    labels[1:-1, 1:-1, 1:-1] = 1
    built, _ = built_of(labels, 1.0)
    assert built.links.area[0] == pytest.approx(np.sqrt(3) * 18)
    assert built.links.distance_src[0] > 0 and built.links.distance_dst[0] > 0


def test_groups_that_touch_over_an_edge_or_not_at_all_are_not_linked():
    labels = np.full((3, 3, 3), -1)
    labels[0, 0, 0] = 0
    labels[1, 1, 0] = 1
    labels[2, 2, 2] = 2
    built, _ = built_of(labels)
    assert [len(array) for array in built.links] == [0] * 5
    assert built.links.src.dtype == np.int32 and built.links.area.dtype == float


@pytest.mark.parametrize("value", [0, -3, 2.5, 4.0, "4", True, None, np.array([4, 4])])
def test_whole_numbers_only(value):
    with pytest.raises(InputError, match=r"Aggregate\(factor=.*whole number .* 1$"):
        whole_number(value, "Aggregate(factor=)")


@pytest.mark.parametrize(
    ("structure", "option", "value"),
    [
        *((jt.MultiLevel, "levels", value) for value in (0, -1)),
        *((jt.Octree, "levels", value) for value in (0, -1)),
        *((jt.IrregularMultiLevel, "levels", value) for value in (0, -1, True)),
        *((jt.Aggregate, "factor", value) for value in (0, -2)),
        *((jt.ShellOverCore, "layers", value) for value in (0, -1)),
        (jt.ShellOverCore, "factor", 0),
    ],
)
def test_structures_refuse_counts_below_one(structure, option, value):
    name = rf"{structure.__name__}\({option}={value}\)"
    with pytest.raises(InputError, match=f"{name}.*whole number of at least 1"):
        structure(blocks(np.ones((2, 2, 2), bool)), **{option: value})


def test_whole_numbers_of_any_type():
    assert type(whole_number(np.int64(7), "Octree(levels=)")) is int
    assert whole_number(2, "Octree(levels=)", minimum=2) == 2
