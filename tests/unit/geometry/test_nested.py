"""A closed surface inside another is a cavity, or filled where it faces outward."""

import numpy as np
import pytest

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh, joined
from jaxthermo.geometry.nested import filled_inner_surfaces


def together(*meshes):
    vertices, faces = joined([(mesh.vertices, mesh.faces) for mesh in meshes])
    return Mesh(vertices, faces)


def centred(size, offset=(0.0, 0.0, 0.0)):
    mesh = shapes.box(size)
    return mesh.moved(np.asarray(offset) - mesh.bounds.mean(0))


def inside_out(mesh):
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


OUTER = centred(2.0)
INNER = centred(1.0)


@pytest.mark.parametrize(
    ("meshes", "count"),
    [
        ((OUTER,), 0),
        ((OUTER, INNER), 1),
        ((INNER, OUTER), 1),
        ((OUTER, inside_out(INNER)), 0),
        ((OUTER, INNER, centred(0.5)), 2),
        ((OUTER, centred(1.0, (1.0, 0.0, 0.0))), 0),
        ((OUTER, centred(1.0, (5.0, 0.0, 0.0))), 0),
        ((OUTER, Mesh(INNER.vertices, INNER.faces[:-1])), 0),
    ],
    ids=["one", "two", "order", "cavity", "three", "crossing", "beside", "open"],
)
def test_surfaces_inside_others(meshes, count):
    assert filled_inner_surfaces(together(*meshes)) == count
