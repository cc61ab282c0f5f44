"""`jaxthermo simulate` from config to files: everything that design.md promises."""

import csv
import json
import shutil

import numpy as np
import OpenEXR
import pytest
from cli_runs import (
    RESULTS,
    SCENE,
    files,
    frame_files,
    pixels,
    run,
    scene_file,
    sets,
    succeed,
)

import jaxthermo as jt
from jaxthermo.cli.body_lines import structure_lines
from jaxthermo.config.loader import config_hash, load_config, resolved
from jaxthermo.image.colour.palette import palette_names
from jaxthermo.image.files.exr import _exr_channels, read_exr
from jaxthermo.image.surface.camera import frame_all
from jaxthermo.structures.report import structure_report
from tests.bodies import blocks


SECOND_BODY = """
  - shape: {kind: sphere, radius: 2 cm}
    pitch: 8 mm
    material: {name: copper, emissivity: 0.9}
    temperature: 350
    pose: {translation: [8 cm, 0, 5 cm]}
    regions:
      - {lower: [-1, -1, -1], upper: [1, 1, 0], material: brick}
"""


@pytest.fixture(scope="module")
def summary(finished):
    return json.loads((finished / "summary.json").read_text())


@pytest.fixture(scope="module")
def solved(finished):
    """The same scene by the library, without the command line."""
    config = load_config(finished / "config.yaml")
    return jt.simulate(config.build(), config.time.end, config.time.save_times)


def simulate(tmp_path, *overrides, text=SCENE):
    """A run of a scene with overrides; returns its folder."""
    out = tmp_path / "out"
    options = sets(*overrides)
    scene = scene_file(tmp_path, text)
    succeed("simulate", scene, "--out", out, *options)
    return out


def test_it_leaves_its_results_and_nothing_else(finished):
    assert files(finished) == RESULTS | frame_files()


def test_the_terminal_tells_what_ran(tmp_path, scene):
    out = succeed("simulate", scene, "--out", tmp_path / "[red] :smile:")
    lines = out.splitlines()
    assert lines[0].startswith("box: 12 faces, watertight")
    assert "360 solid voxels of 8.333 mm in 6 x 5 x 12" in lines[1]
    assert lines[2].startswith("  full volume: 360 nodes, 918 links, ")
    assert lines[3] == "  1.58 kg, 0.0002 m3, 0.022 m2"
    assert lines[4] == "included: conduction, sun, convection, emission"
    assert lines[5].startswith("left out: per-node conductivity (")
    assert lines[6] == "left out: contact (there is one body)"
    assert lines[7] == "left out: motion (nothing moves: one snapshot)"
    assert lines[8].startswith("note: body 0 represents 100.00 % of its volume, ")
    assert "until the error in time holds, stable step" in lines[9]
    assert lines[-1].startswith("3 frames in ") and "[red] :smile:" in lines[-1]
    assert all(lines)


def test_the_summary_has_every_promised_field(summary):
    assert summary["result"] == "successful"
    assert summary["receipt"]["included"] == [
        "conduction",
        "sun",
        "convection",
        "emission",
    ]
    for omission in summary["receipt"]["left_out"]:
        assert omission["what"] and omission["why"]
    assert summary["nodes"] == summary["receipt"]["nodes"] == 6 * 5 * 12
    assert summary["links"] == 5 * 5 * 12 + 6 * 4 * 12 + 6 * 5 * 11
    assert summary["steps"] > 0
    for cost in ("compile_time_s", "run_time_s", "peak_memory_bytes"):
        assert summary[cost] > 0
    assert summary["times_s"] == [5, 12, 20]
    assert {"python", "jaxthermo", "jax", "numpy"} <= set(summary["versions"])
    assert summary["device"].startswith("cpu")
    assert "seed" in summary


def test_the_summary_carries_the_config_and_its_hash(finished, summary):
    config = load_config(finished / "config.yaml")
    assert summary["config"] == resolved(config)
    assert summary["config_hash"] == config_hash(config)


def test_the_resolved_config_is_the_config_that_was_given(finished, scene):
    config = load_config(scene)
    assert load_config(finished / "config.yaml") == config


def test_the_energies_add_up(summary):
    energy = summary["energy"]
    names = {"stored_J", "sun_J", "convection_J", "emission_J", "residual_relative"}
    assert set(energy) == names
    moved = np.sum([energy[name] for name in names if name.endswith("_J")], axis=0)
    moved = moved - energy["stored_J"]
    assert energy["stored_J"] == pytest.approx(moved, rel=1e-5)
    assert np.abs(energy["residual_relative"]).max() < 1e-5


def test_the_energy_table_is_the_summary(finished, summary):
    with (finished / "energy.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [float(row["time_s"]) for row in rows] == summary["times_s"]
    assert set(rows[0]) == {"time_s", *summary["energy"]}
    for name, values in summary["energy"].items():
        assert [float(row[name]) for row in rows] == pytest.approx(values, rel=1e-7)


def test_surface_temperatures_of_each_body(summary, solved):
    (body,) = summary["bodies"]
    stored = body["surface_temperature_K"]
    of_body = np.asarray(solved.of_body(0), float)
    area = solved.surfaces[0].geometry.fragment_area
    assert stored["min"] == of_body.min(1).tolist()
    assert stored["max"] == of_body.max(1).tolist()
    assert stored["mean"] == pytest.approx(np.average(of_body, 1, area))
    assert (
        body["mean_temperature_K"] == np.asarray(solved.mean_temperature[:, 0]).tolist()
    )


def test_the_run_is_that_of_the_library_bit_for_bit(finished, solved):
    with np.load(finished / "solution.npz") as stored:
        for name in ("times", "surface_temperature", "mean_temperature"):
            expected = np.asarray(getattr(solved, name))
            assert stored[name].dtype == expected.dtype
            np.testing.assert_array_equal(stored[name], expected)


def test_frames_are_those_of_the_library(finished, solved):
    config = load_config(finished / "config.yaml")
    triangles = solved.surfaces[0].geometry.triangles
    camera = frame_all(triangles, 64, 48)
    image = jt.render(solved, camera, 1, samples=config.image.samples)
    with OpenEXR.File(str(finished / "frames/t000012.00s.exr"), True) as file:
        channels = file.channels()
        assert set(channels) == set(_exr_channels(image))
        # Of parts of pixels, which an image of whole ones does not know.
        mask = channels.pop("mask").pixels
        inside = np.asarray(image.object_id) >= 0
        assert set(np.unique(mask)) == {0, 0.25, 0.5, 0.75, 1}
        assert (mask[~inside] < 1).all() and (mask[inside] > 0).all()
        for name in channels:
            values = _exr_channels(image)[name]
            assert channels[name].pixels.dtype == np.float32
            np.testing.assert_array_equal(channels[name].pixels, values, name)


def test_the_frame_carries_its_time_and_config(finished, tmp_path):
    _, header = read_exr(finished / "frames/t000012.00s.exr")
    assert header["time_s"] == "12"
    (tmp_path / "from_frame.yaml").write_text(header["config"])
    config = load_config(tmp_path / "from_frame.yaml")
    assert config == load_config(finished / "config.yaml")


def test_the_pictures_share_one_scale_of_body_pixels(finished):
    pictures = [pixels(p) for p in sorted(finished.glob("frames/*.png"))]
    assert len(pictures) == 3
    # The bar and its numbers, right of the image and over the line with the time.
    bars = [picture[:48, 64:] for picture in pictures]
    np.testing.assert_array_equal(bars[0], bars[1])
    np.testing.assert_array_equal(bars[0], bars[2])


@pytest.mark.parametrize(
    ("structure", "told"),
    [
        pytest.param("octree", [], marks=pytest.mark.slow),
        pytest.param("{kind: aggregate, factor: 3}", [], marks=pytest.mark.slow),
        ("{kind: single_shell, capacity: own}", ["65 %"]),
    ],
)
def test_the_terminal_and_the_summary_tell_the_structure(scene, out, structure, told):
    change = f"bodies.0.structure={structure}"
    text = succeed("simulate", scene, "--out", out, "--set", change)
    summary = json.loads((out / "summary.json").read_text())
    (report,) = summary["structures"]
    (expected,) = load_config(out / "config.yaml").build().bodies
    assert report["kind"] == type(expected.structure).__name__
    assert report["nodes"] == summary["nodes"] == expected.structure.node_count
    assert report["links"] == summary["links"] == expected.structure.link_count
    assert summary["receipt"]["capacity_ratios"] == [report["capacity_ratio"]]
    lines = text.splitlines()
    counts = f"{report['nodes']:,} nodes, {report['links']:,} links, "
    assert counts in lines[2]
    assert lines[3 : 3 + len(told)] == [
        f"  the structure holds {share} of the body's heat capacity" for share in told
    ]
    assert text.count("heat capacity") == len(told)


@pytest.mark.parametrize(
    ("ratio", "share"),
    [
        (1 + 9e-7, None),
        (1 - 2e-6, "99.99980 %"),
        (0.99953, "99.953 %"),
        (0.618, "62 %"),
        (1.12, "112 %"),
    ],
)
def test_capacity_that_is_missing_or_too_much_is_told(ratio, share):
    grid = blocks(np.ones((8, 8, 8), bool), 0.005)
    report = structure_report(jt.ShellOverCore(grid, factor=4))
    report["nodes"] = 2
    report["links"] = 1
    report["capacity_ratio"] = ratio
    report["bytes_float32"]["total"] = 2048
    first, *remarks = structure_lines(report)
    assert first == "shell over core x4 (blocks of 20 mm): 2 nodes, 1 link, 2.0 KiB"
    told = [f"the structure holds {share} of the body's heat capacity"]
    assert remarks == (told if share else [])


@pytest.mark.slow
def test_two_bodies_one_of_two_materials_in_float64(tmp_path):
    text = SCENE.replace("terms:", SECOND_BODY.strip("\n") + "\nterms:", 1)
    out = simulate(tmp_path, "dtype=float64", "time.save_at=[20]", text=text)
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["bodies"]) == 2
    hot = summary["bodies"][1]["surface_temperature_K"]
    assert 300 < hot["min"][0] < hot["mean"][0] < hot["max"][0] < 350
    left_out = {o["what"]: o["why"] for o in summary["receipt"]["left_out"]}
    assert "per-node conductivity on body 0" in left_out
    assert "per-node conductivity on body 1" not in left_out
    assert "contact" in left_out
    assert np.abs(summary["energy"]["residual_relative"]).max() < 1e-13
    with np.load(out / "solution.npz") as stored:
        assert stored["surface_temperature"].dtype == np.float64
        emissivity = stored["body1_emissivity"]
    assert set(emissivity.tolist()) == {0.9, 0.93}
    channels, _ = read_exr(out / "frames/t000020.00s.exr")
    assert set(np.unique(channels["object_id"])) == {-1, 0, 1}


def test_overrides_an_orthographic_camera_and_few_frames(tmp_path):
    out = simulate(
        tmp_path,
        "camera={kind: orthographic, width: 40, height: 30, view_height: 20 cm}",
        "image.frames=[12]",
        "image.quantity=surface",
        "image.low=1000",
        "terms=[{kind: surroundings, temperature: 280}]",
        "name=shade",
    )
    assert files(out) == RESULTS | frame_files({"t000012.00s"})
    summary = json.loads((out / "summary.json").read_text())
    assert summary["config"]["name"] == "shade"
    assert summary["receipt"]["included"] == ["conduction", "emission"]
    assert summary["times_s"] == [5, 12, 20]
    channels, _ = read_exr(out / "frames/t000012.00s.exr")
    assert channels["depth_m"].shape == (30, 40)


def test_every_palette_draws(finished, tmp_path):
    looks = set()
    for palette in palette_names():
        options = sets(f"image.palette={palette}", "image.frames=[5]")
        succeed("render", finished, "--out", tmp_path / palette, *options)
        picture = pixels(tmp_path / palette / "frames/t000005.00s.png")
        looks.add(picture[:48, :64].tobytes())
    assert len(looks) == len(palette_names())


def test_a_rerun_takes_the_place_of_the_results_but_not_of_other_files(
    finished, tmp_path
):
    out = shutil.copytree(finished, tmp_path / "out")
    for name in ("notes.txt", "frames/mine.png", "frames/t12.png"):
        (out / name).write_text("mine")
    simulate(tmp_path, "time={end: 4, save_at: [4]}")
    mine = {"notes.txt", "frames/mine.png", "frames/t12.png"}
    assert files(out) == RESULTS | frame_files({"t000004.00s"}) | mine
    assert json.loads((out / "summary.json").read_text())["times_s"] == [4]


def test_times_that_look_the_same_get_frames_of_their_own(tmp_path):
    out = simulate(tmp_path, "time={end: 0.004, save_at: [0.001, 0.003, 0.004]}")
    names = {"t000000.001s", "t000000.003s", "t000000.004s"}
    assert files(out) == RESULTS | frame_files(names)


def test_a_config_by_hand_is_not_written_over(tmp_path):
    scene = tmp_path / "config.yaml"
    scene.write_text(SCENE)
    code, _, err = run("simulate", scene, "--out", tmp_path)
    assert (code, err.count("\n")) == (2, 1)
    assert "would write over" in err
    assert scene.read_text() == SCENE
    assert files(tmp_path) == {"config.yaml"}


def test_the_resolved_config_can_be_run_again_in_its_own_folder(finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "out")
    succeed("simulate", out / "config.yaml", "--out", out)
    assert files(out) == RESULTS | frame_files()


def test_a_run_that_blows_up_is_told_and_leaves_no_results(scene, out):
    term = "terms.0={kind: heat_flux, heat_flux: -1e38}"
    code, _, err = run("simulate", scene, "--out", out, "--set", term)
    assert (code, err.count("\n")) == (2, 1)
    assert "no longer finite" in err
    assert files(out) <= {"config.yaml"}
