"""Shape of a body for its laws of convection: solids as a whole, sheets by panels."""

import numpy as np
from scipy.spatial import ConvexHull

from ...errors import InputError
from ...geometry.vectors import triple
from ...memo.found import found
from ...sheets.panels import panels
from ...sheets.sheet_grid import SheetGrid
from ...voxels.body_shape import BodyShape, Plate, Plates, Sphere, shape_of
from ...voxels.cylinders import Cylinder, CylinderParts, parts_of, whole_body
from ...voxels.grid import VoxelGrid
from ..surface import BodySurface


def convection_shape(
    body: BodySurface, body_shape: BodyShape | None, cylinders: tuple[Cylinder, ...]
) -> Plates | Sphere | None:
    """The plates or the sphere that a body is; None for cylinders.

    Each panel of a sheet is a plate.

    Raises:
        InputError: as `shape_of`, or for a sheet that is to be a cylinder.
    """
    grid = body.grid
    if isinstance(grid, VoxelGrid):
        shape = shape_of(grid, body_shape, cylinders, body.body)
        if isinstance(shape, Plate):
            return Plates.of_one(shape, len(body.area))
        return shape
    assert isinstance(grid, SheetGrid)
    if any(cylinder.body == body.body for cylinder in cylinders):
        return None
    if body_shape == "cylinder":
        raise InputError(
            f"body {body.body} is a sheet: give its cylinders, as in "
            "cylinders=(Cylinder(...),), or leave body_shape out"
        )
    if body_shape == "sphere":
        return found((grid,), "sphere around", lambda: _sphere_around(grid))
    return panels(grid)


def _sphere_around(grid: SheetGrid) -> Sphere:
    volume = ConvexHull(grid.cells.vertices).volume
    return Sphere(float(np.cbrt(6 / np.pi * volume)))


def flow_parts(
    body: BodySurface, shape: Plates | Sphere | None, cylinders: tuple[Cylinder, ...]
) -> CylinderParts:
    """Parts of a body in a flow, each with a diameter and an axis.

    Those of cylinders, one for a solid of another shape, or one for each panel.
    """
    if shape is None:
        return parts_of(body.grid, cylinders, body.body)
    if isinstance(body.grid, VoxelGrid):
        return whole_body(body.grid)
    if isinstance(shape, Sphere):
        middle = body.grid.mesh.bounds.mean(axis=0)
        around = Cylinder(triple(middle), (0.0, 0.0, 1.0), shape.diameter)
        return CylinderParts((around,), np.zeros(len(body.area), np.int64))
    plates = [
        Cylinder((0.0, 0.0, 0.0), triple(plate.long_axis), plate.short_side)
        for plate in shape.plates
    ]
    return CylinderParts(tuple(plates), shape.member)
