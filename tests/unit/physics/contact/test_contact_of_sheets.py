"""Contact of sheets: areas against polygon clipping, touched faces, overlaps."""

import functools
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose
from placed import box_grid, placed

import jaxthermo as jt
from jaxthermo.physics.contact.overlap import SheetOverlap, find_overlaps
from jaxthermo.physics.contact.search import contacts_between, find_contacts


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)
QUARTER = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])
FRONT = 0
BACK = 1


def rectangle(x, y):
    """A rectangle about the origin; its front looks along z."""
    corners = np.column_stack([QUARTER * [x, y], np.zeros(4)])
    return jt.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


@functools.cache
def plate(x=1.0, y=0.6, pitch=0.1, nodes: Literal["cells", "vertices"] = "cells"):
    layers = (jt.Layer(STEEL, 1e-3),)
    return jt.Sheet(rectangle(x, y), layers, pitch, nodes=nodes).grid


def faces(sheet):
    assert sheet.grid.fragment_face is not None
    return sheet.grid.fragment_face


def corners_of(x, y, at=(0.0, 0.0), degrees=0.0):
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return QUARTER * [x, y] @ turn.T + at


def clipped(polygon, window):
    """The part of a polygon within a convex one, by its counter-clockwise edges."""
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        along = end - start
        points = []
        for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            side_p, side_q = (
                along[0] * (r - start)[1] - along[1] * (r - start)[0] for r in (p, q)
            )
            if side_p >= 0:
                points.append(p)
            if side_p * side_q < 0:
                points.append(p + (q - p) * side_p / (side_p - side_q))
        polygon = np.array(points)
    return polygon


def area_of(polygon):
    x, y = polygon.T
    return 0.5 * np.abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("degrees", [0.0, 5.0, 30.0, 45.0, 81.0])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.337, 0.121), (0.013, -0.28)])
def test_the_area_of_two_turned_sheets_is_that_of_the_common_polygon(degrees, shift):
    first = placed(plate(1.0, 1.0))
    second = placed(plate(1.2, 0.9), (*shift, 0.01), turn=(0.0, 0.0, degrees))
    polygon = clipped(corners_of(1.0, 1.0), corners_of(1.2, 0.9, shift, degrees))
    expected = area_of(polygon)
    areas = []
    for pairs in (
        find_contacts(first, second),
        find_contacts(second, first).swapped(),
    ):
        assert pairs.area.sum() == pytest.approx(expected, rel=0.005)
        assert_allclose(pairs.gap, 0.01, atol=1e-9)
        areas.append(pairs.area.sum())
        for sheet, fragment, coverage, face in (
            (first, pairs.fragment_a, pairs.coverage_a, FRONT),
            (second, pairs.fragment_b, pairs.coverage_b, BACK),
        ):
            assert (faces(sheet)[fragment] == face).all()
            assert (coverage[faces(sheet) != face] == 0).all()
            covered = coverage @ sheet.grid.fragment_area
            assert covered == pytest.approx(expected, rel=0.01)
    assert areas[0] == pytest.approx(areas[1], rel=0.005)


def test_a_sheet_that_is_wholly_covered_has_its_area():
    small = placed(plate(0.5, 0.37, 0.06), (0.02, 0.03, -0.003), turn=(0.0, 0.0, 17.0))
    pairs = find_contacts(small, placed(plate(1.0, 1.0)))
    assert pairs.area.sum() == pytest.approx(0.5 * 0.37, rel=1e-12)
    assert_allclose(pairs.coverage_a, faces(small) == FRONT, atol=1e-12)


@pytest.mark.parametrize(("pitch", "nodes"), [(0.04, "cells"), (0.1, "vertices")])
@pytest.mark.parametrize("height", [0.0, 1e-9, -1e-9, 0.01, -0.01])
def test_a_plate_touches_a_block_with_the_face_towards_it(pitch, height, nodes):
    block = placed(box_grid((1.2, 0.9, 0.1), 0.05))
    above = placed(
        plate(1.0, 0.6, pitch, nodes),
        (0.01, 0.02, 0.05 + height),
        turn=(0.0, 0.0, 10.0),
    )
    below = placed(above.grid, (0.01, 0.02, -0.05 - height), turn=(0.0, 0.0, 10.0))
    for sheet, face, up in ((above, BACK, 1.0), (below, FRONT, -1.0)):
        (pairs,) = contacts_between((block, sheet)).values()
        (swapped,) = contacts_between((sheet, block)).values()
        expected = area_of(corners_of(1.0, 0.6))
        assert pairs.area.sum() == pytest.approx(expected, rel=1e-9)
        assert swapped.area.sum() == pytest.approx(expected, rel=1e-9)
        assert_allclose(pairs.coverage_b, faces(sheet) == face, atol=1e-9)
        normal = block.grid.fragment_normal[pairs.fragment_a]
        assert_allclose(normal, np.broadcast_to([0, 0, up], normal.shape), atol=1e-12)
        assert_allclose(pairs.gap, height, atol=1e-9)


def test_a_plate_over_the_edge_of_a_block_touches_with_their_common_part():
    block = placed(box_grid((1.0, 0.8, 0.1), 0.05))
    at = (0.43, 0.11)
    sheet = placed(plate(0.9, 0.7, 0.06), (*at, 0.05), turn=(0.0, 0.0, 33.0))
    polygon = clipped(corners_of(0.9, 0.7, at, 33.0), corners_of(1.0, 0.8))
    pairs = find_contacts(block, sheet)
    assert pairs.area.sum() == pytest.approx(area_of(polygon), rel=0.01)
    covered = pairs.coverage_a @ block.grid.fragment_area
    assert covered == pytest.approx(area_of(polygon), rel=0.01)


def test_a_cladding_covers_the_solid_and_only_its_back():
    solid = placed(box_grid((0.4, 0.3, 0.2), 0.05))
    mesh = solid.grid.mesh
    cladding = placed(jt.Sheet(mesh, (jt.Layer(STEEL, 1e-3),), 0.05).grid)
    pairs = find_contacts(solid, cladding)
    assert pairs.area.sum() == pytest.approx(mesh.area, rel=1e-3)
    face = faces(cladding)
    assert pairs.coverage_b[face == FRONT].max() == 0
    assert pairs.coverage_b[face == BACK].min() > 0.99
    assert pairs.coverage_a @ solid.grid.fragment_area == pytest.approx(
        mesh.area, rel=0.01
    )


def test_of_two_sheets_at_one_place_the_second_lies_on_the_front_of_the_first():
    first = placed(plate(1.0, 0.6))
    for second in (
        placed(plate(1.0, 0.6, 0.07)),
        placed(plate(1.0, 0.6, 0.13)),
        placed(plate(1.0, 0.6), turn=(180.0, 0.0, 0.0)),
    ):
        (pairs,) = contacts_between((first, second)).values()
        assert (faces(first)[pairs.fragment_a] == FRONT).all()
        is_turned = second.pose.rotation[2][2] < 0
        face = faces(second)[pairs.fragment_b]
        assert (face == (FRONT if is_turned else BACK)).all()
        assert pairs.area.sum() == pytest.approx(0.6, rel=1e-3)


def test_a_part_of_a_bent_sheet_touches_another_sheet():
    """A box of sheet on a table: only its floor touches, with its front."""
    housing = placed(
        jt.Sheet(jt.shapes.box((0.4, 0.3, 0.2)), (jt.Layer(STEEL, 1e-3),), 0.05).grid,
        (0.1, 0.0, 0.101),
        turn=(0.0, 0.0, 25.0),
    )
    table = placed(plate(1.0, 1.0))
    pairs = find_contacts(table, housing)
    assert pairs.area.sum() == pytest.approx(0.12, rel=0.01)
    assert (faces(table)[pairs.fragment_a] == FRONT).all()
    assert (faces(housing)[pairs.fragment_b] == FRONT).all()
    normal = housing.grid.fragment_normal[pairs.fragment_b]
    assert (normal[:, 2] < -0.999).all()


def test_sheets_apart_by_more_than_the_threshold_do_not_touch():
    first = placed(plate())
    second = placed(plate(), (0.0, 0.0, 0.02))
    assert find_contacts(first, second, 0.03).count
    assert not find_contacts(first, second, 0.01).count
    # Within a cell, and not within a tenth of one.
    pitch = first.pitch
    assert not find_contacts(first, second).count
    assert find_contacts(first, placed(plate(), (0.0, 0.0, 0.09 * pitch))).count
    block = placed(box_grid((1.0, 0.8, 0.1), pitch), (0.0, 0.0, -0.05 - 0.9 * pitch))
    assert find_contacts(first, block).count
    upright = placed(plate(), (0.0, 0.0, 0.31), turn=(90.0, 0.0, 0.0))
    assert not find_contacts(first, upright).count


def test_a_sheet_through_a_solid_is_told_and_one_within_it_refused():
    solid = placed(box_grid((0.5, 0.5, 0.5), 0.05))
    upright = placed(plate(0.2, 1.0, 0.05), turn=(90.0, 0.0, 0.0))
    overlap = find_overlaps((solid, upright))[0, 1]
    assert isinstance(overlap, SheetOverlap)
    assert overlap.area == pytest.approx(0.1, rel=0.05)
    assert overlap.depth == pytest.approx(0.25, abs=0.06)
    line = overlap.described((0, 1))
    assert line.startswith("body 1, a sheet, passes through body 0: 0.1 m2")
    with pytest.raises(jt.InputError, match="overlap by about"):
        find_contacts(solid, upright)
    inside = placed(plate(0.2, 0.2, 0.05))
    with pytest.raises(jt.InputError, match="body 0, a sheet, lies wholly in the sol"):
        find_overlaps((inside, solid))
    for height in (0.25, 0.25 - 1e-9, 0.25 + 1e-9, 0.23):
        assert not find_overlaps((placed(plate(0.2, 0.2), (0, 0, height)), solid))
    assert not find_overlaps((placed(plate()), placed(plate(), turn=(90.0, 0, 0))))
