"""Values as a notebook shows them: a picture and at most 20 lines; labelled results."""

import base64
import io
from dataclasses import replace

import jax
import numpy as np
import pytest
from PIL import Image as PngFile

import jaxthermo as jt


@pytest.fixture(scope="module")
def scene():
    grid = jt.grid_from_voxels(np.ones((3, 2, 2), bool), pitch=0.01)
    copper = jt.materials["copper"]
    beside = jt.Pose(translation=(0.1, 0.0, 0.0))
    bodies = (
        jt.Body(jt.FullVolume(grid), copper, temperature=350.0, name="<hot> block"),
        jt.Body(jt.FullVolume(grid), copper, temperature=300.0, pose=beside),
    )
    terms = (
        jt.Convection(10.0, 290.0),
        jt.HeatFlux(100.0, on=jt.Everything(body=1)),
    )
    probes = {"core": (0.0, 0.0, 0.0)}
    return jt.Scene(bodies, terms, probes=probes, surface_outputs=("heat_flux",))


@pytest.fixture(scope="module")
def solution(scene):
    return jt.simulate(scene, 60.0, [30.0, 60.0])


def shown(value) -> tuple[np.ndarray | None, list[str]]:
    """Pixels of the picture of a value, and its lines."""
    text = value._repr_html_()
    assert text.startswith("<div>") and text.endswith("</div>")
    text = text.removeprefix("<div>").removesuffix("</div>")
    pixels = None
    if text.startswith("<img"):
        image, text = text.split("'><br>", 1)
        data = base64.b64decode(image.split("base64,")[1])
        pixels = np.asarray(PngFile.open(io.BytesIO(data)))
    return pixels, text.split("<br>")


def assert_drawn(pixels):
    assert pixels is not None and pixels.shape[2] == 3
    # A body on a background, in several shades.
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20


def test_a_solution_and_an_image_show_what_was_seen(solution):
    pixels, lines = shown(solution)
    assert_drawn(pixels)
    assert lines[0] == "Solution: 2 saved times, the last at 60 s"
    assert lines[1].startswith("body 0 (&lt;hot&gt; block): surface at 7")
    assert [line.split(":")[0] for line in lines[3:]] == [
        "heat by convection",
        "heat by heat_flux",
        f"energy residual {abs(solution.energy.residual_relative).max():.1e}",
        f"{solution.run.steps} steps by SuperTimeStepping",
    ]
    camera = jt.Camera((0.3, -0.3, 0.1), (0.05, 0.0, 0.0), width=160, height=120)
    pixels, lines = shown(jt.render(solution, camera))
    assert_drawn(pixels)
    assert lines[0] == "Image: 160 x 120 pixels at 60 s" and len(lines) == 3


def test_meshes_grids_and_scenes_have_a_preview(scene):
    mesh = jt.shapes.sphere(0.1)
    pixels, lines = shown(mesh)
    assert_drawn(pixels)
    assert lines[0].startswith("Mesh sphere: 5,120 faces, watertight")
    pixels, lines = shown(jt.voxelize(mesh, pitch=0.02))
    assert_drawn(pixels)
    assert lines[0].startswith("VoxelGrid(")
    pixels, lines = shown(scene)
    assert_drawn(pixels)
    assert lines == [
        "Scene: 2 bodies, state in float32",
        "body 0 (&lt;hot&gt; block): FullVolume, 12 nodes",
        "body 1: FullVolume, 12 nodes",
        "terms: convection, heat_flux",
    ]


def test_a_receipt_has_lines_and_never_more_than_twenty(solution):
    pixels, lines = shown(solution.receipt)
    assert pixels is None and lines[0] == "included: conduction, convection, heat_flux"
    many = replace(solution.receipt, notes=tuple(f"remark {n}" for n in range(40)))
    _, lines = shown(many)
    assert len(lines) == 20 and lines[-1].endswith("more lines")


def test_what_cannot_be_drawn_is_a_line(solution):
    empty = jt.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert shown(empty) == (None, ["Mesh without a picture: it has no faces"])
    camera = jt.Camera((0.3, -0.3, 0.1), (0.05, 0.0, 0.0), width=16, height=12)
    image = jt.render(solution, camera)
    pixels, lines = shown(image.with_radiance(image.radiance * np.nan))
    assert pixels is None and len(lines) == 1
    assert lines[0].startswith("Image without a picture: ")


def test_traced_values_are_told_and_not_drawn(solution):
    texts = []

    @jax.jit
    def shown_inside(kelvin):
        texts.append(replace(solution, surface_temperature=kelvin)._repr_html_())
        return kelvin

    shown_inside(solution.surface_temperature)
    assert texts == ["<div>Solution of traced values</div>"]


def test_results_have_labels(solution):
    dataset = solution.to_xarray()
    block = dataset.sel(body="<hot> block")
    np.testing.assert_array_equal(dataset.time, [30.0, 60.0])
    np.testing.assert_array_equal(
        block.mean_temperature, solution.mean_temperature[:, 0]
    )
    of_second = dataset.surface_temperature.where(
        dataset.body_of_fragment == "body 1", drop=True
    )
    np.testing.assert_array_equal(of_second, solution.of_body(1))
    assert dataset.z.attrs == {"units": "m"}
    np.testing.assert_array_equal(
        dataset.probe_temperature.sel(probe="core"), solution.probe_temperature[:, 0]
    )
    # Heat of the bodies adds up to that of the scene.
    np.testing.assert_allclose(
        dataset.heat.sum("body").sel(mechanism="convection"),
        solution.energy.mechanisms["convection"],
        rtol=1e-6,
    )
    assert np.isnan(block.heat.sel(mechanism="heat_flux")).all()
    np.testing.assert_array_equal(dataset.heat_flux, solution.heat_flux)


def test_a_stored_run_has_the_same_labels(solution, tmp_path):
    solution.save(tmp_path)
    assert jt.load_run(tmp_path).to_xarray().identical(solution.to_xarray())
