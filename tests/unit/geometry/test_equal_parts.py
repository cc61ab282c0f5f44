"""Parts of equal geometry: one mesh with the pose of each; and walls of a thickness."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry.equal_parts import placed_parts
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.wall_thickness import wall_thickness


TURNED = jt.Pose.about((1.0, 2.0, -0.5), 0.7, (0.3, -2.0, 1.0))


def prism() -> Mesh:
    """A body without symmetry."""
    return jt.shapes.prism([(0.0, 0.0), (0.4, 0.0), (0.3, 0.2), (0.0, 0.1)], 0.25)


def test_copies_share_the_first_mesh_and_have_its_pose():
    first = prism()
    parts = {"a": first, "b": first.placed(TURNED), "c": first.moved((1.0, 0.0, 0.0))}
    placed = placed_parts(parts)
    assert all(part.mesh is first for part in placed.values())
    assert placed["a"].pose == jt.Pose()
    assert np.array(placed["b"].pose.rotation) == pytest.approx(
        np.array(TURNED.rotation), abs=1e-12
    )
    # A translation has exactly no rotation.
    assert placed["c"].pose.rotation == jt.Pose().rotation
    for name, part in placed.items():
        assert part.mesh.placed(part.pose).vertices == pytest.approx(
            parts[name].vertices, abs=1e-12
        )


def test_flat_parts_are_turned_not_mirrored():
    first = jt.shapes.rectangle(0.3, 0.2)
    placed = placed_parts({"a": first, "b": first.placed(TURNED)})
    assert placed["b"].mesh is first
    normal = first.placed(placed["b"].pose).area_vectors.sum(axis=0)
    expected = first.placed(TURNED).area_vectors.sum(axis=0)
    assert normal == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("scale", [(1.0, 1.0, -1.0), (1.001, 1.001, 1.001)])
def test_scaled_and_mirrored_parts_have_a_mesh_of_their_own(scale):
    first = prism()
    faces = first.faces[:, ::-1] if scale[2] < 0 else first.faces
    other = Mesh(first.vertices * np.array(scale), faces)
    # The same faces in the same order, as a file that mirrors by its vertices alone.
    unturned = Mesh(first.vertices * np.array(scale), first.faces)
    placed = placed_parts({"a": first, "b": other, "c": unturned})
    assert placed["b"].mesh is not first
    assert placed["c"].mesh is not first
    assert all(part.pose == jt.Pose() for part in placed.values())


@pytest.mark.parametrize(
    ("mesh", "thickness"),
    [
        (jt.shapes.box((0.5, 0.4, 0.004)), 0.004),
        (jt.shapes.box((0.5, 0.4, 0.004)).placed(TURNED), 0.004),
        (jt.shapes.box((0.1, 0.08, 0.004)), 0.004),
        (jt.shapes.box((0.04, 0.04, 0.004)).placed(TURNED), 0.004),
        (jt.shapes.tube(0.1, 0.098, 0.3), 0.002),
        (jt.shapes.box((1.0, 1.0, 1.0)), None),
        (jt.shapes.box((2.0, 0.01, 0.01)), None),
        (jt.shapes.sphere(0.1), None),
        (jt.shapes.cylinder(0.01, 3.0), None),
    ],
    ids=[
        *("plate", "turned plate", "board", "turned small board"),
        *("tube", "cube", "bar", "ball", "rod"),
    ],
)
def test_thickness_of_walls(mesh, thickness):
    expected = None if thickness is None else pytest.approx(thickness, rel=1e-3)
    assert wall_thickness(mesh) == expected
