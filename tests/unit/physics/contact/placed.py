"""Placed bodies for tests of contact: the grids are built once."""

import functools

import numpy as np
from scipy.spatial.transform import Rotation

from jaxthermo.geometry.mesh import Pose
from jaxthermo.geometry.shapes import box, sphere
from jaxthermo.physics.contact.rays import PlacedGrid
from jaxthermo.voxels.voxelize import voxelize


@functools.cache
def box_grid(size, pitch):
    return voxelize(box(size), pitch)


@functools.cache
def ball_grid(radius, pitch, subdivisions=4):
    return voxelize(sphere(radius, subdivisions), pitch)


def pose(translation=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """Turned by a rotation vector [degrees], then moved."""
    matrix = Rotation.from_rotvec(turn, degrees=True).as_matrix()
    x, y, z = (float(c) for c in translation)
    return Pose((x, y, z), tuple(tuple(row) for row in matrix.tolist()))


def placed(grid, translation=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), name="body"):
    return PlacedGrid(grid, pose(translation, turn), name)


def moved(body, by):
    """A body after another rigid motion of the whole world."""
    rotation = np.array(by.rotation) @ np.array(body.pose.rotation)
    x, y, z = by.to_world(np.array(body.pose.translation)).tolist()
    turned = tuple(tuple(row) for row in rotation.tolist())
    return PlacedGrid(body.grid, Pose((x, y, z), turned), body.name)
