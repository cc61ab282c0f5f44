"""Union and difference of closed meshes, by the manifold library (an extra)."""

from collections.abc import Callable
from typing import Any

import lazy_loader
import numpy as np

from ..errors import InputError
from ..extras import require_extra
from .mesh import Mesh


# Imported at its first use: it is slow to import, and few scenes combine shapes.
_trimesh: Any = lazy_loader.load("trimesh")


def union(*meshes: Mesh) -> Mesh:
    """One body of all the space inside any of the meshes.

    Unlike overlapping meshes in one file, it has no faces inside.

    Raises:
        InputError: without the package manifold3d, or for a mesh that is not closed.

    Example:
        >>> import jaxthermo as jt
        >>> post = jt.shapes.cylinder(0.01, 0.1).moved((0.0, 0.0, 0.05))
        >>> lamp = jt.shapes.union(jt.shapes.box(0.06), post)  # doctest: +SKIP
    """
    return _combined("union", _trimesh.boolean.union, meshes)


def difference(mesh: Mesh, *removed: Mesh) -> Mesh:
    """The space inside a mesh and outside of all the removed ones.

    Raises:
        InputError: without the package manifold3d, for a mesh that is not closed, or
            if nothing is left.
    """
    return _combined("difference", _trimesh.boolean.difference, (mesh, *removed))


def _combined(name: str, combine: Callable[..., Any], meshes: tuple[Mesh, ...]) -> Mesh:
    require_extra(f"shapes.{name} needs", package="manifold3d", extra="boolean")
    if len(meshes) < 2:
        raise InputError(f"shapes.{name}: give two meshes or more, not {len(meshes)}")
    for number, mesh in enumerate(meshes):
        # The library would return an empty mesh, or raise an unclear error.
        if not (mesh.is_watertight and mesh.volume > 0):
            raise InputError(
                f"shapes.{name}: mesh {number} ({mesh.name}) is not closed, with its "
                "faces outward: repair it first (see load_mesh)"
            )
    bodies = [_trimesh.Trimesh(m.vertices, m.faces, process=False) for m in meshes]
    combined = combine(bodies, engine="manifold", check_volume=False)
    if not len(combined.faces):
        raise InputError(f"shapes.{name}: nothing is left of mesh 0 ({meshes[0].name})")
    vertices = np.asarray(combined.vertices, float)
    return Mesh(
        vertices=vertices, faces=np.asarray(combined.faces, np.int64), name=name
    )
