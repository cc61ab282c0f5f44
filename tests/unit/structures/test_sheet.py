"""Sheets: nodes, links, faces, and layers by part."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt


STEEL = jt.Material(45.0, 7850.0, specific_heat=480.0, emissivity=0.3)
FOAM = jt.Material(0.03, 40.0, specific_heat=1400.0, emissivity=0.9)
UP = (0.0, 0.0, 1.0)


def rectangle(x=1.0, y=0.5, at=0.0):
    corners = np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]]) + [at, 0.0, 0.0]
    return jt.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def steel_sheet(thickness=1e-3, **options):
    return jt.Sheet(rectangle(), (jt.Layer(STEEL, thickness),), 0.1, **options)


def test_a_thin_sheet_has_one_node_through_it_and_two_faces():
    sheet = steel_sheet()
    grid = sheet.grid
    assert sheet.cells_through == 1
    assert grid.fragment_area.sum() == pytest.approx(2 * 0.5, rel=1e-12)
    half = len(grid.fragment_area) // 2
    assert_allclose(grid.fragment_normal[:half], -grid.fragment_normal[half:])
    assert (grid.fragment_normal[:half, 2] > 0).all()
    assert sheet.volume == pytest.approx(0.5e-3, rel=1e-12)
    assert sheet.mass == pytest.approx(0.5e-3 * 7850.0, rel=1e-12)


def test_thick_layers_have_cells_and_thin_ones_share_them():
    wall = (jt.Layer(STEEL, 0.5e-3), jt.Layer(FOAM, 0.05), jt.Layer(STEEL, 0.5e-3))
    sheet = jt.Sheet(rectangle(), wall, 0.1)
    assert sheet.cells_through > 3
    values = sheet.cell_values(np.float64)
    # Whatever the cells: the same wall.
    heat = sum(float(layer.capacity) for layer in wall)
    assert values.capacity.sum() == pytest.approx(heat, rel=1e-12)
    along = sum(float(layer.conductivity * layer.thickness) for layer in wall)
    assert values.conductance.sum() == pytest.approx(along, rel=1e-12)
    resistance = sum(float(layer.resistance) for layer in wall)
    through = values.to_front.sum() + values.to_back.sum()
    assert through == pytest.approx(resistance, rel=1e-12)


def test_parts_have_their_own_layers():
    parts = {"left": rectangle(0.5), "right": rectangle(0.5, at=0.5)}
    layers = {"left": (jt.Layer(STEEL, 1e-3),), "*": (jt.Layer(FOAM, 0.02),)}
    sheet = jt.Sheet(parts, layers, 0.1, cells=1)
    mass = 0.25 * (1e-3 * 7850.0 + 0.02 * 40.0)
    assert sheet.mass == pytest.approx(mass, rel=1e-9)
    right = sheet.grid.fragment_position[:, 0] > 0.5
    emissivity = np.asarray(sheet.face_values("emissivity", np.float64))
    assert_allclose(emissivity, np.where(right, 0.9, 0.3))


def test_a_sheet_follows_the_lumped_law():
    body = jt.Body(steel_sheet(), temperature=300.0)
    terms = (jt.Convection(10.0, 290.0), jt.HeatFlux(500.0, on=jt.Side(UP)))
    scene = jt.Scene((body,), terms, dtype="float64")
    times = (0.0, 60.0, 240.0)
    solution = jt.simulate(scene, 240.0, save_at=times)
    capacity = 1e-3 * 7850.0 * 480.0
    final = 290.0 + 500.0 / 20.0
    exact = final + (300.0 - final) * np.exp(-20.0 * np.array(times) / capacity)
    assert_allclose(solution.mean_temperature[:, 0], exact, atol=0.02)
    assert np.abs(solution.energy.residual_relative).max() < 1e-11


def test_its_conductance_along_the_surface_follows_the_thickness():
    def heat_rate(thickness):
        sheet = jt.Sheet(rectangle(), (jt.Layer(STEEL, thickness),), 0.1, cells=1)
        body = jt.Body(sheet, temperature=lambda x: 300.0 + 10.0 * x[:, 0])
        scene = jt.Scene((body,), dtype="float64")
        network = jt.compile_scene(scene).programs[0].bodies[0].network
        x = sheet.nodes().location[:, 0]
        rate = network.heat_rate(jax.numpy.asarray(10.0 * x))
        # Through the middle, k d w times the gradient.
        return np.abs(np.asarray(rate)[x < 0.5].sum())

    assert heat_rate(2e-3) == pytest.approx(2 * heat_rate(1e-3), rel=1e-9)
    assert heat_rate(1e-3) == pytest.approx(45.0 * 1e-3 * 0.5 * 10.0, rel=1e-6)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: jt.Layer(STEEL, 0.0), "thickness"),
        (lambda: jt.Layer(STEEL, -1e-3), "thickness"),
        (lambda: jt.Layer(STEEL, float("nan")), "thickness"),
        (lambda: jt.Layer(None, 1e-3), "material"),
        (lambda: jt.Layer("unobtainium", 1e-3), "unobtainium"),
        (lambda: jt.Sheet(rectangle(), (), 0.1), "none"),
        (lambda: steel_sheet(cells=0), "cells"),
        (lambda: steel_sheet(cells=65), "64"),
        (lambda: jt.Body(steel_sheet(), STEEL, temperature=300.0), "leave it out"),
        (lambda: steel_sheet().voxels, "solid body"),
    ],
)
def test_mistakes_have_one_line(make, words):
    with pytest.raises(jt.InputError, match=words):
        make()
