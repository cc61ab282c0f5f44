"""What each face of a sheet sees: sky, ground, other sheets, and itself."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.physics.radiation.patches import PatchedBody, group_patches
from jaxthermo.physics.radiation.view_factors import ViewFactors, view_factors
from jaxthermo.physics.radiation.visibility import sky_view
from jaxthermo.reference.view_factor import (
    parallel_rectangles,
    perpendicular_rectangles,
)
from tests.sheet_bodies import plate


BLACK = jt.Material(50.0, density=8000.0, specific_heat=500.0, emissivity=1.0)
LAYERS = (jt.Layer(BLACK, 1e-3),)
PITCH = 0.1
EDGE = 1.0


def joined(*meshes):
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + n for mesh, n in zip(meshes, first, strict=False)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return jt.Mesh(vertices, np.concatenate(faces))


def two_plates(gap):
    """Plates on top of each other, facing up, as one mesh."""
    floor = plate(EDGE, EDGE)
    return joined(floor, floor.moved((0.0, 0.0, gap)))


def corner():
    """A floor that faces up and a wall at its edge, facing the space above it."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    wall = corners[:, [2, 1, 0]]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    # The normal of the wall is +x.
    return joined(jt.Mesh(corners, faces), jt.Mesh(wall, faces[:, ::-1]))


class Seen(NamedTuple):
    """Mean view factors of some fragments, by area [-]."""

    sky: float
    ground: float


def seen_by(mesh, directions=512):
    """A function for the mean view of the fragments of a face in a part of a sheet."""
    grid = jt.Sheet(mesh, LAYERS, PITCH).grid
    view = sky_view(
        mesh.triangles,
        position=grid.fragment_position,
        normal=grid.fragment_normal,
        pitch=grid.fragment_edge,
        directions=directions,
    )

    def mean(face, flags):
        chosen = (grid.fragment_face == face) & flags(
            grid.fragment_position, grid.fragment_normal
        )
        area = grid.fragment_area[chosen]
        values = (np.average(part[chosen], weights=area) for part in view)
        return Seen(*values)

    return mean


def test_faces_of_a_horizontal_plate_see_sky_and_ground():
    mean = seen_by(plate(EDGE, EDGE), 128)
    for face, expected in ((0, (1.0, 0.0)), (1, (0.0, 1.0))):
        assert_allclose(mean(face, lambda x, n: x[:, 2] == 0), expected, atol=1e-12)


@pytest.mark.parametrize("gap", [0.04, 0.3])
def test_plates_hide_sky_and_ground_from_each_other(gap):
    mean = seen_by(two_plates(gap))
    between = parallel_rectangles(EDGE, EDGE, gap)

    def lower(position, normal):
        return position[:, 2] < gap / 2

    def upper(position, normal):
        return position[:, 2] > gap / 2

    assert_allclose(mean(0, upper), (1.0, 0.0), atol=1e-4)
    assert_allclose(mean(1, lower), (0.0, 1.0), atol=1e-4)
    # Of 512 directions, those that graze the plates are few.
    assert_allclose(mean(0, lower), (1 - between, 0.0), atol=0.015)
    assert_allclose(mean(1, upper), (0.0, 1 - between), atol=0.015)


def test_sheets_in_a_corner_hide_what_is_behind_the_other():
    mean = seen_by(corner())
    between = perpendicular_rectangles(1.0, 1.0, 1.0)

    def floor(position, normal):
        return np.abs(normal[:, 2]) > 0.5

    def wall(position, normal):
        return np.abs(normal[:, 0]) > 0.5

    assert_allclose(mean(0, floor), (1 - between, 0.0), atol=0.01)
    assert_allclose(mean(1, floor), (0.0, 1.0), atol=1e-9)
    assert_allclose(mean(0, wall), (0.5, 0.5 - between), atol=0.01)
    assert_allclose(mean(1, wall), (0.5, 0.5), atol=1e-9)


def patched(mesh, max_patches=128):
    grid = jt.Sheet(mesh, LAYERS, PITCH).grid
    patches = group_patches(grid, area=grid.fragment_area, max_patches=max_patches)
    face = np.zeros(patches.count, int)
    face[patches.patch] = grid.fragment_face
    return PatchedBody.of_grid(grid, patches, jt.Pose()), face


def exchanged(factors: ViewFactors, first, second):
    """Mean view factor from some patches to others."""
    area = factors.between[np.ix_(first, second)].sum()
    return area / factors.area[first].sum()


@pytest.mark.parametrize(("gap", "separate"), [(0.02, True), (0.3, True), (0.3, False)])
def test_plates_exchange_by_their_facing_sides(gap, separate):
    if separate:
        floor = plate(EDGE, EDGE)
        pairs = [patched(floor), patched(floor.moved((0.0, 0.0, gap)))]
        bodies = tuple(body for body, _ in pairs)
        face = np.concatenate([faces for _, faces in pairs])
        height = np.repeat([0.0, gap], [len(faces) for _, faces in pairs])
    else:
        body, face = patched(two_plates(gap), 256)
        bodies = (body,)
        height = body.patches.centre[:, 2]
    factors = view_factors(bodies, 128)
    assert_allclose(factors.factor.sum(1) + factors.to_surroundings, 1.0)
    lower_top, lower_bottom, upper_top, upper_bottom = (
        np.flatnonzero((face == side) & ((height > gap / 2) == above))
        for above in (False, True)
        for side in (0, 1)
    )
    expected = parallel_rectangles(EDGE, EDGE, gap)
    assert exchanged(factors, lower_top, upper_bottom) == pytest.approx(
        expected, abs=0.01
    )
    outer = np.append(lower_bottom, upper_top)
    assert_allclose(factors.to_surroundings[outer], 1.0, atol=1e-9)


@pytest.mark.parametrize("height", [1.0, 0.04])
def test_a_closed_sheet_exchanges_inside_with_itself_alone(height):
    mesh = jt.shapes.box((1.0, 1.0, height))
    body, face = patched(mesh)
    factors = view_factors((body,), 128)
    outside = np.flatnonzero(face == 0)
    inside = np.flatnonzero(face == 1)
    assert_allclose(factors.to_surroundings[outside], 1.0, atol=1e-9)
    assert_allclose(factors.to_surroundings[inside], 0.0, atol=1e-9)
    # From the inside of the floor to that of the ceiling.
    middle = body.patches.centre[:, 2]
    up = body.patches.code % 6
    floor = inside[(up[inside] == 5) & (middle[inside] < 0)]
    ceiling = inside[(up[inside] == 4) & (middle[inside] > 0)]
    assert exchanged(factors, floor, ceiling) == pytest.approx(
        parallel_rectangles(1.0, 1.0, height), abs=0.01
    )


def test_a_lamp_in_a_box_lights_its_inner_side_alone():
    """Radiant intensity I in all directions: 4 pi I in all."""
    mesh = jt.shapes.box((1.0, 1.0, 1.0))
    sheet = jt.Sheet(mesh, LAYERS, PITCH)
    lamp = jt.PointSource((0.1, 0.0, 0.2), 10.0)
    scene = jt.Scene((jt.Body(sheet, temperature=300.0),), (lamp,), dtype="float64")
    solution = jt.simulate(scene, 0.0)
    irradiance = np.asarray(solution.irradiance(0).sources).reshape(-1)
    grid = sheet.grid
    assert (irradiance[grid.fragment_face == 0] == 0).all()
    total = grid.fragment_area @ irradiance
    assert total == pytest.approx(4 * np.pi * 10.0, rel=0.01)


def test_a_shield_halves_the_exchange_of_two_plates():
    """Large black plates and a thin black sheet between them, at its steady state."""
    floor = plate(1.0, 1.0)
    gap = 0.02
    hot, cold = 400.0, 300.0
    bodies = tuple(
        jt.Body(
            jt.Sheet(floor, LAYERS, 0.1),
            temperature=kelvin,
            pose=jt.Pose((0.0, 0.0, height)),
        )
        for kelvin, height in ((hot, 0.0), (340.0, gap), (cold, 2 * gap))
    )
    terms = (
        jt.RadiativeExchange(200.0, directions=64, max_patches=16),
        jt.FixedTemperature(hot, on=jt.Side((0.0, 0.0, 1.0), body=0)),
        jt.FixedTemperature(cold, on=jt.Side((0.0, 0.0, -1.0), body=2)),
    )
    scene = jt.Scene(bodies, terms, dtype="float64")
    factor = parallel_rectangles(1.0, 1.0, gap)
    solution = jt.steady(scene)
    shield = float(np.asarray(solution.mean_temperature)[-1, 1])
    # Of two faces, each sees one plate and the cold surroundings.
    around = (1 - factor) * 200.0**4
    expected = (factor * (hot**4 + cold**4) / 2 + around) ** 0.25
    assert shield == pytest.approx(expected, abs=0.5)
