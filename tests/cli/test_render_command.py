"""`jaxthermo render`: new frames from a finished run, and nothing else touched."""

import shutil

import numpy as np
import pytest
import trimesh
from cli_runs import (
    RESULTS,
    files,
    frame_files,
    pixels,
    refused,
    sets,
    succeed,
)
from PIL import Image

from jaxthermo.image.files.exr import read_exr


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished run, to be written to."""
    return shutil.copytree(finished, tmp_path / "run")


def refused_render(*arguments):
    return refused("render", *arguments)


def test_unchanged_they_are_the_frames_of_the_run(finished, tmp_path):
    out = succeed("render", finished, "--out", tmp_path)
    assert out == f"3 frames in {tmp_path / 'frames'}\n"
    assert files(tmp_path) == frame_files()
    for name in frame_files():
        if name.endswith("png"):
            again = pixels(tmp_path / name)
            np.testing.assert_array_equal(again, Image.open(finished / name))
            continue
        drawn, drawn_texts = read_exr(tmp_path / name)
        expected, texts = read_exr(finished / name)
        assert drawn_texts["config"] == texts["config"]
        assert set(drawn) == set(expected)
        for channel, values in expected.items():
            np.testing.assert_array_equal(drawn[channel], values)


def test_another_camera_elsewhere(finished, tmp_path):
    contents = {name: (finished / name).read_bytes() for name in files(finished)}
    options = sets("camera.width=20", "camera.height=30", "camera.position=[1,0,0.3]")
    succeed("render", finished, "--out", tmp_path / "new", *options)
    assert files(tmp_path / "new") == frame_files()
    channels, _ = read_exr(tmp_path / "new/frames/t000005.00s.exr")
    assert channels["radiance"].shape == (30, 20)
    depth = channels["depth_m"]
    # Of the block's side at x = 2.5 cm, somewhat along the view to its middle.
    assert depth[np.isfinite(depth)].min() == pytest.approx(1.01, abs=0.02)
    assert {n: (finished / n).read_bytes() for n in files(finished)} == contents


def test_in_place_they_replace_the_frames_and_no_other_file(copied):
    (copied / "frames/mine.png").write_text("mine")
    contents = {name: (copied / name).read_bytes() for name in RESULTS}
    succeed("render", copied, "--set", "image.frames=[12]")
    mine = {"frames/mine.png"}
    assert files(copied) == RESULTS | frame_files({"t000012.00s"}) | mine
    assert {name: (copied / name).read_bytes() for name in RESULTS} == contents
    succeed("render", copied)
    assert files(copied) == RESULTS | frame_files() | mine


def test_a_refused_drawing_keeps_the_frames(copied):
    drawn = files(copied)
    assert "sees no body" in refused_render(copied, "--set", "camera.look_at=[9, 9, 9]")
    assert files(copied) == drawn


@pytest.mark.parametrize("change", ["time.end=3", "bodies.0.pitch=1mm", "name=other"])
def test_what_needs_another_run_is_refused(finished, change):
    err = refused_render(finished, "--set", change)
    assert "only camera and image" in err and change in err


def test_a_wrong_override_is_refused(finished):
    assert "did you mean 'width'" in refused_render(finished, "--set", "camera.widht=3")
    assert "not a saved time" in refused_render(finished, "--set", "image.frames=[3]")


@pytest.mark.parametrize("name", ["config.yaml", "solution.npz"])
def test_a_folder_that_no_run_left(copied, name):
    (copied / name).unlink()
    assert name in refused_render(copied)


def test_a_folder_that_is_not_there(tmp_path):
    assert str(tmp_path / "nowhere") in refused_render(tmp_path / "nowhere")


@pytest.mark.parametrize("damage", ["cut", "junk", "empty", "foreign"])
def test_a_damaged_solution(copied, tmp_path, damage):
    path = copied / "solution.npz"
    content = path.read_bytes()
    damaged = {"cut": content[: len(content) // 2], "junk": b"junk" * 99, "empty": b""}
    if damage == "foreign":
        np.savez(path, times=np.zeros(3))
    else:
        path.write_bytes(damaged[damage])
    err = refused_render(copied, "--out", tmp_path / "new")
    assert str(path) in err and "run the simulation again" in err
    assert not (tmp_path / "new").exists()


def test_the_mesh_may_have_gone_since(tmp_path, scene, out):
    mesh = tmp_path / "block.stl"
    trimesh.creation.box((0.05, 0.04, 0.1)).export(mesh)
    body = f"{{mesh: {{path: {mesh}, unit: m}}, voxels_high: 12, material: copper, "
    change = f"bodies=[{body}temperature: 300}}]"
    succeed("simulate", scene, "--out", out, "--set", change)
    mesh.unlink()
    succeed("render", out, "--out", tmp_path / "new")
    assert files(tmp_path / "new") == frame_files()


def test_the_out_folder_is_a_file(finished, tmp_path):
    (tmp_path / "file").write_text("")
    assert "is a file" in refused_render(finished, "--out", tmp_path / "file")
