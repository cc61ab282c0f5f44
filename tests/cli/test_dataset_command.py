"""`jaxthermo dataset`: labelled frames, the same again after an interruption."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_runs import SCENE, files, pixels, refused, run, succeed

import jaxthermo as jt
import jaxthermo.cli.dataset as command
from jaxthermo.cli.dataset_plan import plan_dataset
from jaxthermo.config.camera_framing import build_camera
from jaxthermo.config.loader import load_dataset
from jaxthermo.errors import InputError
from jaxthermo.image.files.exr import read_exr
from jaxthermo.image.files.labels import camera_matrices


BALL = """
  - shape: {kind: sphere, radius: 2 cm}
    pitch: 8 mm
    material: copper
    temperature: 320
    pose: {translation: [0.08, 0, 0]}
terms:"""
DATASET = """
scene: block.yaml
variations: {terms.1.temperature: [280, 300]}
views:
  - {position: [0.1, -0.8, 0.2], look_at: [0, 0, 0], width: 32, height: 24}
  - {position: [0.6, 0, 0.1], look_at: [0, 0, 0], width: 24, height: 24}
times: [5]
validation: 0.4
keypoints:
  near: {body: sphere, position: [0.09414, -0.01414, 0]}
  far: {body: 1, position: [0.06586, 0.01414, 0]}
  above: {position: [0, 0, 5 m]}
"""
NAMES = {f"v000{v}_c000{c}_t000005.00s" for v in (0, 1) for c in (0, 1)}
KINDS = ("images", "images_8bit", "masks", "depth")
RUN = ("config.yaml", "solution.npz")
EXPECTED = (
    {f"{folder}/{name}.png" for folder in KINDS for name in NAMES}
    | {f"radiometric/{name}.exr" for name in NAMES}
    | {f"labels/{name}.json" for name in NAMES}
    | {f"runs/v000{v}/{file}" for v in (0, 1) for file in RUN}
    | {"annotations.json", "dataset.yaml", "plan.json"}
    | {"annotations_train.json", "annotations_validation.json"}
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """The config of a small dataset, and its finished folder."""
    folder = tmp_path_factory.mktemp("dataset")
    (folder / "block.yaml").write_text(SCENE.replace("\nterms:", BALL))
    config = folder / "set.yaml"
    config.write_text(DATASET)
    out = succeed("dataset", config, "--out", folder / "out")
    assert out.endswith(f"4 frames in {folder / 'out'}, boxes in annotations.json\n")
    return config, folder / "out"


def grey(folder, channel, name):
    return pixels(folder / channel / f"{name}.png")


def test_all_files_are_there(dataset):
    assert files(dataset[1]) == EXPECTED


def test_images_masks_and_depth_are_those_of_the_frame(dataset):
    _, out = dataset
    for name in NAMES:
        exact = read_exr(out / "radiometric" / f"{name}.exr")[0]
        kelvin = exact["apparent_temperature_K"]
        body = exact["object_id"].astype(int)
        np.testing.assert_allclose(
            grey(out, "images", name) * 0.01, kelvin, atol=0.0051
        )
        np.testing.assert_array_equal(grey(out, "masks", name), body + 1)
        depth = np.where(body >= 0, exact["depth_m"], 0)
        np.testing.assert_allclose(grey(out, "depth", name) / 1000, depth, atol=6e-4)
        labels = json.loads((out / "labels" / f"{name}.json").read_text())
        share = grey(out, "images_8bit", name) / 255
        inside = (kelvin > labels["low_K"]) & (kelvin < labels["high_K"])
        back = labels["low_K"] + share * (labels["high_K"] - labels["low_K"])
        level = (labels["high_K"] - labels["low_K"]) / 255
        np.testing.assert_allclose(back[inside], kelvin[inside], atol=0.51 * level)


def test_annotations_are_boxes_of_the_masks(dataset):
    _, out = dataset
    annotations = json.loads((out / "annotations.json").read_text())
    assert [category["name"] for category in annotations["categories"]] == [
        "box",
        "sphere",
    ]
    assert len(annotations["images"]) == 4
    by_image = {image["id"]: image for image in annotations["images"]}
    for instance in annotations["annotations"]:
        image = by_image[instance["image_id"]]
        name = image["file_name"].removeprefix("images/").removesuffix(".png")
        mask = grey(out, "masks", name)
        assert mask.shape == (image["height"], image["width"])
        rows, columns = np.nonzero(mask == instance["category_id"])
        left, top, width, height = instance["bbox"]
        assert (left, top) == (columns.min(), rows.min())
        assert (width, height) == (np.ptp(columns) + 1, np.ptp(rows) + 1)
        assert (
            instance["area"]
            == len(rows)
            == sum(instance["segmentation"]["counts"][1::2])
        )
    # The ball hides most of the block from the side at which it is.
    assert len(annotations["annotations"]) == 8


def test_keypoints_are_at_the_pixels_of_the_camera(dataset):
    _, out = dataset
    places = {"near": [0.09414, -0.01414, 0], "far": [0.06586, 0.01414, 0]}
    for name in NAMES:
        labels = json.loads((out / "labels" / f"{name}.json").read_text())
        keypoints = {k["name"]: k for k in labels["keypoints"]}
        seen = {"near": 2, "far": 1, "above": 0}
        assert {key: k["visibility"] for key, k in keypoints.items()} == seen
        assert [k["body"] for k in labels["keypoints"]] == [1, 1, 0]
        matrices = labels["camera"]
        for key, place in places.items():
            local = np.array(matrices["world_to_camera"]) @ [*place, 1.0]
            column, row = (np.array(matrices.get("K")) @ local)[:2] / local[2]
            assert keypoints[key]["x"] == pytest.approx(column, abs=1e-9)
            assert keypoints[key]["y"] == pytest.approx(row, abs=1e-9)
    annotations = json.loads((out / "annotations.json").read_text())
    classes = {c["name"]: c["keypoints"] for c in annotations["categories"]}
    assert classes == {"box": ["above"], "sphere": ["near", "far"]}
    for annotation in annotations["annotations"]:
        length, count = (3, 0) if annotation["category_id"] == 1 else (6, 2)
        assert len(annotation["keypoints"]) == length
        assert annotation["num_keypoints"] == count


def test_runs_are_for_training_or_for_validation(dataset):
    _, out = dataset
    files_of = {}
    for name in ("annotations", "annotations_train", "annotations_validation"):
        content = json.loads((out / f"{name}.json").read_text())
        files_of[name] = {image["file_name"] for image in content["images"]}
        assert len(content["annotations"]) == 2 * len(content["images"])
    everything, train, validation = files_of.values()
    assert train | validation == everything and not train & validation
    # A run is in one of them with all its frames.
    assert len({Path(file).name[:5] for file in validation}) == 1
    assert len(validation) == 2


@pytest.mark.slow
def test_several_processes_write_the_same_files(dataset, tmp_path):
    config, finished_folder = dataset
    out = tmp_path / "parallel"
    assert succeed("dataset", config, "--out", out, "--workers", 2, "--quiet") == ""
    assert files(out) == EXPECTED
    for file in EXPECTED - {f"runs/v000{v}/solution.npz" for v in (0, 1)}:
        assert (out / file).read_bytes() == (finished_folder / file).read_bytes(), file


def test_mistakes_in_points_sets_and_workers_are_one_line(dataset, tmp_path):
    config, _ = dataset
    for options, words in [
        (["--set", "keypoints.far.body=9"], "keypoints.far.body: 9 is not one body"),
        (["--set", "keypoints.far.body=bal"], "there are box, sphere"),
        (["--set", "validation=1"], "validation"),
        (["--set", "variations={}"], "validation: a set of its own needs another run"),
        (["--workers", "0"], "give a whole number of at least 1"),
    ]:
        err = refused("dataset", config, "--out", tmp_path / "n", *options)
        assert words in err
    assert not (tmp_path / "n").exists()


def test_cameras_stand_at_equal_distances_on_a_path(dataset):
    config, _ = dataset
    plan = plan_dataset(
        load_dataset(
            config,
            [
                "views=null",
                "path={points: [[1, 0, 0], [1, 1, 0], [0, 1, 0]], count: 5, "
                "look_at: [0, 0, 0.02], width: 80}",
            ],
        )
    )
    positions = [view.position for view in plan.views]
    assert positions == [(1, 0, 0), (1, 0.5, 0), (1, 1, 0), (0.5, 1, 0), (0, 1, 0)]
    assert {(view.width, view.look_at) for view in plan.views} == {
        (80, (0.0, 0.0, 0.02))
    }
    with pytest.raises(InputError, match=r"path\.points\.1: is the point before it"):
        path = "path={points: [[1, 0, 0], [1, 0, 0]], count: 2}"
        load_dataset(config, ["views=null", path])


def test_a_calibrated_camera_is_a_view(dataset):
    """By K and a matrix of 4 x 4, both of which the labels repeat."""
    config, _ = dataset
    K = [[40, 0, 15.5], [0, 40, 11.5], [0, 0, 1]]
    pose = [[1, 0, 0, 0], [0, 0, -1, 0.05], [0, 1, 0, 0.8], [0, 0, 0, 1]]
    view = {"K": K, "world_to_camera": pose, "width": 32, "height": 24}
    plan = plan_dataset(load_dataset(config, [f"views={json.dumps([view])}"]))
    camera = build_camera(plan.views[0], 0.1 * np.eye(3)[None])
    matrices = camera_matrices(camera)
    np.testing.assert_allclose(matrices.get("K", 0), K, atol=1e-9)
    np.testing.assert_allclose(matrices["world_to_camera"], pose[:3], atol=1e-9)


def test_the_weather_changes_what_is_seen(dataset):
    _, out = dataset
    cold, warm = (grey(out, "images", f"v000{v}_c0000_t000005.00s") for v in (0, 1))
    mask = grey(out, "masks", "v0000_c0000_t000005.00s")
    assert (warm[mask == 1].mean() - cold[mask == 1].mean()) > 0
    labels = json.loads((out / "labels" / "v0001_c0000_t000005.00s.json").read_text())
    assert labels["changes"] == {"terms.1.temperature": 300}
    assert labels["time_s"] == 5 and labels["view"] == 0


def test_interrupted_it_goes_on_to_the_same_files(dataset, out, monkeypatch):
    config, finished_folder = dataset
    real = command._write_images
    drawn = []

    def stopping(plan, **frame):
        drawn.append(frame["name"])
        if len(drawn) == 3:
            raise KeyboardInterrupt
        return real(plan, **frame)

    monkeypatch.setattr(command, "_write_images", stopping)
    code, _, err = run("dataset", config, "--out", out)
    assert code == 130 and "stopped after 2 of 4 frames" in err
    assert not (out / "annotations.json").exists()
    code, text, err = run("dataset", config, "--out", out)
    assert (code, err) == (0, "") and "v0000" not in text
    assert drawn[2] == drawn[3] and len(drawn) == 5
    assert files(out) == EXPECTED
    for name in EXPECTED:
        if name.endswith((".png", ".json")):
            assert (out / name).read_bytes() == (finished_folder / name).read_bytes(), (
                name
            )


def test_a_whole_one_is_left_as_it_is(dataset):
    config, out = dataset
    stamps = {name: (out / name).stat().st_mtime_ns for name in files(out)}
    code, text, err = run("dataset", config, "--out", out)
    assert (code, err, text.count("\n")) == (0, "", 1)
    assert succeed("dataset", config, "--out", out, "--quiet") == ""
    new_stamps = {name: (out / name).stat().st_mtime_ns for name in files(out)}
    written = {name for name in EXPECTED if new_stamps[name] != stamps[name]}
    assert written <= {file for file in EXPECTED if "/" not in file}


def test_another_dataset_does_not_mix_with_it(dataset, tmp_path):
    config, out = dataset
    copy = shutil.copytree(out, tmp_path / "out")
    changed = "variations.terms.1.temperature=[281, 300]"
    err = refused("dataset", config, "--out", copy, "--set", changed)
    assert "another dataset" in err


def test_explain_simulates_nothing(dataset, tmp_path, monkeypatch):
    config, _ = dataset
    monkeypatch.chdir(tmp_path)
    text = succeed("dataset", config, "--explain")
    assert text.startswith("2 variations, 2 views, 4 frames; classes: box, sphere\n")
    assert "v0001: terms.1.temperature=300" in text
    assert files(tmp_path) == set()


def test_a_camera_that_sees_nothing_is_found_before_any_run(dataset, tmp_path):
    config, _ = dataset
    away = "views.1.look_at=[9, 0, 0.1]"
    for options in (("--explain",), ("--out", tmp_path / "out")):
        err = refused("dataset", config, "--set", away, *options)
        assert "views.1, v0000: camera" in err and "sees no body" in err
    assert not (tmp_path / "out").exists()


def test_parts_of_a_body_have_masks_and_boxes(tmp_path):
    text = SCENE.replace("voxels_high: 12", "pitch: 1 cm").replace(
        "stainless_steel", "{labels: labels.npy, materials: [copper, stainless_steel]}"
    )
    (tmp_path / "block.yaml").write_text(text)
    shape = jt.voxelize(jt.shapes.box((0.05, 0.04, 0.1)), 0.01).solid.shape
    # The upper half is the second part.
    upper = np.arange(shape[2]) >= shape[2] / 2
    np.save(tmp_path / "labels.npy", np.broadcast_to(upper.astype(np.int32), shape))
    config = tmp_path / "set.yaml"
    view = "{position: [0, -1, 0], look_at: [0, 0, 0], width: 24, height: 32}"
    config.write_text(f"scene: block.yaml\nviews: [{view}]\ntimes: [5]\n")
    succeed("dataset", config, "--out", tmp_path / "out")
    name = "v0000_c0000_t000005.00s"
    part_mask, mask = (
        grey(tmp_path / "out", channel, name) for channel in ("parts", "masks")
    )
    # Rows run down from the upper part; the camera is level with the middle.
    row, _ = np.nonzero(mask)
    np.testing.assert_array_equal(part_mask[mask > 0], np.where(row < 16, 2, 1))
    assert not part_mask[mask == 0].any()
    labels = json.loads((tmp_path / "out" / "labels" / f"{name}.json").read_text())
    (body,) = labels["instances"]
    assert [labels["name"] for labels in body["parts"]] == ["0", "1"]
    assert sum(labels["area"] for labels in body["parts"]) == body["area"]


def test_the_schema_is_printed_by_name():
    code, text, err = run("schema", "dataset")
    assert (code, err) == (0, "") and '"DatasetConfig"' in text
    err = refused("schema", "datasets")
    assert "scene or dataset" in err
