"""Bad inputs: one clear line each, status 2, no traceback, and nothing half-written."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cli_runs import SCENE, files, run, scene_file, sets, succeed

from jaxthermo.geometry.files.read import FORMATS


KINDS = [suffix.removeprefix(".") for suffix in FORMATS]


def refused(*arguments, lines=1):
    """The lines with which a command is refused, without their beginning."""
    code, _, err = run(*arguments)
    messages = err.splitlines()
    assert code == 2
    assert len(messages) == lines, err
    assert all(line.startswith("jaxthermo: ") for line in messages)
    return err.replace("jaxthermo: ", "")


def refused_voxelize(mesh, out, pitch="1cm"):
    return refused("voxelize", mesh, "--pitch", pitch, "--unit", "m", "--out", out)


def exported(file_type):
    data = trimesh.creation.icosphere(subdivisions=2, radius=0.05).export(
        file_type=file_type
    )
    return data if isinstance(data, bytes) else str(data).encode()


def without_faces(file_type):
    cloud = trimesh.Trimesh(np.eye(3), np.zeros((0, 3), int), process=False)
    if file_type == "glb":
        return exported("glb")[:12]
    if file_type == "stl":
        return b"solid nothing\nendsolid nothing\n"
    data = cloud.export(file_type=file_type)
    return data if isinstance(data, bytes) else str(data).encode()


def content(damage, file_type):
    if damage == "empty":
        return b""
    if damage == "junk":
        return np.random.default_rng(3).integers(0, 256, 4000, np.uint8).tobytes()
    if damage == "cut":
        data = exported(file_type)
        # OBJ has no length: a cut between faces is an open mesh, a cut before is none.
        share = 0.2 if file_type == "obj" else 0.6
        return data[: int(share * len(data))]
    return without_faces(file_type)


@pytest.mark.parametrize("file_type", KINDS)
@pytest.mark.parametrize("damage", ["empty", "junk", "cut", "no faces"])
def test_a_file_that_is_no_mesh(tmp_path, out, damage, file_type):
    mesh = tmp_path / f"bad.{file_type}"
    mesh.write_bytes(content(damage, file_type))
    err = refused_voxelize(mesh, out)
    assert str(mesh) in err
    assert not out.exists()
    err = refused("simulate", mesh_scene(tmp_path, mesh), "--out", out)
    assert str(mesh) in err
    assert not out.exists()


def mesh_scene(folder, mesh):
    start = SCENE.index("  - shape")
    stop = SCENE.index("    voxels_high")
    body = f"  - mesh: {{path: {json.dumps(str(mesh))}, unit: m}}\n"
    return scene_file(folder, SCENE[:start] + body + SCENE[stop:])


def refused_mesh(tmp_path, mesh):
    """The line of `voxelize`, having made sure that `simulate` refuses too."""
    out = tmp_path / "out"
    again = refused("simulate", mesh_scene(tmp_path, mesh), "--out", out)
    err = refused_voxelize(mesh, out)
    assert str(mesh) in again and str(mesh) in err
    assert not out.exists()
    return err


def test_vertices_that_are_no_numbers(tmp_path):
    mesh = tmp_path / "nan.obj"
    mesh.write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n")
    assert "finite" in refused_mesh(tmp_path, mesh)


def test_a_missing_mesh(tmp_path):
    assert "no such file" in refused_mesh(tmp_path, tmp_path / "none.obj")


def test_a_mesh_that_is_a_folder(tmp_path):
    (tmp_path / "folder.obj").mkdir()
    assert "folder" in refused_mesh(tmp_path, tmp_path / "folder.obj")


@pytest.fixture
def sphere(tmp_path):
    mesh = tmp_path / "sphere.stl"
    mesh.write_bytes(exported("stl"))
    return mesh


@pytest.mark.parametrize(
    ("pitch", "message"), [("50 cm", "pitch"), ("100 nm", "memory"), ("1e-300 m", "")]
)
def test_a_pitch_beyond_reason(tmp_path, out, sphere, pitch, message):
    err = refused_voxelize(sphere, out, pitch)
    assert message in err
    scene = mesh_scene(tmp_path, sphere)
    again = refused("simulate", scene, "--out", out, "--set", f"bodies.0.pitch={pitch}")
    assert message in again
    assert not out.exists() or files(out) == set()


def test_a_scene_too_large_for_the_memory(scene, out, monkeypatch):
    monkeypatch.setattr("jaxthermo.host_memory.available_bytes", lambda: 60_000)
    err = refused("simulate", scene, "--out", out)
    assert "memory" in err and "coarser pitch" in err
    assert not out.exists()


def test_a_missing_config(tmp_path):
    err = refused("simulate", tmp_path / "none.yaml", "--out", tmp_path / "out")
    assert "no such file" in err
    assert not (tmp_path / "out").exists()


def test_a_config_that_is_a_folder(tmp_path):
    assert "directory" in refused("simulate", tmp_path, "--out", tmp_path / "out")


def test_a_config_that_is_a_picture(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff")
    assert "not a text file" in refused("simulate", path)


def test_seven_mistakes_are_seven_lines(tmp_path, out):
    text = """
bodies:
  - shape: {kind: ball, radius: 1 cm}
    pitch: 2 s
    material: unobtainium
    temperature: -3
terms: [{kind: sun, direction: [0, 0, 0], irradiance: 1}]
time: {end: 10, save_at: [20]}
image: {palette: sunset}
"""
    scene = scene_file(tmp_path, text)
    err = refused("simulate", scene, "--out", out, lines=7)
    for where in (
        "bodies.0.shape",
        "bodies.0.pitch",
        "bodies.0.material",
        "bodies.0.temperature",
        "terms.0.direction",
        "time.save_at.0",
        "image.palette",
    ):
        assert f"{scene}: {where}" in err
    assert not out.exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("camera={position: [1 cm, 0, 0]}", "inside body 0"),
        ("camera={position: [1, 0, 0], look_at: [2, 0, 0]}", "sees no body"),
        ("time.save_at=[25]", "after the end"),
        ("time.save_at=[5, 5]", "is not after"),
        ("time.save_at=[0]", "more than 0"),
        ("image.frames=[6]", "not a saved time"),
        ("solver.dt=100", "stable step"),
        ("solver.dt=0", "more than 0"),
        ("bodies.0.temperature=20", "degC"),
        ("terms.1.temperature=100", "allow_extreme_temperatures"),
        ("bodies.0.voxel_high=3", "did you mean 'voxels_high'"),
        ("nothing.at.all=3", "unknown key"),
        ("bodies.7.pitch=3", "1 entries"),
        ("bodies.0.pitch", "expected a path and a value"),
        ("camera.width=", "width"),
        ("camera.width=100000", "at most 16384"),
        ("terms.0={kind: moon}", "unknown kind 'moon'"),
        ("bodies.0.temperature=.nan", "finite"),
        ("bodies.0.voxels_high=4096", "memory"),
        ("bodies.0.structure=octre", "did you mean 'octree'"),
        (
            "bodies.0.structure={kind: octree, factor: 2}",
            "octree takes levels, weights",
        ),
        ("bodies.0.structure.weights.within=[1, 2, 3]", "within has 3 values"),
        ("bodies.0.structure={kind: partition, labels: block.yaml}", "numpy.save"),
    ],
)
def test_an_override_beyond_reason(scene, out, change, message):
    err = refused("simulate", scene, "--out", out, "--set", change)
    assert message in err
    assert not out.exists()


def test_the_stable_step_is_told(scene, out):
    step = "solver.dt=100"
    err = refused("simulate", scene, "--out", out, "--set", step)
    assert "100" in err and "stable step of this scene is 2." in err
    assert "in a file `solver: super_time_stepping` or `solver: trbdf2`" in err


STACKED = """
bodies:
  - {shape: &cube {kind: box, size: [4 cm, 4 cm, 4 cm]}, pitch: 1 cm,
     material: copper, temperature: 300}
  - {shape: *cube, pitch: 1 cm, material: copper, temperature: 350,
     pose: {translation: [0, 0, 4 cm]}}
terms:
  - {kind: contact, conductance: 1000}
  - {kind: surroundings, temperature: 280}
time: {end: 20, save_at: [20]}
"""
"""One cube on another."""

FAR = "{region: {lower: [1, 1, 1], upper: [2, 2, 2]}}"


@pytest.mark.parametrize(
    ("change", "messages"),
    [
        ("terms.1={kind: sun, direction: [0, 0, 0], irradiance: 9}",
         ("terms.1.direction", "[0, 0, 0]", "has to point somewhere")),
        ("terms.1={kind: wind, velocity: [0, 0, 0], speed: 3, temperature: 290}",
         ("terms.1.velocity", "[0, 0, 0]", "has to point somewhere")),
        ("terms.1={kind: area_source, centre: [1, 0, 0], normal: [0, 0, 0], "
         "size: [1, 1], radiance: 9}", ("terms.1.normal", "has to point somewhere")),
        ("terms.1={kind: point_source, position: [0, 0, 5 cm], radiant_intensity: 9}",
         ("PointSource", "inside body 1", "move it out")),
        ("terms.1={kind: area_source, centre: [0, 0, 1 cm], normal: [0, 0, 1], "
         "size: [1 cm, 1 cm], radiance: 9}",
         ("AreaSource", "inside body 0", "move it out")),
        ("bodies.1.pose.translation=[0, 0, 0]",
         ("body 0 lies wholly in the solid of body 1", "move it out")),
        ("bodies.1.pose.translation=[0, 0, 1 cm]",
         ("body 0 and body 1 overlap", "move them apart")),
        ("bodies.1.material={name: copper, emissivity: 1.2}",
         ("bodies.1.material.emissivity", "at most 1")),
        ("bodies.1.material.emissivity=-10 %",
         ("bodies.1.material.emissivity", "at least 0")),
        (f"terms.1={{kind: heat_flux, heat_flux: 9, on: {FAR}}}",
         ("no surface of body 0", "check its corners")),
        (f"terms.1={{kind: heat_source, heat_rate_density: 9, within: {FAR}}}",
         ("no part of body 0", "corners are metres")),
        ("terms=[{kind: fixed_temperature, temperature: 300}, {kind: fixed_temperature,"
         " temperature: 310, on: {side: {normal: [1, 0, 0]}}}]",
         ("terms[0] and terms[1]", "body 0", "keep their `on` apart")),
        ("bodies.0.material={name: copper, conductivity: {temperatures: [300, 400], "
         "values: [400, -2]}}",
         ("bodies.0.material.conductivity.values.1", "more than 0, got -2")),
        ("bodies.0.material={name: copper, conductivity: [1, 0, 1]}",
         ("bodies.0.material.conductivity.1", "more than 0")),
        ("terms.0.bodies=[0, 2]", ("terms.0.bodies.1", "there is no body 2")),
        ("terms.0.max_pairs=3", ("bodies 0 and 1", "room for 3", "give a larger")),
        ("terms.1={kind: contact, conductance: bonded, bodies: [1, 0]}",
         ("terms[0] and terms[1]", "both join bodies 0 and 1")),
        ("bodies.1.pose={times: [0, 20], poses: [{translation: [0, 0, 4 cm]}, {}], "
         "every: 1 ms}", ("20000 snapshots", "give 0.002 s or more")),
        ("bodies.0.material={labels: block.yaml, materials: [gold]}",
         ("block.yaml", "write it with numpy.save")),
    ],
)  # fmt: skip
def test_a_scene_beyond_physics(tmp_path, out, change, messages):
    scene = scene_file(tmp_path, STACKED)
    err = refused("simulate", scene, "--out", out, "--set", change)
    assert all(message in err for message in messages), err
    assert not out.exists()


def test_bodies_that_overlap_are_told(tmp_path):
    scene = scene_file(tmp_path, STACKED)
    changes = sets("bodies.1.pose.translation=[0, 0, 2 cm]", "terms=[]")
    out = succeed("simulate", scene, "--explain", *changes)
    (line,) = [line for line in out.splitlines() if line.startswith("warning: ")]
    # Half of a cube of 4 cm.
    words = ("bodies 0 and 1 overlap by 20 mm around (", "3.2e-05 m3, 50 % of body")
    assert all(phrase in line for phrase in words), line


# The note itself is tested in `test_wind`, other notes on the terminal in
# `test_simulate_command`.
@pytest.mark.slow
def test_a_wind_beyond_what_was_measured_is_a_note(tmp_path):
    wind = "terms.1={kind: wind, velocity: [300, 0, 0], temperature: 290}"
    scene = scene_file(tmp_path, STACKED)
    out = succeed("simulate", scene, "--explain", "--set", wind)
    notes = [line for line in out.splitlines() if line.startswith("note: ")]
    assert any("wind on body 1: Re " in note and "is above" in note for note in notes)


@pytest.mark.parametrize("below", ["", "below", "below/it"])
@pytest.mark.parametrize("command", ["simulate", "voxelize"])
def test_out_is_a_file_or_below_one(tmp_path, scene, sphere, command, below):
    file = tmp_path / "taken"
    file.write_text("mine")
    if command == "simulate":
        err = refused("simulate", scene, "--out", file / below)
    else:
        err = refused_voxelize(sphere, file / below)
    assert "--out" in err
    assert file.read_text() == "mine"


def test_out_with_a_file_where_frames_go(scene, out):
    out.mkdir()
    (out / "frames").write_text("mine")
    err = refused("simulate", scene, "--out", out)
    assert "is a file" in err
    assert files(out) == {"frames"}


def test_out_with_a_folder_where_a_file_goes(scene, out):
    (out / "summary.json").mkdir(parents=True)
    err = refused("simulate", scene, "--out", out)
    assert "is a folder" in err
    assert files(out) == set()


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulat",),
        ("simulate",),
        ("simulate", "a.yaml", "--ouput", "b"),
        ("simulate", "a.yaml", "--set"),
        ("render",),
        ("voxelize", "a.stl"),
        ("voxelize", "a.stl", "--pitch", "wide"),
        ("--verson",),
    ],
)
def test_an_unknown_command_or_option(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(*arguments)
    assert files(tmp_path) == set()


def test_the_console_script(tmp_path):
    """With the mistake that takes the fewest imports to be found."""
    script = Path(sys.executable).with_name("jaxthermo")
    done = subprocess.run(
        [script, "example", "nowhere"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("jaxthermo: ") and done.stderr.count("\n") == 1
    assert files(tmp_path) == set()
