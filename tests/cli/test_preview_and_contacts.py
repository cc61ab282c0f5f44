"""`simulate --preview` and `render --contacts`: pictures beside the frames."""

import jax.numpy as jnp
import numpy as np
import pytest
from cli_runs import files, run, scene_file, succeed
from PIL import Image

import jaxthermo as jt
from jaxthermo.cli.contacts import _texture
from jaxthermo.cli.frames import SavedTime
from jaxthermo.integrate.run.abstract_solution import StoredSolution
from jaxthermo.scene.scene import SolvedSurface, body_geometry


PAIR = """
bodies:
  - shape: {kind: box, size: [4 cm, 4 cm, 2 cm]}
    pitch: 5 mm
    material: copper
    temperature: 350
  - shape: {kind: box, size: [8 cm, 8 cm, 2 cm]}
    pitch: 5 mm
    material: copper
    temperature: 300
    pose: {translation: [0, 0, -2 cm]}
terms:
  - {kind: contact, conductance: 1000}
  - {kind: surroundings, temperature: 250}
time: {end: 2, save_at: [1, 2]}
camera: {width: 64, height: 48}
"""


def test_a_preview_neither_voxelizes_nor_runs(scene, out, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("a preview needs no voxels")

    # The package first: its name is looked up in the module, and put back afterwards.
    monkeypatch.setattr(jt, "voxelize", refuse)
    monkeypatch.setattr("jaxthermo.voxels.voxelize.voxelize", refuse)
    text = succeed("simulate", scene, "--preview", "--out", out)
    assert files(out) == {"preview.png"}
    with Image.open(out / "preview.png") as image:
        assert image.size[0] == 64
    assert "in the world from (-0.025, -0.02, -0.05) to (0.025, 0.02, 0.05) m" in text
    assert f"{out / 'preview.png'}: nothing was simulated" in text


def test_a_preview_of_a_wrong_camera_leaves_nothing(scene, out):
    code, _, err = run(
        "simulate", scene, "--preview", "--out", out,
        "--set", "camera.position=[0.01, 0, 0]",
    )  # fmt: skip
    assert code == 2 and "inside body 0" in err and not out.exists()


def test_without_a_contact_term_there_are_no_contact_textures(finished, tmp_path):
    code, _, err = run("render", finished, "--contacts", "--out", tmp_path / "new")
    assert code == 2 and "no contact term" in err and err.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_contact_textures_hold_the_temperatures_where_bodies_touch():
    grid = jt.voxelize(jt.shapes.box((0.04, 0.04, 0.02)), 0.005)
    poses = jt.Pose(), jt.Pose(translation=(0.0, 0.0, 0.02))
    grey = jnp.asarray(0.8)
    surfaces = tuple(SolvedSurface(body_geometry(grid, p), grey, grey) for p in poses)
    count = len(grid.fragment_area)
    kelvin = 300.0 + np.arange(2.0 * count)[None]
    stored = StoredSolution(jnp.zeros(1), jnp.asarray(kelvin), surfaces)
    start = SavedTime(index=0, seconds=0.0, name="start")
    texture = _texture([jt.Contact(1e3)], [grid, grid], stored, start)
    assert texture.area == pytest.approx(0.04 * 0.04)
    up = grid.fragment_normal[:, 2]
    for body, side in enumerate((up > 0.9, up < -0.9)):
        expected = np.where(side, kelvin[0, body * count :][:count] - 273.15, np.nan)
        np.testing.assert_allclose(texture.values[body], expected)


@pytest.mark.slow
def test_contact_textures_and_occlusion_of_a_run(tmp_path, out):
    succeed("simulate", scene_file(tmp_path, PAIR), "--out", out)
    run_files = files(out)
    text = succeed("render", out, "--contacts", "--set", "image.frames=[2]")
    assert text == f"1 sheet of contact textures in {out / 'contacts'}\n"
    assert files(out) - run_files == {"contacts/t000002.00s.png"}
    succeed("render", out, "--set", "image.occlusion=2 cm", "--out", tmp_path)
    plain, occluded = (
        np.asarray(Image.open(folder / "frames/t000002.00s.png"), int)
        for folder in (out, tmp_path)
    )
    assert plain.shape == occluded.shape and np.abs(occluded - plain).max() > 3


@pytest.mark.slow
@pytest.mark.parametrize("below", ["solid", "sheet"])
def test_contact_textures_are_those_of_solids(tmp_path, out, below):
    panel = """
  - shape: {kind: rectangle, width: 4 cm, length: 4 cm}
    sheet: {layers: [{material: copper, thickness: 1 mm}], pitch: 1 cm}
    temperature: 350"""
    text = PAIR.replace(
        PAIR[PAIR.index("\n  - shape") : PAIR.index("\n  - ", 20)], panel
    )
    text = text.replace("[0, 0, -2 cm]", "[0, 0, -1 cm]")
    if below == "sheet":
        text = text.replace(
            text[text.rindex("\n  - shape") : text.index("\nterms")], panel
        )
    succeed("simulate", scene_file(tmp_path, text), "--out", out)
    code, written, err = run("render", out, "--contacts", "--set", "image.frames=[2]")
    if below == "sheet":
        assert code == 2 and "all bodies are sheets" in err and err.count("\n") == 1
        return
    assert "without body 0, a sheet" in written
    assert (out / "contacts/t000002.00s.png").exists()


def test_occlusion_is_not_counted_twice(scene):
    text = "image.occlusion=2 cm"
    twice = "terms.2.occlusion=64"
    code, _, err = run("simulate", scene, "--preview", "--set", text, "--set", twice)
    assert code == 2 and "would hide the surroundings twice, after terms.2" in err
