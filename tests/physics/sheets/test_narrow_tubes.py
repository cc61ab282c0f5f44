"""Tubes and bars of sheet conduct as much along themselves as their circumference."""

import numpy as np
import pytest

import jaxthermo as jt
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.sheets.cells import sheet_cells
from jaxthermo.sheets.doubts import poor_conduction
from jaxthermo.structures.sheet_report import sheet_warnings
from tests.sheets import conduction, open_cylinder, rotation, steady, turned


PITCH = 1.0


def open_bar(width: float, depth: float, length: float) -> Mesh:
    """Bar along z of a rectangular section, without ends."""
    square = open_cylinder(np.sqrt(0.5), length, sides=4)
    matrix = np.diag([width, depth, 1.0]) @ np.array(
        [[0.5**0.5, -(0.5**0.5), 0], [0.5**0.5, 0.5**0.5, 0], [0, 0, 1]]
    )
    return turned(square, matrix)


def conductance_along(mesh, length, matrix):
    """Conductance from end to end times the length, over that of a square [m]."""
    cells = sheet_cells(turned(mesh, matrix), pitch=PITCH)
    z = (cells.position @ matrix)[:, 2]
    start = np.flatnonzero(z < 1e-9)
    end = np.flatnonzero(z > length - 1e-9)
    laplacian = conduction(cells)
    temperature = steady(
        laplacian,
        np.zeros(len(z)),
        held=np.concatenate([start, end]),
        values=np.concatenate([np.ones(len(start)), np.zeros(len(end))]),
    )
    return (laplacian @ temperature)[start].sum() * length


@pytest.mark.parametrize(
    ("diameter", "tolerance"),
    [
        *((diameter, 0.02) for diameter in (0.3, 0.5, 0.7, 0.85, 1.0, 1.1)),
        # Here rings and groups of a few nodes may follow each other.
        (1.2, 0.08),
        (1.4, 0.05),
        *((diameter, 0.02) for diameter in (2.0, 3.0, 4.0)),
    ],
)
def test_a_tube_conducts_as_wide_as_it_is(diameter, tolerance):
    length = 12.0
    sides = 48
    around = 2 * sides * np.sin(np.pi / sides) * diameter / 2
    mesh = open_cylinder(diameter / 2, length, sides)
    for seed in range(4):
        conductance = conductance_along(mesh, length, rotation(seed))
        assert conductance == pytest.approx(around, rel=tolerance)


@pytest.mark.parametrize("width", [0.3, 0.5, 0.7, 0.85, 1.0, 1.4, 2.0, 4.0])
def test_a_bar_conducts_as_wide_as_it_is(width):
    length = 12.0
    mesh = open_bar(width, width, length)
    for seed in range(4):
        conductance = conductance_along(mesh, length, rotation(seed))
        assert conductance == pytest.approx(4 * width, rel=0.02)


@pytest.mark.parametrize("width", [0.3, 0.7, 1.2])
def test_a_flat_bar_conducts_as_wide_as_it_is(width):
    length = 12.0
    mesh = open_bar(width, 0.15 * width, length)
    for seed in range(4):
        conductance = conductance_along(mesh, length, rotation(seed))
        assert conductance == pytest.approx(2.3 * width, rel=0.02)


@pytest.mark.parametrize("width", [0.3, 0.6, 1.0])
def test_a_bar_with_caps_conducts_from_one_end_to_the_other(width):
    length = 8.0
    mesh = jt.shapes.box((width, width, length))
    for seed in range(6):
        cells = sheet_cells(turned(mesh, rotation(seed)), pitch=PITCH)
        z = (cells.position @ rotation(seed))[:, 2]
        ends = np.array([z.argmin(), z.argmax()])
        assert cells.node_count >= length / 2
        assert np.ptp(z) > 0.95 * length
        laplacian = conduction(cells)
        temperature = steady(
            laplacian, np.zeros(len(z)), held=ends, values=np.array([1.0, 0.0])
        )
        flow = (laplacian @ temperature)[ends[0]]
        assert flow * np.ptp(z) == pytest.approx(4 * width, rel=0.05)


def sheet_of(mesh, seed):
    return jt.Sheet(turned(mesh, rotation(seed)), (jt.Layer("steel", 1e-3),), PITCH)


@pytest.mark.parametrize("seed", [0, 1, 4, 5])
def test_a_bar_that_conducts_too_little_is_told(seed):
    """Flat and two cells wide: a tenth to a fourth too little."""
    length = 12.0
    mesh = open_bar(2.0, 0.3, length)
    ratio = conductance_along(mesh, length, rotation(seed)) / 4.6
    sheet = sheet_of(mesh, seed)
    doubt = poor_conduction(sheet.grid)
    assert ratio < 0.95
    assert doubt is not None
    # That of the bar is a mean along it, and this one the smallest.
    assert -0.15 < doubt.ratio - ratio < 0.1
    along = float((doubt.position @ rotation(seed))[2])
    assert -1e-9 < along < length + 1e-9
    (line,) = sheet_warnings(sheet)
    assert "% of its surface are narrow bars or tubes that conduct too little" in line
    assert line.endswith("m: give them a finer pitch")


@pytest.mark.parametrize("seed", [2, 7])
def test_nothing_is_said_where_its_nodes_suffice(seed):
    mesh = open_bar(2.0, 0.3, 12.0)
    assert conductance_along(mesh, 12.0, rotation(seed)) / 4.6 > 0.95
    assert poor_conduction(sheet_of(mesh, seed).grid) is None


@pytest.mark.parametrize(
    "mesh",
    [
        open_cylinder(0.5, 12.0, 48),
        open_cylinder(1.0, 12.0, 48),
        open_bar(1.0, 1.0, 12.0),
        open_bar(0.7, 0.1, 12.0),
        jt.shapes.box((1.4, 1.4, 3.0)),
        jt.shapes.sphere(0.6),
        jt.shapes.rectangle(8.0, 0.5),
    ],
    ids=["ring", "tube", "bar", "flat bar", "box", "ball", "strip"],
)
def test_nothing_is_said_of_what_conducts_as_it_should(mesh):
    for seed in range(2):
        assert poor_conduction(sheet_of(mesh, seed).grid) is None
