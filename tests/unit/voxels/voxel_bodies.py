"""Bodies for the voxelizer's tests."""

import numpy as np

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh


BALL = shapes.sphere(1.0, subdivisions=4)


def joined(*meshes):
    """Several closed parts as one mesh, without any cutting."""
    first = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.faces + n for m, n in zip(meshes, first, strict=True)]),
        "joined",
    )


def inverted(mesh):
    """The same surface around a cavity."""
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], "inverted")


def without(mesh, drop):
    """The mesh with some of its faces gone."""
    return Mesh(mesh.vertices, mesh.faces[~drop], "open")


def normals(mesh):
    vectors = mesh.area_vectors
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def dense_volumes(cut, shape):
    """Volume of every voxel of a lattice [voxels]; 1 where not cut."""
    voxels = np.argwhere(np.ones(shape, bool))
    return cut.volumes_at(voxels, shape).reshape(shape)
