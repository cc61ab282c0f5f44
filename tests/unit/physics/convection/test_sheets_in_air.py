"""Convection of sheets: every panel is a plate."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.sheets.panels import panels


STEEL = jt.Layer(jt.Material(45.0, 7850.0, specific_heat=480.0), 1e-3)
UP = np.array([0.0, 0.0, 1.0])


def rectangle(x=0.3, y=0.2):
    corners = np.array([[0, 0, 0], [x, 0, 0], [x, y, 0], [0, y, 0]], float)
    return jt.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def coefficients(structure, material, term):
    """Heat transfer coefficient at the start of each fragment [W/(m^2 K)]."""
    body = jt.Body(structure, material, temperature=320.0)
    outputs = ("heat_transfer_coefficient",)
    scene = jt.Scene((body,), (term,), dtype="float64", surface_outputs=outputs)
    solution = jt.simulate(scene, 1e-3)
    return np.asarray(solution.heat_transfer_coefficient)[0]


@pytest.mark.parametrize(
    "term",
    [
        jt.FreeConvection(290.0),
        jt.Wind((3.0, 1.0, 0.0), 290.0),
        jt.Wind((1.0, 0.0, 3.0), 290.0),
    ],
)
def test_a_flat_sheet_has_the_laws_of_a_thin_plate(term):
    sheet = jt.Sheet(rectangle(), (STEEL,), 0.05)
    solid = jt.voxelize(jt.shapes.box((0.3, 0.2, 0.005)), 0.005)
    plate = jt.FullVolume(solid)
    of_sheet = coefficients(sheet, None, term)
    of_plate = coefficients(plate, STEEL.material, term)
    for side in (UP, -UP):
        on_sheet = of_sheet[sheet.grid.fragment_normal @ side > 0.99]
        on_plate = of_plate[solid.fragment_normal @ side > 0.99]
        assert_allclose(on_sheet, on_plate.mean(), rtol=2e-3)


def test_a_box_of_sheet_has_six_panels():
    sheet = jt.Sheet(jt.shapes.box((0.4, 0.3, 0.2)), (STEEL,), 0.05)
    plates = panels(sheet.grid)
    assert len(plates.plates) == 6
    areas = sorted(plate.area for plate in plates.plates)
    assert_allclose(areas, [0.06, 0.06, 0.08, 0.08, 0.12, 0.12], rtol=1e-9)
    # Every fragment is on the panel that faces its way.
    normals = np.array([plate.normal for plate in plates.plates])
    cosine = (normals[plates.member] * sheet.grid.fragment_normal).sum(axis=1)
    assert_allclose(np.abs(cosine), 1, atol=1e-9)


def test_a_curved_sheet_without_a_crease_is_one_panel():
    sheet = jt.Sheet(jt.shapes.sphere(0.1), (STEEL,), 0.05)
    assert len(panels(sheet.grid).plates) == 1


def test_a_sheet_needs_its_cylinders():
    sheet = jt.Sheet(rectangle(), (STEEL,), 0.1)
    term = jt.FreeConvection(290.0, body_shape="cylinder")
    scene = jt.Scene((jt.Body(sheet, temperature=300.0),), (term,))
    with pytest.raises(jt.InputError, match="give its cylinders"):
        jt.compile_scene(scene)
