"""An area source: thesis eq. 2 in full, A14, and its limit in eq. 3."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import jaxthermo as jt
from jaxthermo.constants import STEFAN_BOLTZMANN
from jaxthermo.geometry.shapes import box
from jaxthermo.physics.radiation.area_source import AreaSource
from jaxthermo.physics.radiation.source import PointSource
from jaxthermo.physics.surface import Binding
from jaxthermo.physics.time_varying import dose
from jaxthermo.voxels.voxelize import voxelize
from tests.radiating import heat_into, shell, surface_of, whole


NOTHING = np.zeros((0, 3, 3))
UP = np.array([[0.0, 0.0, 1.0]])


def test_a14_plate_over_an_element():
    """2 x 2 m at 1000 degC, black, 1 m above: 82.554 kW/m^2, and a strip's 105.345."""
    plate = AreaSource((0, 0, 1.0), (0, 0, -1.0), (2.0, 2.0), temperature=1273.15)
    strip = AreaSource((0, 0, 1.0), (0, 0, -1.0), (2.0, 4e3), temperature=1273.15)
    irradiances = [
        float(s.strength * s.exposure(NOTHING, np.zeros((1, 3)), UP, 0.01)[0])
        for s in (plate, strip)
    ]
    assert irradiances == pytest.approx([82554.147, 105345.269], rel=1e-6)


def test_far_away_it_is_a_point():
    """Second order in size over distance: eq. 3 with the missing 1 / R^2."""
    random = np.random.default_rng(0)
    way = random.normal(size=(20, 3))
    way[:, 2] = -np.abs(way[:, 2]) - 0.2
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    panel = AreaSource((0, 0, 0.0), (0, 0, -1.0), (0.4, 0.2), radiance=1.0, patches=2)
    errors = []
    for distance in (4.0, 8.0, 16.0):
        points = way * distance
        exposure = panel.exposure(NOTHING, points, -way, 0.5)
        lamp = PointSource((0.0, 0.0, 0.0), 1.0).exposure(NOTHING, points, -way, 0.5)
        expected = 0.4 * 0.2 * -way[:, 2] * lamp
        errors.append(np.abs(exposure / expected - 1).max())
    assert errors[0] < 5e-3
    ratio = np.array(errors[:-1]) / errors[1:]
    assert_allclose(ratio, 4.0, rtol=0.02)


def test_a_panel_in_a_hollow_ball_loses_nothing():
    """pi L A in all, from its front alone."""
    hollow = voxelize(shell(0.2, 0.24), 0.02)
    panel = AreaSource((0.02, 0.0, 0.05), (1.0, 0.5, 0.2), (0.1, 0.06), radiance=1.0)
    exposure = panel.exposure(
        hollow.mesh.triangles, hollow.fragment_position, hollow.fragment_normal, 0.02
    )
    caught = (exposure * hollow.fragment_area).sum()
    assert caught == pytest.approx(np.pi * 0.1 * 0.06, rel=0.01)
    front = (hollow.fragment_position - [0.02, 0.0, 0.05]) @ [1.0, 0.5, 0.2] > 0
    assert exposure[~front].max() == 0.0


def test_penumbra_of_an_edge():
    """Below half a ceiling: the panel is seen a sixth of its width at a time."""
    panel = AreaSource((0, 0, 1.0), (0, 0, -1.0), (0.5, 0.5), radiance=1.0, patches=6)
    x = np.linspace(-0.7, 0.7, 29)
    points = np.stack([x, 0 * x, 0 * x], axis=1)
    normal = np.repeat(UP, len(x), axis=0)
    blind = box((2.0, 2.0, 1e-3)).triangles + np.array([-1.0, 0.0, 0.5])
    free = panel.exposure(NOTHING, points, normal, 0.01)
    lit = panel.exposure(blind, points, normal, 0.01)
    assert (lit[x < -0.27] == 0).all()
    assert_allclose(lit[x > 0.27], free[x > 0.27], rtol=1e-12)
    # The blind's edge at x = 0 halfway down hides of the panel what is left of -x.
    inside = np.abs(x) < 0.24
    edge = -x[inside]
    seen = [
        AreaSource(
            ((e + 0.25) / 2, 0, 1.0),
            (0, 0, -1.0),
            (0.25 - e, 0.5),
            radiance=1.0,
            patches=1,
        ).exposure(NOTHING, points[inside][[i]], UP, 0.01)[0]
        for i, e in enumerate(edge.tolist())
    ]
    assert_allclose(lit[inside], seen, atol=0.1 * free.max())


def test_no_surface_receives_more_than_the_source_radiates():
    panel = AreaSource((0, 0, 0.0), (0, 0, -1.0), (1.0, 1.0), radiance=2.0)
    depth = -np.array([1e-12, 1e-6, 1e-3])
    points = np.stack([0.1 + 0 * depth, 0.2 + 0 * depth, depth], axis=1)
    exposure = panel.exposure(NOTHING, points, np.repeat(UP, 3, axis=0), 0.01)
    assert (exposure <= np.pi * (1 + 1e-12)).all()
    assert_allclose(exposure, np.pi, rtol=2e-3)


def test_a_grey_panel_radiates_by_its_temperature():
    panel = AreaSource(
        (0, 0, 0.15), (0, 0, -1.0), (0.1, 0.1),
        temperature=jt.Table([0.0, 10.0], [300.0, 900.0]), emissivity=0.7,
    )  # fmt: skip
    black = 0.7 * STEFAN_BOLTZMANN / np.pi
    for time, kelvin in ((0.0, 300.0), (5.0, 600.0), (10.0, 900.0)):
        radiance = float(panel.strength(jnp.asarray(time)))
        assert radiance == pytest.approx(black * kelvin**4, rel=1e-12)
    strongest = dose(panel.strength, 10.0).largest
    assert float(strongest) == pytest.approx(black * 900.0**4, rel=1e-6)


def test_what_is_absorbed():
    """Radiance times exposure times area, on the side that faces the panel alone."""
    grid = voxelize(box((0.2, 0.2, 0.1)), 0.02)
    panel = AreaSource(
        (0, 0, 0.15), (0, 0, -1.0), (0.1, 0.1), radiance=100.0, patches=2
    )
    (binding,) = panel.bind(whole(surface_of(grid)))
    assert isinstance(binding, Binding)
    heat = heat_into(binding).sum()
    top = grid.fragment_position[:, 2] > 0.049
    free = panel.exposure(
        NOTHING, grid.fragment_position[top], grid.fragment_normal[top], 0.02
    )
    assert heat == pytest.approx(100.0 * free @ grid.fragment_area[top], rel=1e-12)
    assert (np.asarray(binding.effective_area)[~top] == 0).all()


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -3.0), (1.0, 1.0, 0.1)])
def test_patches_make_up_the_rectangle_whatever_its_normal(normal):
    panel = AreaSource((1.0, 2.0, 3.0), normal, (0.3, 0.5), radiance=1.0, patches=3)
    patches = panel.patch_corners()
    assert patches.shape == (9, 4, 3)
    assert_allclose(patches.mean((0, 1)), [1.0, 2.0, 3.0], atol=1e-12)
    area = np.cross(patches[:, 1] - patches[:, 0], patches[:, 3] - patches[:, 0])
    unit = np.array(normal) / np.linalg.norm(normal)
    assert_allclose(area.sum(0), 0.15 * unit, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"normal": (0.0, 0.0, 0.0)}, "normal"),
        ({"size": (1.0, -1.0)}, "size"),
        ({"size": (1.0, 2.0, 3.0)}, "size"),
        ({"radiance": -1.0}, "radiance"),
        ({"radiance": None}, "either"),
        ({"temperature": 300.0}, "either"),
        ({"radiance": None, "temperature": -1.0}, "temperature"),
        ({"radiance": None, "temperature": 300.0, "emissivity": 1.2}, "emissivity"),
        ({"patches": 0}, "patches"),
        ({"centre": (0.0, np.inf, 0.0)}, "centre"),
    ],
)
def test_bad_input_is_told_in_a_line(changes, says):
    fields = {
        "centre": (0.0, 0.0, 1.0),
        "normal": (0.0, 0.0, -1.0),
        "size": (1.0, 1.0),
        "radiance": 1.0,
    }
    with pytest.raises(jt.InputError, match=says) as told:
        AreaSource(**(fields | changes))
    assert "\n" not in str(told.value)


def test_partly_inside_a_body_is_refused():
    grid = voxelize(box((0.2, 0.2, 0.1)), 0.02)
    panel = AreaSource((0.1, 0.0, 0.0), (0, 0, 1.0), (0.1, 0.1), radiance=1.0)
    with pytest.raises(jt.InputError, match="inside body 0"):
        panel.bind(whole(surface_of(grid)))
