"""Each defect is mended and counted; what is meant is left alone."""

from dataclasses import replace

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh, winding_number
from jaxthermo.geometry.repair import repair_mesh


def joined(*meshes):
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=False)]),
    )


def inverted(mesh):
    return replace(mesh, faces=mesh.faces[:, ::-1])


def ball(radius=1.0):
    return shapes.sphere(radius, subdivisions=2)


def test_a_sound_mesh_is_left_alone():
    mesh = repair_mesh(ball())
    assert mesh.repairs == {}
    assert np.array_equal(mesh.faces, ball().faces)
    assert np.array_equal(mesh.vertices, ball().vertices)


def test_equal_vertices_merge():
    mesh = shapes.box(1.0)
    soup = Mesh(mesh.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    mended = repair_mesh(soup)
    assert mended.repairs == {"merged_vertices": 28}
    assert mended.is_watertight
    assert len(mended.vertices) == 8


def test_degenerate_and_unused_go():
    mesh = ball()
    extra = np.array([[0, 0, 5], [3, 4, 3]])
    dirty = replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, [[9.0, 9.0, 9.0]]]),
        faces=np.concatenate([mesh.faces, extra]),
    )
    mended = repair_mesh(dirty)
    assert mended.repairs == {"degenerate_faces": 2, "unused_vertices": 1}
    assert np.array_equal(mended.faces, mesh.faces)


@pytest.mark.parametrize("turn", [[0, 1, 2], [1, 2, 0], [0, 2, 1]])
def test_duplicate_faces_go(turn):
    mesh = ball()
    copies = mesh.faces[10:14][:, turn]
    mended = repair_mesh(replace(mesh, faces=np.concatenate([mesh.faces, copies])))
    assert mended.repairs == {"duplicate_faces": 4}
    assert mended.is_watertight
    assert mended.volume == pytest.approx(mesh.volume)


def test_two_sided_export_becomes_one_surface():
    mesh = ball()
    two_sided = replace(mesh, faces=np.concatenate([mesh.faces[:, ::-1], mesh.faces]))
    mended = repair_mesh(two_sided)
    assert mended.repairs["duplicate_faces"] == len(mesh.faces)
    assert mended.volume == pytest.approx(mesh.volume)


def test_wall_between_two_bodies_stays():
    pair = joined(shapes.box(1.0), shapes.box(1.0).moved((1.0, 0.0, 0.0)))
    mended = repair_mesh(pair)
    assert mended.is_watertight
    assert mended.volume == pytest.approx(2.0)
    assert "duplicate_faces" not in mended.repairs


def test_mixed_winding_becomes_consistent():
    mesh = ball()
    turned = np.random.default_rng(3).random(len(mesh.faces)) < 0.3
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    mended = repair_mesh(replace(mesh, faces=faces))
    assert mended.repairs == {"flipped_faces": int(turned.sum())}
    assert mended.volume == pytest.approx(mesh.volume)


def test_inverted_part_is_turned():
    pair = joined(ball(), inverted(ball().moved((3.0, 0.0, 0.0))))
    mended = repair_mesh(pair)
    assert mended.repairs == {"flipped_faces": 320}
    assert mended.volume == pytest.approx(2.0 * ball().volume)


@pytest.mark.parametrize("outside_in", [False, True])
def test_cavity_stays(outside_in):
    hollow = joined(ball(1.0), inverted(ball(0.5)))
    mended = repair_mesh(inverted(hollow) if outside_in else hollow)
    assert mended.repairs == ({"flipped_faces": 640} if outside_in else {})
    assert mended.volume == pytest.approx(ball().volume * (1.0 - 0.125))


def test_solid_inside_a_cavity_stays():
    nest = joined(ball(1.0), inverted(ball(0.5)), ball(0.2))
    mended = repair_mesh(inverted(nest))
    assert mended.volume == pytest.approx(ball().volume * (1.0 - 0.125 + 0.008))


def test_part_beside_in_the_same_box_is_no_cavity():
    # A cube in the open corner of an L-shaped body: inside its box, not inside it.
    ring = joined(shapes.box((4.0, 1.0, 1.0)).moved((0.0, 1.5, 0.0)))
    bar = shapes.box((1.0, 4.1, 1.2)).moved((-1.5, 0.0, 0.0))
    cube = inverted(shapes.box(0.5).moved((1.0, -1.0, 0.0)))
    mended = repair_mesh(joined(ring, bar, cube))
    assert mended.repairs == {"flipped_faces": 12}


def test_open_inverted_body_is_turned():
    mesh = ball()
    bowl = replace(mesh, faces=mesh.faces[mesh.triangles[:, :, 2].max(1) < 0.7])
    mended = repair_mesh(inverted(bowl))
    assert mended.repairs["flipped_faces"] == len(bowl.faces)


@pytest.mark.parametrize("missing", [1, 2, 4])
def test_small_holes_are_filled(missing):
    mesh = ball()
    near = np.argsort(mesh.triangles.mean(1)[:, 2])[missing:]
    mended = repair_mesh(replace(mesh, faces=mesh.faces[near]))
    assert mended.is_watertight
    assert mended.repairs["filled_holes"] >= 1
    assert mended.volume == pytest.approx(mesh.volume, rel=5e-3)


def test_two_holes_that_meet_in_a_vertex():
    mesh = ball()
    around = np.flatnonzero((mesh.faces == 0).any(1))
    first = mesh.faces[around[0]]
    shared = [np.intersect1d(first, mesh.faces[neighbour]).size for neighbour in around]
    second = around[shared.index(1)]
    keep = np.setdiff1d(np.arange(len(mesh.faces)), [around[0], second])
    mended = repair_mesh(replace(mesh, faces=mesh.faces[keep]))
    assert mended.repairs == {"filled_holes": 2}
    assert mended.is_watertight


def test_holes_of_many_edges_stay():
    mesh = shapes.sphere(1.0, subdivisions=3)
    cap = replace(mesh, faces=mesh.faces[mesh.triangles[:, :, 2].max(1) < 0.95])
    mended = repair_mesh(cap)
    assert mended.repairs.get("filled_holes") is None
    assert mended.open_edges == cap.open_edges > 8
    assert repair_mesh(cap, max_hole_edges=100).is_watertight


def test_a_cup_keeps_its_mouth():
    mesh = shapes.box(1.0)
    cup = replace(mesh, faces=mesh.faces[mesh.triangles[:, :, 2].min(1) < 0.4])
    assert len(cup.faces) == 10
    assert repair_mesh(cup).open_edges == 4


def test_moebius_band_is_left():
    n = 12
    angle = 2.0 * np.pi * np.arange(n) / n
    rim = [
        np.stack(
            [
                (1 + s * np.cos(angle / 2)) * np.cos(angle),
                (1 + s * np.cos(angle / 2)) * np.sin(angle),
                s * np.sin(angle / 2),
            ],
            axis=1,
        )
        for s in (-0.3, 0.3)
    ]
    i = np.arange(n)
    next_vertex = (i + 1) % n
    # Past the seam the two rims change places.
    low = np.where(next_vertex > i, next_vertex, n)
    high = np.where(next_vertex > i, next_vertex + n, 0)
    faces = np.concatenate(
        [np.stack([i, low, high], axis=1), np.stack([i, high, i + n], axis=1)]
    )
    band = Mesh(np.concatenate(rim), faces)
    assert "flipped_faces" not in repair_mesh(band).repairs


def test_repairs_add_up_and_are_idempotent():
    mesh = ball()
    dirty = replace(mesh, faces=np.concatenate([mesh.faces, mesh.faces[:3]]))
    once = repair_mesh(dirty)
    assert repair_mesh(once).repairs == once.repairs == {"duplicate_faces": 3}


def test_winding_number():
    triangles = ball().triangles
    assert winding_number(triangles, np.array([0.1, 0.2, 0.3])) == pytest.approx(1.0)
    assert winding_number(triangles, np.array([3.0, 0.0, 0.1])) == pytest.approx(0.0)
