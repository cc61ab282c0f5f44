"""Conduction along sheets of any triangles against closed forms, by a direct solve."""

import time
from typing import Literal

import numpy as np
import pytest
from scipy.sparse import diags_array
from scipy.sparse.linalg import spsolve

from jaxthermo.geometry import shapes
from jaxthermo.geometry.mesh import Mesh
from jaxthermo.geometry.vectors import triangle_normals, unit_vectors
from jaxthermo.reference.sheets import sunlit_sphere
from jaxthermo.sheets.cells import sheet_cells
from tests.sheets import (
    conduction,
    grid_plate,
    meshes_together,
    open_cylinder,
    orders,
    polygon_soup,
    rotation,
    steady,
    turned,
    uneven_strip,
)


def ends_held(cells, x, length):
    """Conductance over conductivity times thickness from x = 0 to x = length."""
    start = np.flatnonzero(x < 1e-9)
    end = np.flatnonzero(x > length - 1e-9)
    matrix = conduction(cells)
    temperature = steady(
        matrix,
        np.zeros(len(x)),
        held=np.concatenate([start, end]),
        values=np.concatenate([np.ones(len(start)), np.zeros(len(end))]),
    )
    return (matrix @ temperature)[start].sum()


@pytest.mark.parametrize("width", [0.01, 0.04, 0.06])
def test_a_strip_narrower_than_a_cell_conducts(width):
    plate = grid_plate(np.array([0, 1.0]), np.array([0, width]))
    for matrix in (np.eye(3), *(rotation(seed) for seed in range(5))):
        cells = sheet_cells(turned(plate, matrix), pitch=0.05)
        x = (cells.position @ matrix)[:, 0]
        assert ends_held(cells, x, 1.0) == pytest.approx(width, rel=0.01)
        assert cells.area.sum() == pytest.approx(width, rel=1e-9)


@pytest.mark.parametrize(("width", "seed"), [(0.5, 17), (1.7, 8)])
def test_a_strip_conducts_where_one_node_is_its_end(width, seed):
    """The node at one end has both corners, and three neighbours."""
    matrix = rotation(seed)
    plate = grid_plate(np.array([0, 12.0]), np.array([0, width]))
    cells = sheet_cells(turned(plate, matrix), pitch=1.0)
    x = (cells.position @ matrix)[:, 0]
    assert ends_held(cells, x, 12.0) == pytest.approx(width / 12.0, rel=1e-3)


def three_strips(angles):
    strips = []
    for angle in angles:
        strip = grid_plate(np.array([0, 0.31]), np.linspace(0, 0.2, 4))
        direction = [np.cos(angle), 0, np.sin(angle)]
        frame = np.array([direction, [0, 1, 0], [0, 0, 0]])
        strips.append(Mesh(strip.vertices @ frame, strip.faces))
    return meshes_together(*strips)


@pytest.mark.parametrize("nodes", ["cells", "vertices"])
@pytest.mark.parametrize("angles", [(0, 2.1, 4.2), (0.3, 1.2, 3.9)])
def test_three_strips_share_one_edge(nodes, angles):
    mesh = three_strips(angles)
    matrix = rotation(4)
    cells = sheet_cells(turned(mesh, matrix), pitch=0.03, nodes=nodes)
    position = cells.position @ matrix
    radius = np.hypot(position[:, 0], position[:, 2])
    along = np.arctan2(position[:, 2], position[:, 0])
    ends = np.flatnonzero(radius > 0.31 - 1e-9)
    warm = np.abs(np.angle(np.exp(1j * (along[ends] - angles[0])))) < 1e-6
    temperature = steady(
        conduction(cells), np.zeros(len(radius)), held=ends, values=warm.astype(float)
    )
    junction = temperature[radius < 1e-9]
    assert len(junction) >= 4
    np.testing.assert_allclose(junction, 1 / 3, atol=1e-4)


def jittered_strip(counts):
    """Rectangle of 0.3 x 0.1 m of uneven triangles, by its vertices along each side."""
    x = np.linspace(0, 0.3, counts[0])
    mesh = grid_plate(x, np.linspace(0, 0.1, counts[1]))
    inner = (mesh.vertices > 1e-9) & (mesh.vertices < [0.3 - 1e-9, 0.1 - 1e-9, 1])
    inner = inner[:, :2].all(axis=1)
    shifts = np.random.default_rng(0).uniform(-0.2, 0.2, (inner.sum(), 2))
    mesh.vertices[inner, :2] += shifts * x[1]
    return mesh


def fin_errors(
    mesh, pitch=0.02, *, nodes: Literal["cells", "vertices"] = "cells", seed=1
):
    """Number of nodes, rms of the temperature, error of the heat through the base."""
    length, width, exchange, sheet = 0.3, 0.1, 2 * 20.0, 50.0 * 1e-3
    matrix = rotation(seed)
    cells = sheet_cells(turned(mesh, matrix), pitch=pitch, nodes=nodes)
    x = (cells.position @ matrix)[:, 0]
    rate = np.sqrt(exchange / sheet)
    area = cells.area[:, 0]
    held = np.flatnonzero(x < 1e-9)
    temperature = steady(
        conduction(cells) * sheet + diags_array(exchange * area),
        np.zeros(len(x)),
        held=held,
        values=np.ones(len(held)),
    )
    exact = np.cosh(rate * (length - x)) / np.cosh(rate * length)
    rms = np.sqrt((area * (temperature - exact) ** 2).sum() / area.sum())
    heat = (exchange * area * temperature).sum()
    exact_heat = sheet * width * rate * np.tanh(rate * length)
    return len(x), rms, heat / exact_heat - 1


def test_a_fin_of_cells():
    mesh = uneven_strip(0.3, 0.1)
    for pitch, nodes, max_rms, max_heat in (
        (0.02, 135, 0.012, 0.15),
        (0.01, 485, 0.0032, 0.032),
        (0.005, 1822, 0.0006, 0.006),
    ):
        count, rms, heat = fin_errors(mesh, pitch)
        assert count <= nodes
        assert rms <= max_rms
        assert abs(heat) <= max_heat


@pytest.mark.slow
def test_a_fin_of_cells_converges_at_second_order():
    # Cells of different turns differ by chance: the order is that of all of them.
    mesh = uneven_strip(0.3, 0.1)
    pitches = np.array([0.02, 0.01, 0.005, 0.0025])
    rms = [
        np.linalg.norm([fin_errors(mesh, pitch, seed=seed)[1] for seed in range(8)])
        for pitch in pitches
    ]
    order, _ = np.polyfit(np.log(pitches), np.log(rms), 1)
    assert order >= 1.8
    assert np.log2(rms[-2] / rms[-1]) >= 1.8


def test_a_fin_of_its_own_vertices():
    errors = []
    for counts, nodes, max_rms, max_heat in (
        ((33, 9), 297, 0.0008, 0.01),
        ((60, 18), 1096, 0.0003, 0.003),
        ((119, 36), 4299, 0.0001, 0.001),
    ):
        count, rms, heat = fin_errors(jittered_strip(counts), nodes="vertices")
        assert count <= nodes
        assert rms <= max_rms
        assert abs(heat) <= max_heat
        errors.append(rms)
    assert np.log(errors[1] / errors[2]) / np.log(118 / 59) >= 1.8


def cylinder_error(sides, pitch):
    """Number of nodes, and rms error in the sun from one side [K]."""
    radius, sheet, flux, exchange = 0.05, 16 * 0.5e-3, 800.0, 15.0
    matrix = rotation(1)
    mesh = turned(open_cylinder(radius, 0.15, sides), matrix)
    cells = sheet_cells(mesh, pitch=pitch)
    fragments = cells.fragments
    facing = np.maximum((fragments.normal @ matrix)[:, 0], 0)
    heat = np.bincount(fragments.node, flux * facing * fragments.area, cells.node_count)
    area = cells.area[:, 0]
    balance = conduction(cells) * sheet + diags_array(exchange * area)
    temperature = spsolve(balance.tocsc(), heat)
    position = cells.position @ matrix
    angle = np.arctan2(position[:, 1], position[:, 0])
    round_conductance = sheet / radius**2
    exact = flux / np.pi / exchange
    exact = exact + flux / 2 * np.cos(angle) / (exchange + round_conductance)
    for order in range(2, 100, 2):
        amplitude = 2 * flux / np.pi * (-1) ** (order // 2 + 1) / (order**2 - 1)
        response = exchange + round_conductance * order**2
        exact = exact + amplitude * np.cos(order * angle) / response
    error = (temperature - exact) ** 2
    return cells.node_count, np.sqrt((area * error).sum() / area.sum())


def test_a_cylinder_in_the_sun():
    sizes = [(24, 0.012), (48, 0.006), (96, 0.003)]
    errors = [cylinder_error(*size) for size in sizes]
    for (count, rms), (nodes, max_rms) in zip(
        errors, [(392, 0.24), (1764, 0.087), (6704, 0.020)], strict=True
    ):
        assert count <= nodes
        assert rms <= max_rms
    assert orders([rms for _, rms in errors])[-1] >= 1.8


def sphere_error(subdivisions, pitch, seed):
    """Rms error of a shell in the sun from one side, over its range [-].

    Each triangle has the sun of its own normal: fragments merge similar ones, which
    limits the error to a few parts in ten thousand where they span several triangles.
    """
    law = {
        "radius": 0.05,
        "sheet_conductance": 16 * 0.5e-3,
        "heat_transfer_coefficient": 15.0,
        "heat_flux": 800.0,
    }
    matrix = rotation(seed)
    cells = sheet_cells(turned(shapes.sphere(0.05, subdivisions), matrix), pitch=pitch)
    normal = unit_vectors(triangle_normals(cells.vertices[cells.faces]) @ matrix)
    heat = 800.0 * np.maximum(normal[:, 0], 0) * cells.face_area / 3
    node = cells.vertex_node[cells.faces].ravel()
    load = np.bincount(node, np.repeat(heat, 3), cells.node_count)
    area = cells.area[:, 0]
    balance = conduction(cells) * law["sheet_conductance"] + diags_array(15.0 * area)
    temperature = spsolve(balance.tocsc(), load)
    direction = unit_vectors(cells.position @ matrix)
    exact = sunlit_sphere(np.arccos(np.clip(direction[:, 0], -1, 1)), **law)
    error = (temperature - exact) ** 2
    return np.sqrt((area * error).sum() / area.sum()) / np.ptp(exact)


@pytest.mark.slow
def test_a_sphere_in_the_sun_converges_at_second_order():
    for seed in range(3):
        errors = [
            sphere_error(subdivisions, pitch, seed)
            for subdivisions, pitch in ((3, 0.0075), (4, 0.00375), (5, 0.001875))
        ]
        assert errors[0] < 1e-3
        assert min(orders(errors)) >= 1.8


@pytest.mark.parametrize("aspect", [1, 50])
def test_a_linear_field_is_exact_on_skewed_triangles(aspect):
    rng = np.random.default_rng(0)
    mesh = grid_plate(np.arange(7.0), np.arange(7.0))
    inner = ((mesh.vertices[:, :2] % 6) > 0).all(1)
    mesh.vertices[inner, :2] += rng.uniform(-0.25, 0.25, (inner.sum(), 2))
    shear = np.array([[1, 0, 0], [0.4, 1 / aspect, 0], [0, 0, 1]])
    mesh = turned(Mesh(mesh.vertices @ shear, mesh.faces), rotation(2))
    cells = sheet_cells(mesh, pitch=1.0, nodes="vertices")
    assert (cells.links.weight > 0).all()
    # Vertices on the border: those of edges with one face.
    sides = np.sort(np.stack([cells.faces, np.roll(cells.faces, 1, axis=1)], -1), -1)
    edges, uses = np.unique(sides.reshape(-1, 2), axis=0, return_counts=True)
    border = np.unique(edges[uses == 1])
    field = cells.position @ np.array([0.3, -0.7, 0.2])
    temperature = steady(
        conduction(cells), np.zeros(len(field)), held=border, values=field[border]
    )
    np.testing.assert_allclose(temperature, field, atol=1e-9)


@pytest.mark.slow
def test_no_conductance_of_a_soup_is_negative():
    mesh = polygon_soup()
    start = time.perf_counter()
    cells = sheet_cells(mesh, pitch=0.05)
    seconds = time.perf_counter() - start
    print(len(mesh.faces), mesh.area, cells.node_count, seconds)
    assert (cells.links.weight > 0).all()
    assert cells.node_count <= 40_000
    degree = np.bincount(cells.links.src, cells.links.weight, cells.node_count)
    degree += np.bincount(cells.links.dst, cells.links.weight, cells.node_count)
    # Smallest stable step of 0.8 mm of steel.
    diffusivity = 50 / (7800 * 470)
    step = cells.area[:, 0] / np.maximum(degree, 1e-300) / diffusivity
    assert step.min() > 0.1
