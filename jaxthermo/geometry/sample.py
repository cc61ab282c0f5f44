"""`mesh_sample`: points spread evenly over the area of a mesh, with their normals."""

from typing import Any, NamedTuple

import lazy_loader
import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, whole_number
from .mesh import AnyMesh, Pose, as_mesh


_trimesh: Any = lazy_loader.load("trimesh")


class MeshSample(NamedTuple):
    """Points on a mesh that stand for equal areas."""

    position: Float[np.ndarray, "p 3"]
    """Position [m]."""
    normal: Float[np.ndarray, "p 3"]
    """Outward unit normal of the triangle that each point is on."""
    face: Int[np.ndarray, " p"]
    """Number of that triangle in the mesh."""

    def placed(self, pose: Pose) -> "MeshSample":
        """Rotate and translate by a pose: from the frame of a body to the world."""
        return MeshSample(
            position=pose.to_world(self.position),
            normal=pose.rotate(self.normal),
            face=self.face,
        )


def mesh_sample(mesh: AnyMesh, count: int = 10_000, seed: int = 0) -> MeshSample:
    """Random points on a mesh, with equal probability per area.

    A mean over the points is a mean over the area, with the relative uncertainty
    1 / sqrt(count) times the relative spread. Equal arguments give equal points.

    Args:
        mesh: body in metres; a `trimesh.Trimesh` is accepted too.
        count: number of points.
        seed: seed of the random numbers.

    Raises:
        InputError: for no mesh, one without area, or a count that is not a whole
            number of at least 1.

    Example:
        >>> import jaxthermo as jt
        >>> sample = jt.mesh_sample(jt.shapes.box((0.02, 0.02, 0.04)), count=1000)
        >>> sample.position.shape, float(abs(sample.normal).max())
        ((1000, 3), 1.0)
    """
    surface = as_mesh(mesh, "mesh_sample(mesh=)")
    count = whole_number(count, "mesh_sample(count=)")
    seed = whole_number(seed, "mesh_sample(seed=)", minimum=0)
    vectors = surface.area_vectors
    area = np.linalg.norm(vectors, axis=1)
    if not area.sum() > 0:
        raise InputError(
            f"mesh_sample: {surface.name} has {len(surface.faces)} faces and no area: "
            "give a mesh with triangles"
        )
    trimesh_mesh = _trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    points, face, *_ = _trimesh.sample.sample_surface(
        trimesh_mesh, count, face_weight=area, seed=seed
    )
    normal = vectors[face] / area[face, None]
    return MeshSample(
        position=np.asarray(points, float),
        normal=normal.astype(float),
        face=np.asarray(face),
    )
