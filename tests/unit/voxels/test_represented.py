"""True against represented: sections of the mesh, necks, and the warning."""

from dataclasses import replace

import numpy as np
import pytest
from voxel_bodies import joined

import jaxthermo as jt
from jaxthermo.geometry import shapes
from jaxthermo.structures.kinds.full import FullVolume
from jaxthermo.voxels.lattice import Lattice
from jaxthermo.voxels.represented import _mesh_sections
from jaxthermo.voxels.voxelize import voxelize


def test_sections_of_a_cone_shrink_with_the_square_of_its_height():
    mesh = shapes.cone(0.1, 0.2, sections=256)
    lattice = Lattice.around(mesh, 0.01)
    z = lattice.centres(np.arange(lattice.shape[2])[:, None] * [0, 0, 1])[:, 2]
    low, high = mesh.bounds[:, 2]
    radius = 0.1 * (high - z) / (high - low)
    sections = _mesh_sections(mesh, lattice, 2)
    assert sections == pytest.approx(np.pi * radius**2, rel=1e-3)


def test_sections_of_a_tube_leave_out_its_hole():
    mesh = shapes.tube(0.05, 0.03, 0.06, sections=256)
    lattice = Lattice.around(mesh, 0.01)
    ring = np.pi * (0.05**2 - 0.03**2)
    assert _mesh_sections(mesh, lattice, 2) == pytest.approx(ring, rel=1e-3)


def hourglass(neck):
    """A ball with a waist of a given radius."""
    ball = shapes.sphere(1.0, subdivisions=5)
    height = np.abs(ball.vertices[:, 2:])
    width = neck + (1 - neck) * np.minimum(2 * height, 1) ** 2
    return replace(ball, vertices=ball.vertices * np.hstack([width, width, height**0]))


def test_the_smallest_section_is_that_of_a_neck():
    represented = voxelize(hourglass(0.35), 0.05, "crossings").represented
    assert (
        represented is not None
        and represented.section_axis == 2
        and not represented.is_off
    )
    true = represented.smallest_section
    assert true.true == pytest.approx(np.pi * 0.35**2, rel=0.02)
    assert true.error == pytest.approx(0.0, abs=0.01)


def test_a_body_without_a_neck_has_its_widest_section():
    represented = voxelize(shapes.sphere(1.0), 0.1, "crossings").represented
    assert represented is not None
    assert represented.smallest_section.true == pytest.approx(np.pi, rel=5e-3)


def notes_and_warnings(mesh, pitch):
    structure = FullVolume(voxelize(mesh, pitch, "crossings"))
    body = jt.Body(structure, jt.Material(1.0, 1.0, 1.0), temperature=300.0)
    receipt = jt.compile_scene(jt.Scene((body,))).receipt
    return receipt.notes, receipt.warnings


def test_a_rod_of_few_voxels_is_told_by_the_receipt():
    (note,), warnings = notes_and_warnings(shapes.box((0.0206, 0.0206, 0.1)), 0.01)
    assert "100.00 % of its smallest section (4.24 cm2 across z)" in note
    assert not warnings
    notes, (warning,) = notes_and_warnings(shapes.cylinder(0.0103, 0.1), 0.01)
    assert "body 0 represents 90" in warning and "use a finer pitch" in warning
    assert not notes


def test_ends_of_separate_parts_are_no_necks():
    """Two balls side by side: the widest section, not the last slice of one."""
    ball = shapes.sphere(1.0, subdivisions=4)
    pair = joined(ball, ball.moved((3.03, 0.0, 0.0)))
    represented = voxelize(pair, 0.13).represented
    assert represented is not None and not represented.is_off
    assert represented.smallest_section.true > 3.0
