"""Frames as files of all kinds, measurements, sheets and animations of a run."""

import csv
import importlib.util
import shutil

import numpy as np
import pytest
from cli_runs import (
    FRAMES,
    RESULTS,
    files,
    frame_files,
    pixels,
    refused,
    run,
    sets,
    succeed,
)
from PIL import Image

from jaxthermo.image.files.exr import read_exr


MEASUREMENTS = (
    "image.measurements=[{kind: spot, at: [50%, 50%]}, {kind: spot, name: sky, at: "
    "[0, 0]}, {kind: box, name: block, corners: [[26 px, 0.3], [38 px, 0.7]]}, "
    "{kind: isotherm, above: 10.8 degC}]"
)
MEASURED = {"measurements.csv", "measurements.svg", "measurements.png"}


def render(folder, *options):
    out = succeed("render", folder, *options)
    return out


def measured(folder):
    """The rows of the table of measurements, by the names of the columns."""
    text = (folder / "measurements.csv").read_text()
    return list(csv.DictReader(text.splitlines()))


def test_all_kinds_of_files_have_the_same_temperatures(finished, tmp_path):
    file_types = "image.files=[csv, centikelvin, tiff]"
    out = render(finished, "--set", file_types, "--out", tmp_path)
    assert out == f"3 frames in {tmp_path / 'frames'}\n"
    ends = (".csv", "_centikelvin.png", ".tiff")
    assert files(tmp_path) == {f"frames/{name}{end}" for name in FRAMES for end in ends}
    path = tmp_path / "frames/t000012.00s"
    kelvin = pixels(path.with_name(path.name + ".tiff"))
    assert kelvin.shape == (48, 64) and 279 < kelvin.min() < kelvin.max() < 500
    counts = pixels(path.with_name(path.name + "_centikelvin.png"))
    np.testing.assert_allclose(counts * 0.01, kelvin, rtol=0, atol=0.0051)
    table = np.loadtxt(path.with_name(path.name + ".csv"), delimiter=",")
    np.testing.assert_allclose(table, kelvin, rtol=0, atol=5.1e-4)


def test_what_is_above_16_bits_is_said(scene, out):
    changes = sets(
        "bodies.0.temperature=900",
        "image.files=[centikelvin]",
        "image.quantity=surface",
    )
    told = succeed("simulate", scene, "--out", out, *changes)
    assert "pixels above 655.35 K in the centikelvin files" in told
    counts = pixels(out / "frames/t000005.00s_centikelvin.png")
    assert counts.max() == 65535


def test_measurements_are_on_the_frames_in_a_table_and_in_a_chart(finished, tmp_path):
    out = render(finished, "--set", MEASUREMENTS, "--out", tmp_path)
    assert "'sky' is on the background or an outline in 3 of 3 frames" in out
    assert files(tmp_path) == frame_files() | MEASURED
    rows = measured(tmp_path)
    names = ["time_s", "Sp1_K", "sky_K", "block_min_K", "block_mean_K", "block_max_K"]
    assert [*rows[0]] == [*names, "Is1_fraction", "Is1_pixels"]
    assert [row["time_s"] for row in rows] == ["5", "12", "20"]
    assert all(row["sky_K"] == "" for row in rows)
    for row in rows:
        low, mean, high = (float(row[name]) for name in names[3:])
        assert 279 < low < mean < high < 500
    # It reflects the sun in the first frame, and not in the others.
    warm = [float(row["Is1_fraction"]) for row in rows]
    assert 0 < warm[0] <= 1 and warm[1:] == [0, 0]
    plain = pixels(finished / "frames/t000005.00s.png")
    drawn = pixels(tmp_path / "frames/t000005.00s.png")
    assert drawn.shape[1] == plain.shape[1] and len(drawn) > len(plain)


def test_the_spot_is_the_pixel_of_the_table(finished, tmp_path):
    changes = sets(MEASUREMENTS, "image.files=[csv]")
    render(finished, *changes, "--out", tmp_path)
    table = np.loadtxt(tmp_path / "frames/t000012.00s.csv", delimiter=",")
    rows = measured(tmp_path)
    assert float(rows[1]["Sp1_K"]) == pytest.approx(table[24, 32], abs=6e-4)
    assert float(rows[1]["block_max_K"]) == pytest.approx(
        table[14:34, 26:39].max(), abs=6e-4
    )


@pytest.mark.parametrize(
    ("options", "ending"),
    [((), "png"), (("gif",), "gif"), (("mp4", "--frame-rate", "4"), "mp4")],
)
def test_an_animation_says_its_speed(finished, tmp_path, options, ending):
    changes = sets("image.files=[csv]")
    out = render(finished, "--animate", *options, *changes, "--out", tmp_path)
    rate = 4 if "--frame-rate" in options else 2
    told = f"3 frames at {rate} a second, of times that are not evenly spaced"
    assert f"animation.{ending}: {told}\n" in out
    assert f"animation.{ending}" in files(tmp_path)
    if ending != "mp4":
        with Image.open(tmp_path / f"animation.{ending}") as animation:
            assert getattr(animation, "n_frames", 1) == 3
            first = np.asarray(animation.convert("RGB")).astype(int)
        still = pixels(finished / "frames/t000005.00s.png")
        assert np.abs(first - still).mean() < 2


def test_later_frames_take_the_place_of_all_outputs(finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "run")
    (folder / "notes.csv").write_text("mine")
    file_types = "image.files=[png, exr, tiff, csv, centikelvin]"
    changes = sets(MEASUREMENTS, file_types)
    render(folder, "--animate", "gif", "--contact-sheet", *changes)
    together = {"animation.gif", "contact_sheet.png", *MEASURED}
    ends = (".png", ".exr", ".tiff", ".csv", "_centikelvin.png")
    frames = {f"frames/{name}{end}" for name in FRAMES for end in ends}
    assert files(folder) == RESULTS | together | frames | {"notes.csv"}
    render(folder, "--animate", "apng")
    assert files(folder) == RESULTS | frame_files() | {"notes.csv", "animation.png"}
    render(folder)
    assert files(folder) == RESULTS | frame_files() | {"notes.csv"}


def test_a_run_writes_them_and_the_next_one_removes_them(scene, out):
    changes = sets(MEASUREMENTS)
    told = succeed(
        "simulate", scene, "--out", out, *changes, "--contact-sheet", "--animate"
    )
    together = {"animation.png", "contact_sheet.png", *MEASURED}
    assert files(out) == RESULTS | frame_files() | together
    assert "note: measurement 'sky' is on the background" in told
    succeed("simulate", scene, "--out", out)
    assert files(out) == RESULTS | frame_files()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("image.files=[png, jpg]", "image.files.1: 'jpg' is not known"),
        ("image.files=[]", "image.files: must not be empty"),
        ("image.files=[png, png]", "image.files: 'png' is given twice"),
        (
            "image.measurements=[{kind: spot, at: [64 px, 3 px]}]",
            "image.measurements.0.at.0: '64 px' is outside of the image, whose columns",
        ),
        (
            "image.measurements=[{kind: box, corners: [[0, 0], [1, 48 px]]}]",
            "image.measurements.0.corners.1.1: '48 px' is outside of the image",
        ),
        ("image.measurements=[{kind: spot, at: [1.5, 0]}]", "is no coordinate"),
        ("image.measurements=[{kind: isotherm}]", "missing `above` or `below`"),
        (
            "image.measurements=[{kind: isotherm, above: 300, below: 290}]",
            "290 K is not above `above`, 300 K",
        ),
        (
            "image.measurements=[{kind: spot, name: a, at: [0, 0]}, {kind: line, name: "
            "a, ends: [[0, 0], [1, 1]]}]",
            "measurement 'a' is there twice",
        ),
    ],
)
def test_mistakes_are_refused_by_explain(scene, change, message):
    assert message in refused("simulate", scene, "--explain", "--set", change)


def test_explain_names_measurements_on_the_background(scene):
    out = succeed("simulate", scene, "--explain", "--set", MEASUREMENTS)
    notes = [line for line in out.splitlines() if "measurement" in line]
    assert notes == [
        "note: measurement 'sky' is on the background or an outline at the start"
    ]


def test_explain_refuses_a_camera_that_sees_nothing(scene):
    away = "camera.look_at=[9, 9, 9]"
    code, _, err = run("simulate", scene, "--explain", "--set", away)
    assert code == 2 and "sees no body" in err and err.count("\n") == 1


def test_options_of_animations_are_checked_before_any_work(
    finished, tmp_path, scene, out, monkeypatch
):
    for options, message in [
        (["--animate", "avi"], 'Choose from: "apng", "gif", "mp4"'),
        (["--frame-rate", "5"], "give --animate too"),
        (["--animate", "--frame-rate", "0"], "give frames a second, up to 100"),
        (
            ["--animate", "gif", "--set", "camera={width: 16384, height: 16384}"],
            "3 frames of 16384 x 16384 do not fit into memory: use mp4",
        ),
    ]:
        assert message in refused("render", finished, *options, "--out", tmp_path / "n")
    find = importlib.util.find_spec

    def missing(name):
        return None if name == "av" else find(name)

    monkeypatch.setattr(importlib.util, "find_spec", missing)
    err = refused("simulate", scene, "--out", out, "--animate", "mp4")
    assert "pip install '.[video]'" in err
    assert not out.exists() and not (tmp_path / "n").exists()


def test_the_gain_by_the_histogram_changes_the_pictures_alone(finished, tmp_path):
    render(finished, "--set", "image.gain=plateau", "--out", tmp_path)
    for name in FRAMES:
        plain, drawn = (
            pixels(folder / f"frames/{name}.png") for folder in (finished, tmp_path)
        )
        assert plain.shape == drawn.shape and (plain != drawn).any()
    for channel in ("temperature_K", "apparent_temperature_K"):
        linear, plateau = (
            read_exr(folder / "frames/t000012.00s.exr")[0][channel]
            for folder in (finished, tmp_path)
        )
        np.testing.assert_array_equal(linear, plateau)


def test_effects_of_a_camera_are_in_the_frames(finished, tmp_path):
    effects = "image.effects=[{kind: detector_noise, netd: 100 mK}, blur: 1]"
    assert "image.effects.1" in refused("render", finished, "--set", effects)
    effects = "image.effects=[{kind: blur, sigma: 1}, {kind: detector_noise, netd: 1}]"
    render(finished, "--set", effects, "--out", tmp_path)
    plain, noisy = (
        read_exr(folder / "frames/t000012.00s.exr")[0]["apparent_temperature_K"]
        for folder in (finished, tmp_path)
    )
    # Over the even background the noise is what it should be at 280 K.
    change = (noisy - plain)[:, :8]
    assert 0.9 < change.std() < 1.6
    twice = "image.effects=[detector_noise, detector_noise]"
    assert "give it once" in refused("render", finished, "--set", twice)
