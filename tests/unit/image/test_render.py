"""Thermal images: radiance, smoothing, what hides what, and gradients to the pixels."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image as Pictures

import jaxthermo as jt
from jaxthermo.geometry.mesh import winding_number
from jaxthermo.image.colour import picture as pictures
from jaxthermo.image.colour.palette import BACKGROUND, apply_palette
from jaxthermo.image.files.exr import read_exr
from jaxthermo.image.radiance.band import apparent_temperature, black_radiance
from jaxthermo.image.radiance.draw import Moment, draw
from jaxthermo.image.radiance.effect import PixelRadiation
from jaxthermo.image.radiance.image import coarsen
from jaxthermo.image.surface.shapes import ShapePoints, Shapes
from jaxthermo.image.surface.view import compute_view
from jaxthermo.image.surface.weights import nearest_weights, smooth_weights
from jaxthermo.scene.scene import SolvedSurface, body_geometry
from tests.imaging import apparent


SIGMA = 5.670374419e-8
METAL = jt.Material(
    conductivity=50.0, density=2000.0, specific_heat=500.0, emissivity=0.8
)
SIDE = jt.OrthographicCamera(
    (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), view_height=0.12, width=60, height=60
)


def cube(pitch=0.01, size=0.1, temperature: Any = 300.0, **kwargs):
    grid = jt.voxelize(jt.shapes.box((size, size, size)), pitch)
    return jt.Body(jt.FullVolume(grid), METAL, temperature=temperature, **kwargs)


@pytest.fixture(scope="module")
def still():
    """A cube that nothing acts on, seen from +x."""
    scene = jt.Scene((cube(),), (jt.Surroundings(250.0),), dtype="float64")
    return jt.simulate(scene, 0.0)


def test_apparent_temperature_of_a_grey_surface():
    """A17 of the field survey: eps 0.91 at 300 K before 250 K looks like 296.4424 K."""
    radiation = PixelRadiation(
        black=black_radiance(jnp.asarray([300.0]), None),
        emissivity=jnp.asarray([0.91]),
        absorptivity=jnp.asarray([1.0]),
        thermal=SIGMA * jnp.asarray([250.0]) ** 4,
        sources=jnp.zeros((0, 1)),
    )
    seen = float(apparent_temperature(radiation.radiance)[0])
    assert seen == pytest.approx(296.4424, abs=1e-4)


def test_a_black_surface_looks_as_warm_as_it_is():
    temperature = jnp.linspace(200.0, 900.0, 7)
    radiance = black_radiance(temperature, None)
    np.testing.assert_allclose(apparent_temperature(radiance), temperature, rtol=1e-12)


def test_channels_of_a_frame(still):
    image = jt.render(still, SIDE, band=None)
    body = np.asarray(image.object_id) == 0
    # 0.1 m of 0.12 m over 60 pixels, both ways.
    assert body.sum() == 50 * 50
    np.testing.assert_allclose(np.asarray(image.temperature)[body], 300.0)
    np.testing.assert_allclose(np.asarray(image.depth)[body], 0.95)
    np.testing.assert_allclose(np.asarray(image.normal)[body], [[1.0, 0.0, 0.0]] * 2500)
    grey = (0.8 * 300.0**4 + 0.2 * 250.0**4) ** 0.25
    np.testing.assert_allclose(apparent(image)[body], grey)
    assert np.isinf(np.asarray(image.depth)[~body]).all()
    assert (np.asarray(image.emissivity)[~body] == 1).all()
    np.testing.assert_allclose(apparent(image)[~body], 250.0)


def test_the_nearer_body_hides_the_farther_one():
    near = cube(pose=jt.Pose(translation=(0.3, 0.05, 0.0)), temperature=350.0)
    scene = jt.Scene((cube(), near), (jt.Surroundings(250.0),), dtype="float64")
    image = jt.render(jt.simulate(scene, 0.0), SIDE)
    number = np.asarray(image.object_id)
    # Looking along -x, +y is to the right: the near cube covers the right half.
    assert (number[30, 6:30] == 0).all() and (number[30, 31:55] == 1).all()
    np.testing.assert_allclose(np.asarray(image.temperature)[number == 1], 350.0)


def test_reflected_sun_follows_the_cosine_and_the_shadow():
    scene = jt.Scene(
        (cube(), cube(pose=jt.Pose(translation=(0.3, 0.1, 0.0)))),
        (jt.Sun((-1.0, 0.0, 0.0), 1000.0), jt.Surroundings(250.0)),
        dtype="float64",
    )
    solution = jt.simulate(scene, 0.0, save_at=[0.0])
    # Only the edge of the second cube reaches the line of sight and the rays.
    image = jt.render(solution, SIDE, band=None)
    grey = 0.8 * 300.0**4 + 0.2 * 250.0**4 + 0.2 * 1000.0 / 5.670374419e-8
    seen = apparent(image)[30, 10]
    assert seen == pytest.approx(grey**0.25, rel=1e-9)


def test_a_body_in_the_shadow_reflects_no_sun():
    shade = cube(size=0.12, pose=jt.Pose(translation=(0.0, 0.0, 0.3)))
    scene = jt.Scene((cube(), shade), (jt.Sun((0.0, 0.0, -1.0), 1000.0),))
    solution = jt.simulate(scene, 0.0, save_at=[0.0])
    above = jt.OrthographicCamera(
        (0.0, 0.0, 0.2), (0.0, 0.0, 0.0), 0.12, up=(0.0, 1.0, 0.0), width=60, height=60
    )
    image = jt.render(solution, above, band=None)
    seen = np.asarray(image.object_id) == 0
    kelvin = apparent(image)[seen]
    np.testing.assert_allclose(kelvin, 300.0, atol=1e-3)


def _plate_points(n=40):
    """Points on the upper face of a 0.1 x 0.1 x 0.004 m plate."""
    spots = np.linspace(-0.04, 0.04, n)
    points = np.array([[x, 0.3 * x, 0.002] for x in spots])
    return points, np.tile([0.0, 0.0, 1.0], (n, 1))


@pytest.fixture(scope="module")
def plate():
    grid = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.004)), 0.002)
    return body_geometry(grid, jt.Pose())


def test_smoothing_keeps_constants_and_linear_fields(plate):
    points, normals = _plate_points()
    weights = smooth_weights(ShapePoints.of_one(points, normals), Shapes.of((plate,)))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    field = 300 + 50 * plate.fragment_position[:, 0]
    read = weights @ field
    exact = 300 + 50 * points[:, 0]
    # Within a few hundredths of what changes over one voxel.
    assert np.abs(read - exact).max() < 0.03 * 50 * plate.pitch


def test_smoothing_does_not_leak_through_a_sheet(plate):
    points, normals = _plate_points()
    field = np.where(plate.fragment_normal[:, 2] > 0.5, 310.0, 290.0)
    weights = smooth_weights(ShapePoints.of_one(points, normals), Shapes.of((plate,)))
    read = weights @ field
    np.testing.assert_allclose(read, 310.0)


def test_blocks_show_the_nearest_fragment(plate):
    points, normals = _plate_points()
    weights = nearest_weights(ShapePoints.of_one(points, normals), Shapes.of((plate,)))
    away = np.linalg.norm(points[:, None] - plate.fragment_position[None], axis=2)
    np.testing.assert_allclose(
        away[np.arange(len(points)), weights.indices], away.min(axis=1)
    )


def test_parts_without_fragments_show_their_neighbours(plate):
    far = np.array([[0.0, 0.0, 0.02]])
    downward = ShapePoints.of_one(far, np.array([[0.0, 0.0, -1.0]]))
    weights = smooth_weights(downward, Shapes.of((plate,)))
    assert weights.data.tolist() == [1.0]


def test_a_camera_inside_a_body_is_refused(still):
    inside = jt.Camera((0.01, 0.0, 0.02), (1.0, 0.0, 0.0))
    with pytest.raises(jt.InputError, match="inside body 0"):
        jt.render(still, inside)


def test_a_camera_that_looks_away_is_refused(still):
    with pytest.raises(jt.InputError, match="sees no body"):
        jt.render(still, jt.Camera((1.0, 0.0, 0.0), (2.0, 0.0, 0.0)))


def test_winding_number_of_a_cube():
    triangles = jt.shapes.box((1.0, 1.0, 1.0)).triangles
    assert winding_number(triangles, np.array([0.3, -0.2, 0.4])) == pytest.approx(1.0)
    assert winding_number(triangles, np.array([0.7, 0.0, 0.0])) == pytest.approx(0.0)


def test_coarsening_averages_radiance_and_samples_the_rest(still):
    fine = jt.render(still, SIDE.finer(4))
    coarse = jt.render(still, SIDE, samples=4)
    blocks = np.asarray(fine.radiance).reshape(60, 4, 60, 4)
    np.testing.assert_allclose(coarse.radiance, blocks.mean((1, 3)))
    np.testing.assert_array_equal(
        coarse.object_id, np.asarray(fine.object_id)[2::4, 2::4]
    )
    assert coarsen(fine, 1) is fine


def test_pixels_have_a_gradient_with_respect_to_conductivity():
    """From k through the solver and the camera, against a central difference."""
    grid = jt.voxelize(jt.shapes.box((0.1, 0.1, 0.1)), 0.02)

    terms = (jt.Sun((-1.0, 0.0, 0.0), 2e4), jt.Surroundings(280.0))
    grey = jnp.asarray(0.8)
    surfaces = (SolvedSurface(body_geometry(grid, jt.Pose()), grey, grey),)
    view = compute_view(surfaces, terms, SIDE)

    @jax.jit
    @jax.value_and_grad
    def pixel(k):
        material = jt.Material(
            conductivity=k, density=2000.0, specific_heat=500.0, emissivity=0.8
        )
        body = jt.Body(jt.FullVolume(grid), material, temperature=300.0)
        scene = jt.Scene((body,), terms, dtype="float64")
        solution = jt.simulate(scene, 20.0, solver=jt.ForwardEuler(dt=1.0))
        surface = solution.surface_temperature[-1]
        time = solution.times[-1]
        image = draw(
            view,
            Moment(
                surfaces=solution.surfaces,
                terms=solution.terms,
                temperature=surface,
                received=solution.irradiance(-1),
                time=time,
            ),
        )
        return image.apparent_temperature[30, 30]

    k = 50.0
    step = 1e-2
    slope = float(pixel(k + step)[0] - pixel(k - step)[0]) / (2 * step)
    assert slope != 0
    assert float(pixel(k)[1]) == pytest.approx(slope, rel=1e-6)


def test_exr_of_a_frame_reads_back(still, tmp_path):
    image = jt.render(still, SIDE)
    jt.write_exr(tmp_path / "frame.exr", image, {"config": "name: cube"})
    channels, header = read_exr(tmp_path / "frame.exr")
    assert header["config"] == "name: cube" and header["time_s"] == "0"
    np.testing.assert_array_equal(
        channels["temperature_K"], np.asarray(image.temperature, np.float32)
    )
    assert set(channels) >= {
        "radiance",
        "emissivity",
        "depth_m",
        "object_id",
        "normal_x",
    }
    jt.write_png(tmp_path / "frame.png", image, 280.0, 310.0, palette="ember")
    assert (tmp_path / "frame.png").stat().st_size > 1000


def test_a_picture_marks_what_is_beyond_its_scale(still, monkeypatch):
    image = jt.render(still, SIDE, samples=2)
    marks = []

    def annotate(rgb, **options):
        marks.append(options["beyond"])
        return Pictures.fromarray(rgb)

    monkeypatch.setattr(pictures, "annotate", annotate)
    kelvin = float(np.median(image.apparent_temperature[25:35, 25:35]))
    for low, high in [
        (280.0, 310.0),
        (kelvin + 1, 310.0),
        (280.0, kelvin - 1),
        (kelvin, 310.0),
    ]:
        pictures.picture(image, low, high)
    # The sky of 250 K is not on the scale, and neither is what mixes with it.
    assert marks == [(False, False), (True, False), (False, True), (False, False)]


def test_the_background_of_a_picture_is_no_colour_of_the_palette(still):
    fine = jt.render(still, SIDE.finer(2))
    drawn = pictures.picture(fine, 280.0, 310.0, quantity="surface", samples=2)
    # The scale is to the right of the image, and the time below it.
    colours = np.asarray(drawn)[:60, :60]
    body = np.asarray(jt.render(still, SIDE).object_id) == 0
    inside = apply_palette(np.array([[300.0]]), low=280.0, high=310.0, name="iron")[
        0, 0
    ]
    assert (colours[body] == inside).all() and (colours[~body] == BACKGROUND).all()


def test_what_hides_the_surroundings_is_as_warm_as_the_surface():
    """A cube on a plate hides the sky, not the sun, from what the plate reflects."""
    plate = jt.voxelize(jt.shapes.box((0.3, 0.3, 0.02)), 0.01)
    lower = jt.Pose(translation=(0.0, 0.0, -0.06))
    floor = jt.Body(jt.FullVolume(plate), METAL, temperature=300.0, pose=lower)
    terms = (jt.Sun((-0.5, 0.3, -1.0), 1000.0), jt.Surroundings(250.0))
    scene = jt.Scene((cube(), floor), terms, dtype="float64")
    solution = jt.simulate(scene, 0.0)
    camera = jt.Camera((0.3, -0.6, 0.5), (0.0, 0.0, 0.0), width=48, height=36)
    plain, shaded = (
        jt.render(solution, camera, occlusion=r, band=None) for r in (None, 0.05)
    )
    view = compute_view(solution.surfaces, solution.terms, camera, occlusion=0.05)
    hidden = 1 - np.asarray(view.open_fraction)
    assert hidden.max() > 0.2 and np.median(hidden) < 0.02
    added = 0.2 * 5.670374419e-8 / np.pi * (300.0**4 - 250.0**4) * hidden
    expected = np.asarray(plain.radiance).reshape(-1).copy()
    expected[view.pixel] += added
    np.testing.assert_allclose(shaded.radiance.reshape(-1), expected, rtol=1e-9)
