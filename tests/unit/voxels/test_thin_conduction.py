"""Conduction along thin parts that are turned against the lattice."""

import numpy as np
import pytest
import scipy

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Pose
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.thin_conduction import thin_voxels
from jaxthermo.voxels.voxelize import voxelize


PITCH = 0.001
LENGTH = 0.06
WIDTH = 0.02


def turned(lean, roll):
    """Turned about its short side, after a turn about its long one [degrees]."""
    b, a = np.radians([lean, roll])
    about_y = np.array(
        [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    )
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    )
    return about_y @ about_x


def plate(thickness, rotation):
    first, second, third = ((float(x), float(y), float(z)) for x, y, z in rotation)
    pose = Pose((0.0013, 0.0007, 0.0003), (first, second, third))
    mesh = shapes.box((LENGTH, WIDTH, thickness * PITCH)).placed(pose)
    return voxelize(mesh, PITCH)


def conducted(grid, direction, length, section):
    """Steady heat flow along a direction over that of the true plate.

    The ends are held at temperatures that are linear in the distance along it.
    """
    structure = FullVolume(grid, stencil=False)
    links = structure.links()
    conductance = links.area / (links.distance_src + links.distance_dst)
    x = structure.nodes().location @ direction
    x = x - (x.min() + x.max()) / 2
    count = len(x)
    ends = np.concatenate([links.src, links.dst])
    others = np.concatenate([links.dst, links.src])
    off = scipy.sparse.coo_matrix(
        (np.tile(conductance, 2), (ends, others)), (count, count)
    ).tocsr()
    matrix = scipy.sparse.diags(np.asarray(off.sum(1)).ravel()) - off
    held = np.abs(x) > 0.4 * length
    _, piece = scipy.sparse.csgraph.connected_components(off)
    free = np.flatnonzero(~held & np.isin(piece, piece[held]))
    field = np.where(held, x, 0.0)
    inner = matrix[free][:, free].tocsc()
    field[free] = scipy.sparse.linalg.spsolve(inner, -(matrix[free] @ field))
    flow = (matrix @ field)[x > 0.4 * length].sum()
    middle = np.abs(x) < 0.3 * length
    slope = np.polyfit(x[middle], field[middle], 1)[0]
    return 0.0 if abs(flow) < 1e-12 else flow / (slope * section)


@pytest.mark.parametrize(
    ("thickness", "lean", "roll"),
    [
        (0.5, 0, 0),
        (0.5, 20, 0),
        (0.5, 45, 0),
        (1.0, 20, 0),
        (1.0, 45, 0),
        (1.4, 20, 0),
        (1.4, 45, 0),
        (1.8, 0, 20),
        (1.2, 45, 30),
    ],
)
def test_it_is_that_of_the_steady_heat_flow(thickness, lean, roll):
    """In the worse direction, to 0.06 of the true one; 0 where a plate falls apart."""
    rotation = turned(lean, roll)
    grid = plate(thickness, rotation)
    deep = thickness * PITCH
    flows = (
        conducted(grid, rotation[:, 0], LENGTH, WIDTH * deep),
        conducted(grid, rotation[:, 1], WIDTH, LENGTH * deep),
    )
    estimate = grid.thin_conduction
    assert estimate is not None
    assert estimate.mean == pytest.approx(min(flows), abs=0.06)
    assert estimate.lowest <= estimate.mean + 1e-9


def test_a_plate_along_the_lattice_conducts_all():
    for thickness in (0.4, 1.0, 2.0):
        estimate = plate(thickness, np.eye(3)).thin_conduction
        assert estimate is not None
        assert estimate.mean == pytest.approx(1.0, abs=2e-3) and not estimate.is_off


def test_thick_bodies_have_no_thin_parts():
    for mesh in (shapes.box(0.02), shapes.sphere(0.01)):
        assert voxelize(mesh, PITCH).thin_conduction is None
    solid = np.zeros((9, 9, 9), bool)
    solid[2:7, 2:7, 2:7] = True
    assert not thin_voxels(solid).any()
    solid[2:7, 2:7, 4:7] = False
    assert thin_voxels(solid).sum() == 50


def test_the_receipt_says_by_how_much():
    body = jt.Body(
        FullVolume(plate(1.0, turned(20, 0))),
        jt.Material(1.0, 1.0, 1.0),
        temperature=300.0,
    )
    (warning,) = [
        line
        for line in jt.compile_scene(jt.Scene((body,))).receipt.warnings
        if "conducts" in line
    ]
    assert "of what it should along its parts of up to two voxels" in warning
    assert "\n" not in warning and warning.startswith("body 0 conducts ")
